"""Plots of a report, and those of each sweep. Curves with intervals, stacked bars and ranges, as SVG for the page and as PNG and CSV files.

A sweep has scores with their bounds, shares of the loss by stage, and causes of errors.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import matplotlib.ticker
import numpy as np

from sim.confidence_intervals import Interval
from sim.prediction import KINDS
from sim.report.findings import causes_of, findings, stages
from sim.report.rows import Rows, Setting, SweepRows
from sim.stress.ablation import STAGES
from sim.stress.sweeps import KNOWN_SWEEPS
from tracker.io.atomic import new_file

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D00", "#5B5B5B")
"""Colours of Okabe and Ito, which colour-blind readers can distinguish. Their yellow is darkened for white paper."""
REST = "#C8CCD2"
MARKERS = "osD^vPX*"
HATCHES = ("", "//", "\\\\", "xx", "--", "||", "++", "")
STYLE: Any = {
    "font.size": 11,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "hatch.linewidth": 0.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "pilsim",
}
SIZE = (4.7, 3.5)
"""Inches. Text of 11 points is then legible on a phone."""
LONGEST = 36
"""The greatest number of letters of a name on an axis."""
MOST_SLANTED, LEAST_APART = 8, 0.12
"""Most slanted labels of an axis, beyond which they are upright, and least distance of labelled numbers, a share of the axis."""


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


REMAINDER = "other"
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
        parts[REMAINDER] = tuple(_left(s, tracker, measure) for s in settings)
        x = tuple(s.value for s in settings)
        name = name_of(sweep.name, "ablation", measure, tracker)
        note = (
            "What perfect input to each stage would recover. Below zero it makes the result worse. The rest is lost even with perfect input to all."
        )
        plots.append(Plot(name, _titled(title, tracker, several), x, axis_of(sweep), label, Bars(parts, REMAINDER), note=note))
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


@dataclass(frozen=True, eq=False)
class Line:
    """Means with intervals along an axis. limit: whether the line is a bound, which is drawn dashed."""

    name: str
    points: tuple[Interval | None, ...]
    limit: bool = False


@dataclass(frozen=True, eq=False)
class Bars:
    """Shares that are stacked at each value of the axis: name → one share for each value. rest: the name of the remainder, drawn in grey."""

    parts: dict[str, tuple[float, ...]]
    rest: str = ""


@dataclass(frozen=True, eq=False)
class Spans:
    """Horizontal ranges between two means, one for each value of the axis."""

    high: Line
    low: Line


@dataclass(frozen=True, eq=False)
class Plot:
    """A plot: the name of its files, its title and labels, the values along the x axis, and what is drawn.

    numeric: whether the values are numbers, otherwise names. within: the range that the score axis shows at least. note: the caption.
    """

    name: str
    title: str
    x: tuple[Any, ...]
    x_label: str
    y_label: str
    drawn: tuple[Line, ...] | Bars | Spans
    numeric: bool = True
    within: tuple[float, float] | None = None
    note: str = ""

    @property
    def lines(self) -> tuple[Line, ...]:
        """All lines of means; none in a plot of bars."""
        return () if isinstance(self.drawn, Bars) else (self.drawn.high, self.drawn.low) if isinstance(self.drawn, Spans) else self.drawn

    def rows(self) -> list[list[Any]]:
        """The data as a table with a head: value, series, mean, low, high, seeds; or value, part, amount."""
        if isinstance(self.drawn, Bars):
            body = [[x, part, values[k]] for part, values in self.drawn.parts.items() for k, x in enumerate(self.x)]
            return [[self.x_label, "part", self.y_label], *body]
        rows: list[list[Any]] = [[self.x_label, "series", "mean", "low", "high", "seeds"]]
        for line in self.lines:
            rows += [[x, line.name, p.mean, p.low, p.high, p.count] for x, p in zip(self.x, line.points, strict=True) if p is not None]
        return rows

    def in_words(self) -> str:
        """The data in words, for readers who do not see the plot."""
        if isinstance(self.drawn, Bars):
            pairs = {part: zip(self.x, values, strict=True) for part, values in self.drawn.parts.items()}
            said = [f"{part}: " + ", ".join(f"{x}: {value:.3g}" for x, value in pair) for part, pair in pairs.items()]
        else:
            said = [
                f"{line.name}: " + ", ".join(f"{x}: {p.text()}" for x, p in zip(self.x, line.points, strict=True) if p is not None)
                for line in self.lines
            ]
        return f"{self.title}, by {self.x_label}. " + "; ".join(said) + "."


def save(plot: Plot, folder: Path) -> str:
    """Write NAME.png and NAME.csv into a folder, each under a temporary name first. Returns the plot as an SVG element."""
    with matplotlib.rc_context(STYLE):
        figure = _figure(plot)
        # The layout is computed once for both files.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        picture, vector = io.BytesIO(), io.StringIO()
        figure.savefig(picture, format="png", dpi=130, metadata={"Software": None})
        figure.savefig(vector, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(plot.rows())
    for ending, data in (("png", picture.getvalue()), ("csv", table.getvalue().encode())):
        with new_file(folder / f"{plot.name}.{ending}") as part:
            part.write_bytes(data)
    return inline(vector.getvalue(), plot.name)


def inline(svg: str, name: str) -> str:
    """An SVG file as an element of a page: without prolog and fixed size, with ids that begin with `name`."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1), count=1)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = svg.replace(' xmlns:xlink="http://www.w3.org/1999/xlink"', "").replace("xlink:href", "href")
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    # A reader may not have matplotlib's font, so the page's font family is used.
    svg = re.sub(r"(font: [^;\"]*?px) [^;\"]*|font-family: [^;\"]*", lambda found: f"{found[1] or 'font-family:'} sans-serif", svg)
    svg = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", svg, count=1, flags=re.DOTALL)
    # Coordinates are rounded to hundredths of a point. Text between elements is not changed.
    svg = re.sub(r"<[^>]+>", lambda element: re.sub(r"(\.\d\d)\d+", r"\1", element[0]), svg)
    return re.sub(r"\n\s*", "\n", svg).strip()


