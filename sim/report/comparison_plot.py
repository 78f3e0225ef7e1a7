"""A plot of paired differences: for each setting the mean and its interval, beside the line of no difference."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure

from sim.report.comparison import EVERY, MEASURES, ComparedMeasure, PairedComparison
from sim.report.plots import MARKERS, PALETTE, STYLE, shortened
from tracker.io.atomic import new_file


def draw(found: PairedComparison, path: Path) -> None:
    """Write a PNG, under a temporary name first. Each measure has a panel, each setting a line, each tracker a colour. Right is better.

    Raises ValueError where no pair of runs has scores.
    """
    ids = list(dict.fromkeys(one.id for pair in found.pairs for one in pair.differences))
    if not ids:
        raise ValueError(f"{path}: no pair of runs has scores, so there is nothing to draw")
    with matplotlib.rc_context(STYLE):
        figure = matplotlib.figure.Figure(figsize=(13, 1.9 + 0.42 * len(ids) * max(1, 0.6 * len(found.pairs))), layout="constrained")
        figure.suptitle(f"Difference from {found.reference.name} with 95 % interval; filled: the interval excludes 0", fontsize=12, x=0.01, ha="left")
        panels = figure.subplots(1, len(MEASURES), sharey=True)
        for axes, measure in zip(panels, MEASURES, strict=True):
            _panel(axes, found, measure, ids)
        panels[0].set_yticks(range(len(ids)), [shortened(id) for id in ids])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_file(path) as part:
            figure.savefig(part, dpi=120, metadata={"Software": None})


def _panel(axes: Any, found: PairedComparison, measure: ComparedMeasure, ids: list[str]) -> None:
    axes.axvline(0, color="#222222", linewidth=1.2)
    axes.grid(axis="y", visible=False)
    for k, pair in enumerate(found.pairs):
        shift = 0.5 * ((k + 0.5) / len(found.pairs) - 0.5)
        style = {"color": PALETTE[k % len(PALETTE)], "marker": MARKERS[k % len(MARKERS)], "markersize": 7, "linestyle": "none"}
        axes.plot([], [], label=pair.tracker.name, **style)
        for one in pair.differences:
            if one.measure is measure:
                place, interval = ids.index(one.id) + shift, one.interval
                if interval.low is not None and interval.high is not None:
                    axes.hlines(place, interval.low, interval.high, color=style["color"], linewidth=3 if one.id == EVERY else 1.8)
                certain = one.verdict in ("better", "worse")
                axes.plot([interval.mean], [place], fillstyle="full" if certain else "none", markeredgewidth=1.8, **style)
    if not measure.more_is_better:
        axes.invert_xaxis()
    axes.set(title=measure.label, xlabel="worse ←   difference   → better")
