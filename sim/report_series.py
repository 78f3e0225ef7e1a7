"""What is plotted of each sweep: scores with their limits, shares of the loss, causes of errors."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from sim.intervals import Interval, mean_interval
from sim.report_plots import Bars, Line, Plot, Spans
from sim.report_rows import KINDS, STAGES, Rows, Setting, Sweep
from sim.report_words import causes_of, findings, stages
from sim.stress import SWEEPS


@dataclass(frozen=True)
class Measure:
    """A score that gets a curve: its name in the rows, title, label; limits: name in the rows → what its line is called."""

    name: str
    title: str
    label: str
    limits: tuple[tuple[str, str], ...] = ()
    within: tuple[float, float] = (0.0, 1.0)


REST = "none of them"
BOUNDS = (("dead_reckoning_m", "by wheels alone"), ("ate_bound_m", "Cramér-Rao bound"))
MEASURES = (
    Measure("mota", "People followed", "MOTA (1 is perfect)"),
    Measure("idf1", "Identities kept", "IDF1 (1 is perfect)"),
    Measure("ate_m", "Robots' places", "ATE [m] (0 is perfect)", BOUNDS, (0.0, 0.01)),
    Measure("motp_m", "People's places", "MOTP [m] (0 is perfect)", (("target_bound_m", "Cramér-Rao bound"),), (0.0, 0.1)),
    Measure("efficiency", "Robots' places beside what is possible", "ATE over the Cramér-Rao bound (1 is perfect)", (), (0.0, 1.0)),
    Measure("map_aligned_m", "Landmarks' places", "RMSE after alignment [m] (0 is perfect)", (), (0.0, 0.01)),
    Measure("map_complete", "Landmarks mapped", "share of those seen often (1 is perfect)"),
    Measure("mota_all", "Everybody, seen or not", "MOTA over everybody", (("visible_recall", "limit: share seen by robots"),)),
)


def plots_of(sweep: Sweep, trackers: list[str]) -> list[Plot]:
    """Curves of all measures that are known, then the ladder and the causes of each tracker."""
    curves = [curve for measure in MEASURES if (curve := _curve(sweep, measure, trackers))]
    present = [t for t in trackers if any(s.of(t) for s in sweep.settings)]
    return curves + [plot for t in present for plot in (*_ladders(sweep, t, len(present) > 1), *_causes(sweep, t, len(present) > 1))]


def overview(rows: Rows) -> list[Plot]:
    """For the summary: the curve of the sweep that hurts the first tracker most; and where there are several, what each sweep costs."""
    found = findings(rows, rows.trackers[0])
    first: list[Plot] = []
    if found and (curve := _curve(found[0].sweep, MEASURES[0], rows.trackers)):
        title = "What hurts most" if found[0].fall else "Largest difference"
        first = [replace(curve, name=f"first-{curve.name}", title=f"{title}: {found[0].sweep.name}")]
    if len(found) < 2:
        return first
    spans = Spans(Line("easiest setting", tuple(f.high for f in found)), Line("hardest setting", tuple(f.low for f in found)))
    names = tuple(f.sweep.name for f in found)
    note = "Thin lines: 95 % intervals of the means."
    spanned = Plot("overview", "What each sweep costs", names, "sweep", "MOTA (1 is perfect)", spans, False, (0.0, 1.0), note)
    return [*first, spanned]


def axis_of(sweep: Sweep) -> str:
    """The parameter with its unit, where the sweep is one of ours."""
    known = SWEEPS.get(sweep.name)
    name = sweep.parameter.replace("_", " ")
    return f"{name} [{known.unit}]" if known and known.unit else name


def name_of(*parts: str) -> str:
    """A name for files and anchors."""
    return "-".join(re.sub(r"[^a-z0-9]+", "-", part.lower()).strip("-") or "x" for part in parts)


def _curve(sweep: Sweep, measure: Measure, trackers: list[str]) -> Plot | None:
    settings = sweep.ordered()
    lines = [Line(t, tuple(_mean(s, t, measure.name) for s in settings)) for t in trackers]
    lines = [line for line in lines if any(line.points)]
    if not lines:
        return None
    # Limits belong to the place and not to the tracker: those of the first that has them.
    for name, label in measure.limits:
        points = tuple(_limit(s, trackers, name) for s in settings)
        lines += [Line(label, points, limit=True)] if any(points) else []
    seeds = max(point.count for line in lines for point in line.points if point)
    note = f"Means over {seeds} seeds with 95 % intervals." if seeds > 1 else "One seed: no intervals."
    name, x = name_of(sweep.name, measure.name), tuple(s.value for s in settings)
    return Plot(name, measure.title, x, axis_of(sweep), measure.label, tuple(lines), sweep.numeric, measure.within, note)


def _mean(setting: Setting, tracker: str, name: str) -> Interval | None:
    values = list(setting.scores(tracker, name).values())
    return mean_interval(values) if values else None


def _limit(setting: Setting, trackers: list[str], name: str) -> Interval | None:
    return next((mean for t in trackers if (mean := _mean(setting, t, name))), None)


def _ladders(sweep: Sweep, tracker: str, several: bool) -> list[Plot]:
    plots = []
    for measure, title, label in (
        ("mota", "Which part loses MOTA", "MOTA lost"),
        ("metres", "Which part puts people off", "mean error of people found [m]"),
    ):
        settings = [s for s in sweep.ordered() if stages(s.of(tracker), measure)]
        if not settings:
            continue
        shares = [stages(s.of(tracker), measure) for s in settings]
        parts = {stage: tuple(share[stage].mean if stage in share else 0.0 for share in shares) for stage in STAGES}
        parts[REST] = tuple(_left(s, tracker, measure) for s in settings)
        x = tuple(s.value for s in settings)
        name = name_of(sweep.name, "ladder", measure, tracker)
        note = (
            "What perfect input to each part would win back; below zero, it would make things worse; last, what would be lost in spite of all four."
        )
        plots.append(Plot(name, _titled(title, tracker, several), x, axis_of(sweep), label, Bars(parts, REST), note=note))
    return plots


def _left(setting: Setting, tracker: str, measure: str) -> float:
    """What is lost with perfect input to all stages: the mean loss of the runs that have a ladder, less what all stages own."""
    name = {"mota": "mota", "metres": "motp_m"}[measure]
    runs = [row for row in setting.of(tracker) if measure in row.ladder and name in row.scores and "total" in row.ladder[measure]]
    lost = [(1 - row.scores[name] if measure == "mota" else row.scores[name]) - row.ladder[measure]["total"] for row in runs]
    return mean_interval(lost).mean if lost else 0.0


def _causes(sweep: Sweep, tracker: str, several: bool) -> list[Plot]:
    plots = []
    settings = [s for s in sweep.ordered() if s.of(tracker)]
    counts = [causes_of(s.of(tracker)) for s in settings]
    truths = [sum(row.scores.get("truths", 0.0) for row in s.of(tracker)) for s in settings]
    for kind in KINDS:
        # In the order of the rows, those of which there are none too: a cause keeps its colour in all sweeps.
        names = list(dict.fromkeys(cause for s in settings for row in s.of(tracker) for cause in row.causes.get(kind, ())))
        present = [name for name in names if any(name in one.get(kind, ()) for one in counts)]
        if not present or not all(truths):
            continue
        parts = {name: tuple(100 * (one[kind][name] if kind in one else 0) / n for one, n in zip(counts, truths, strict=True)) for name in names}
        title = _titled(f"Why: {kind}", tracker, several)
        x = tuple(s.value for s in settings)
        said = ", by cause." if len(present) > 1 else f": {present[0]}."
        note = f"{kind.capitalize()} for every 100 times that a person was there to be followed{said}"
        plots.append(Plot(name_of(sweep.name, kind, tracker), title, x, axis_of(sweep), f"{kind} per 100", Bars(parts), note=note))
    return plots


def _titled(title: str, tracker: str, several: bool) -> str:
    return f"{title} ({tracker})" if several else title