def _figure(plot: Plot) -> matplotlib.figure.Figure:
    drawn, sideways = plot.drawn, isinstance(plot.drawn, Spans)
    height = max(1.5 + 0.32 * len(plot.x), 2.2) if sideways else SIZE[1] if plot.numeric else SIZE[1] + max(0, _longest(plot) - 14) / 20
    figure = matplotlib.figure.Figure(figsize=(SIZE[0], height), layout="constrained")
    axes = figure.add_subplot()
    axes.set(title=plot.title, xlabel=plot.y_label if sideways else plot.x_label, ylabel="" if sideways else plot.y_label)
    if isinstance(drawn, Bars):
        handles = _bars(axes, plot, drawn)
    else:
        handles = _spans(axes, plot, drawn) if isinstance(drawn, Spans) else _lines(axes, plot, drawn)
    if plot.within:
        low, high = axes.get_xlim() if sideways else axes.get_ylim()
        limits = low if low < plot.within[0] - 0.06 else plot.within[0], max(plot.within[1] + 0.03 * (plot.within[1] - plot.within[0]), high)
        (axes.set_xlim if sideways else axes.set_ylim)(limits)
    if len(handles) > 1:
        figure.legend(handles=handles, loc="outside lower left", ncols=2, fontsize=9.5, frameon=False, handlelength=1.8)
    return figure


def _spans(axes: Any, plot: Plot, spans: Spans) -> list[Any]:
    places = np.arange(len(plot.x), dtype=np.float64)[::-1]
    axes.set_yticks(places, [shortened(x) for x in plot.x])
    axes.set_ylim(-0.6, len(plot.x) - 0.4)
    axes.grid(axis="y", visible=False)
    axes.hlines(places, [p.mean for p in spans.low.points if p], [p.mean for p in spans.high.points if p], color="#888888", linewidth=2.5)
    handles = []
    for k, line in enumerate((spans.high, spans.low)):
        style = {"color": PALETTE[k], "marker": "os"[k], "markersize": (9, 6)[k], "fillstyle": ("none", "full")[k]}
        for place, point in zip(places, line.points, strict=True):
            if point and point.low is not None and point.high is not None:
                axes.hlines(place + (0.16, -0.16)[k], point.low, point.high, color=PALETTE[k], linewidth=1.2)
        handles += axes.plot([p.mean for p in line.points if p], places, linestyle="none", markeredgewidth=2, label=line.name, **style)
    return handles


