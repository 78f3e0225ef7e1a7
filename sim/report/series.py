"""The plots of each sweep: scores with their bounds, shares of the loss by stage, and causes of errors."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from sim.report.findings import causes_of, findings, stages
from sim.report.plots import Bars, Line, Plot, Spans
from sim.report.rows import KINDS, STAGES, Rows, Setting, SweepRows
from sim.stress.sweeps import KNOWN_SWEEPS


@dataclass(frozen=True)
class PlottedMeasure:
    """A score with a curve: its name in the rows, its title and its label.

    limits: pairs of a name in the rows and the label of its line. within: the range that the axis shows at least.
    """

    name: str
    title: str
    label: str
    limits: tuple[tuple[str, str], ...] = ()
    within: tuple[float, float] = (0.0, 1.0)


REST = "other"
BOUNDS = (("dead_reckoning_m", "dead reckoning"), ("ate_bound_m", "Cramér-Rao bound"))
MEASURES = (
    PlottedMeasure("mota", "Tracking accuracy", "MOTA (1 is perfect)"),
    PlottedMeasure("idf1", "Identity", "IDF1 (1 is perfect)"),
    PlottedMeasure("ate_m", "Error of the robots", "ATE [m] (0 is perfect)", BOUNDS, (0.0, 0.01)),
    PlottedMeasure("motp_m", "Error of people's positions", "MOTP [m] (0 is perfect)", (("target_bound_m", "Cramér-Rao bound"),), (0.0, 0.1)),
    PlottedMeasure("efficiency", "Error of the robots relative to the bound", "ATE / Cramér-Rao bound (1 is perfect)", (), (0.0, 1.0)),
    PlottedMeasure("map_aligned_m", "Error of landmarks", "RMSE after alignment [m] (0 is perfect)", (), (0.0, 0.01)),
    PlottedMeasure("map_complete", "Landmarks mapped", "share of those seen often (1 is perfect)"),
    PlottedMeasure("mota_all", "All people, seen or not", "MOTA over all people", (("visible_recall", "bound: share seen by a camera"),)),
)


def plots_of(sweep: SweepRows, trackers: list[str]) -> list[Plot]:
    """Curves of all measures that are known, then the ablation and the causes of errors of each tracker."""
    curves = [curve for measure in MEASURES if (curve := _curve(sweep, measure, trackers))]
    present = [t for t in trackers if any(s.of(t) for s in sweep.settings)]
    return curves + [plot for t in present for plot in (*_ablations(sweep, t, len(present) > 1), *_causes(sweep, t, len(present) > 1))]


def overview(rows: Rows) -> list[Plot]:
    """Plots of the summary: the curve of the sweep with the largest effect on the first tracker, and the effect of every sweep."""
    found = findings(rows, rows.trackers[0])
    first: list[Plot] = []
    if found and (curve := _curve(found[0].sweep, MEASURES[0], rows.trackers)):
        title = "Largest effect" if found[0].fall else "Largest difference"
        first = [replace(curve, name=f"first-{curve.name}", title=f"{title}: {found[0].sweep.name}")]
    if len(found) < 2:
        return first
    spans = Spans(Line("easiest setting", tuple(f.high for f in found)), Line("hardest setting", tuple(f.low for f in found)))
    names = tuple(f.sweep.name for f in found)
    note = "Thin lines: 95 % intervals of the means."
    spanned = Plot("overview", "Effect of each sweep", names, "sweep", "MOTA (1 is perfect)", spans, False, (0.0, 1.0), note)
    return [*first, spanned]


def axis_of(sweep: SweepRows) -> str:
    """The label of the axis: the parameter, with its unit where the sweep is known."""
    known = KNOWN_SWEEPS.get(sweep.name)
    name = sweep.parameter.replace("_", " ")
    return f"{name} [{known.unit}]" if known and known.unit else name


def name_of(*parts: str) -> str:
    """A name for files and anchors, of letters, digits and hyphens."""
    return "-".join(re.sub(r"[^a-z0-9]+", "-", part.lower()).strip("-") or "x" for part in parts)


def _curve(sweep: SweepRows, measure: PlottedMeasure, trackers: list[str]) -> Plot | None:
    settings = sweep.ordered()
    lines = [Line(t, tuple(s.mean(t, measure.name) for s in settings)) for t in trackers]
    lines = [line for line in lines if any(line.points)]
    if not lines:
        return None
    # Bounds depend on the setting and not on the tracker: the first tracker that has them gives them.
    for name, label in measure.limits:
        points = tuple(next((mean for t in trackers if (mean := s.mean(t, name))), None) for s in settings)
        lines += [Line(label, points, limit=True)] if any(points) else []
    seeds = max(point.count for line in lines for point in line.points if point)
    note = f"Means over {seeds} seeds with 95 % intervals." if seeds > 1 else "One seed: no intervals."
    name, x = name_of(sweep.name, measure.name), tuple(s.value for s in settings)
    return Plot(name, measure.title, x, axis_of(sweep), measure.label, tuple(lines), sweep.numeric, measure.within, note)


def _ablations(sweep: SweepRows, tracker: str, several: bool) -> list[Plot]:
    plots = []
    for measure, title, label in (
        ("mota", "Loss of MOTA by stage", "MOTA lost"),
        ("metres", "Error of people by stage", "mean error of people found [m]"),
    ):
        settings = [s for s in sweep.ordered() if stages(s.of(tracker), measure)]
        if not settings:
            continue
        shares = [stages(s.of(tracker), measure) for s in settings]
        parts = {stage: tuple(share[stage].mean if stage in share else 0.0 for share in shares) for stage in STAGES}
        parts[REST] = tuple(_left(s, tracker, measure) for s in settings)
        x = tuple(s.value for s in settings)
        name = name_of(sweep.name, "ablation", measure, tracker)
        note = (
            "What perfect input to each stage would recover. Below zero it makes the result worse. The rest is lost even with perfect input to all."
        )
        plots.append(Plot(name, _titled(title, tracker, several), x, axis_of(sweep), label, Bars(parts, REST), note=note))
    return plots


def _left(setting: Setting, tracker: str, measure: str) -> float:
    """The mean loss that remains with perfect input to all stages, over the runs that have an ablation."""
    name = {"mota": "mota", "metres": "motp_m"}[measure]
    runs = [row for row in setting.of(tracker) if measure in row.ablation and name in row.scores and "total" in row.ablation[measure]]
    lost = [(1 - row.scores[name] if measure == "mota" else row.scores[name]) - row.ablation[measure]["total"] for row in runs]
    return float(np.mean(lost)) if lost else 0.0


def _causes(sweep: SweepRows, tracker: str, several: bool) -> list[Plot]:
    plots = []
    settings = [s for s in sweep.ordered() if s.of(tracker)]
    counts = [causes_of(s.of(tracker)) for s in settings]
    truths = [sum(row.scores.get("truths", 0.0) for row in s.of(tracker)) for s in settings]
    for kind in KINDS:
        # In the order of the rows, causes without errors too, so that a cause keeps its colour in all sweeps.
        names = list(dict.fromkeys(cause for s in settings for row in s.of(tracker) for cause in row.causes.get(kind, ())))
        present = [name for name in names if any(name in one.get(kind, ()) for one in counts)]
        if not present or not all(truths):
            continue
        parts = {name: tuple(100 * (one[kind][name] if kind in one else 0) / n for one, n in zip(counts, truths, strict=True)) for name in names}
        title = _titled(f"Causes of {kind}", tracker, several)
        x = tuple(s.value for s in settings)
        ending = ", by cause." if len(present) > 1 else f": {present[0]}."
        note = f"{kind.capitalize()} per 100 true positions{ending}"
        plots.append(Plot(name_of(sweep.name, kind, tracker), title, x, axis_of(sweep), f"{kind} per 100", Bars(parts), note=note))
    return plots


def _titled(title: str, tracker: str, several: bool) -> str:
    return f"{title} ({tracker})" if several else title