def _longest(plot: Plot) -> int:
    return max(len(shortened(x)) for x in plot.x)


def _places(axes: Any, plot: Plot) -> np.ndarray:
    """Positions of the values along the axis. Sets the scale and the ticks; the scale is logarithmic where numbers span a factor of 8."""
    if not plot.numeric:
        axes.set_xticks(range(len(plot.x)), [shortened(x) for x in plot.x])
        axes.margins(x=0.1)
        if _longest(plot) * len(plot.x) > 34:
            upright = len(plot.x) > MOST_SLANTED
            axes.tick_params(axis="x", rotation=90 if upright else 30)
            for label in axes.get_xticklabels():
                label.set_horizontalalignment("center" if upright else "right")
        return np.arange(len(plot.x), dtype=np.float64)
    places = np.array(plot.x, dtype=np.float64)
    logarithmic = len(places) > 1 and places.min() > 0 and places.max() / places.min() >= 8
    if logarithmic:
        axes.set_xscale("log")
    scale = np.log(places) if logarithmic else places
    span, last, ticks = max(float(np.ptp(scale)), 1e-12), -np.inf, []
    for place, at in zip(places, scale, strict=True):
        if at - last >= LEAST_APART * span:
            ticks.append(place)
            last = at
    axes.set_xticks(ticks, [f"{place:g}" for place in ticks])
    axes.xaxis.set_minor_locator(matplotlib.ticker.NullLocator())
    return places


def _lines(axes: Any, plot: Plot, lines: tuple[Line, ...]) -> list[Any]:
    places = _places(axes, plot)
    own = limits = 0
    handles = []
    for line in lines:
        known = [k for k, point in enumerate(line.points) if point is not None]
        points = [line.points[k] for k in known]
        at = places[known]
        mean = np.array([p.mean for p in points if p])
        if line.limit:
            handles += axes.plot(at, mean, color="#222222", linestyle=("--", ":", "-.")[limits % 3], linewidth=1.4, label=line.name)
            limits += 1
            continue
        low = np.array([p.mean if p.low is None else p.low for p in points if p])
        high = np.array([p.mean if p.high is None else p.high for p in points if p])
        colour = PALETTE[own % len(PALETTE)]
        if plot.numeric:
            axes.fill_between(at, low, high, color=colour, alpha=0.18, linewidth=0)
        drawn = axes.errorbar(
            at, mean, np.clip([mean - low, high - mean], 0, None), color=colour, marker=MARKERS[own % len(MARKERS)], markersize=5,
            linestyle="-" if plot.numeric else "none", linewidth=2, elinewidth=1.2, capsize=3, label=line.name,
        )  # fmt: skip
        handles.append(drawn)
        own += 1
    return handles


def _bars(axes: Any, plot: Plot, bars: Bars) -> list[Any]:
    places = np.arange(len(plot.x), dtype=np.float64)
    _places(axes, Plot(plot.name, "", tuple(shortened(x) for x in plot.x), "", "", bars, numeric=False))
    axes.grid(axis="x", visible=False)
    # Negative amounts are stacked downwards, so that no bar hides another.
    up, down = np.zeros(len(places)), np.zeros(len(places))
    handles = []
    for k, (name, values) in enumerate(bars.parts.items()):
        amounts = np.array(values)
        if not amounts.any():
            continue  # k still counts it, so every part keeps its colour in all plots
        bottom = np.where(amounts >= 0, up, down)
        colour, hatch = (REST, "") if name == bars.rest else (PALETTE[k % len(PALETTE)], HATCHES[k % len(HATCHES)])
        style = {"color": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.6}
        drawn = axes.bar(places, amounts, 0.72, bottom, label=name, **style)
        handles.append(drawn)
        up, down = up + np.clip(amounts, 0, None), down + np.clip(amounts, None, 0)
    axes.axhline(0, color="#444444", linewidth=0.8)
    return handles


def shortened(value: Any) -> str:
    """A value as the axis shows it, at most LONGEST letters."""
    text = f"{value:g}" if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
