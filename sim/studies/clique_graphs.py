"""The study of the graphs and starts of the clique search: two choices of the paper, each compared with its opposite.

The paper makes a small graph of each global hypothesis of the previous frame. The opposite is one graph of all tracks. The paper starts each search
with the tracks of the previous solution (warm). The opposite starts with the heaviest tracks (cold).

A run is made twice: once for its time and MOTA, and once to write its graphs, some of which are then solved exactly.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim.stress.bounds import clique_gap
from sim.studies.hypothesis_count import Material, resumed, time_and_mota
from tracker.geometry import Array
from tracker.io.atomic import new_file
from tracker.mht.global_hypothesis import searched_cliques
from tracker.pipeline import Parameters, track
from tracker.tracks.parameters import MhtParameters

FORMS = {"small graphs": 25, "one graph": 1}
"""Name of a form and its K_H."""
STARTS = {"warm": True, "cold": False}
PROVED = 50
"""Largest number of graphs of a run that are solved exactly. A tick may have forty graphs, and a proof takes up to a second."""
PANELS = ("processing time / s", "gap of weight / %", "MOTA")


@dataclass(frozen=True)
class Run:
    """One run.

    seconds: processor time. gap: the share of the largest weight that the chosen cliques lack, over the graphs with a proof. mota: at 1 m.
    """

    data: str
    form: str
    start: str
    repetition: int
    seconds: float
    gap: float
    mota: float

    @property
    def key(self) -> tuple[str, str, str, int]:
        """Data set, settings and repetition."""
        return self.data, self.form, self.start, self.repetition


def run_cell(material: Material, form: str, start: str, repetition: int) -> Run:
    """Run one cell by the search alone, without branch and bound. The gap is NaN where no graph has a proof."""
    many, solver = MhtParameters(k_h=FORMS[form], seed=repetition), partial(searched_cliques, warm=STARTS[start])
    seconds, mota = time_and_mota(material, many, solver)
    with tempfile.TemporaryDirectory(prefix="pilsim-graphs-") as folder:
        for _ in track(material.setup, material.ticks, Parameters(targets=many, graphs=Path(folder)), solver=solver):
            pass
        gap = clique_gap(Path(folder), PROVED)
    return Run(material.name, form, start, repetition, seconds, float("nan") if gap is None else gap, mota)


def study(out: Path, materials: list[Material], repetitions: int) -> Iterator[list[Run]]:
    """Run the cells that out/runs.csv does not hold. Yields all runs so far after each."""
    for material in materials:
        for form in FORMS:
            # Compilation must not count in the first run.
            list(track(material.setup, material.ticks[:3], Parameters(targets=MhtParameters(k_h=FORMS[form])), solver=searched_cliques))
        choices = ((form, start, repetition) for repetition, form, start in itertools.product(range(repetitions), FORMS, STARTS))
        yield from resumed(out / "runs.csv", Run, choices, partial(run_cell, material), material.name)


def panels(runs: list[Run]) -> Array:
    """(3, forms, starts, 3): seconds, gap and MOTA, each as mean, minimum and maximum over repetitions; NaN without runs."""
    out = np.full((3, len(FORMS), len(STARTS), 3), np.nan)
    for (a, form), (b, start) in itertools.product(enumerate(FORMS), enumerate(STARTS)):
        here = np.array([(r.seconds, r.gap, r.mota) for r in runs if (r.form, r.start) == (form, start)])
        if len(here):
            for panel, column in enumerate(here.T):
                known = column[np.isfinite(column)]
                if len(known):
                    out[panel, a, b] = known.mean(), known.min(), known.max()
    return out


def summary(runs: list[Run]) -> str:
    """A table for each data set with its summary."""
    lines = []
    for name in dict.fromkeys(r.data for r in runs):
        values = panels([r for r in runs if r.data == name])
        lines += [name, f"{'':24}{'seconds':>10}{'weight':>12}{'MOTA':>8}{'min':>8}{'max':>8}"]
        for (a, form), (b, start) in itertools.product(enumerate(FORMS), enumerate(STARTS)):
            seconds, gap, mota = values[:, a, b]
            weight = f"{1 - gap[0]:.5%}" if np.isfinite(gap[0]) else "no proof"
            lines.append(f"  {form + ', ' + start:22}{seconds[0]:>10.2f}{weight:>12}" + "".join(f"{m:>8.4f}" for m in mota))
        lines += [f"  {line}" for line in _comparisons(values)]
    return "\n".join(lines)


def _comparisons(values: Array) -> Iterator[str]:
    """A sentence for each choice. values: of `panels`.

    A difference of means is within the spread where it is no larger than the spread over repetitions, or there is one repetition only.
    """
    mean, spread = values[..., 0], values[..., 2] - values[..., 1]
    pairs = (
        ("small graphs against one graph", (slice(None), 0, 0), (slice(None), 1, 0)),
        ("a warm start against a cold one (small graphs)", (slice(None), 0, 0), (slice(None), 0, 1)),
        ("a warm start against a cold one (one graph)", (slice(None), 1, 0), (slice(None), 1, 1)),
    )
    for words, a, b in pairs:
        time, weight, mota = mean[a][0] / mean[b][0], mean[b][1] - mean[a][1], mean[a][2] - mean[b][2]
        widest = max(spread[a][2], spread[b][2])
        chance = " (within the spread)" if abs(mota) <= widest or widest == 0 else ""
        proved = f"{100 * weight:+.4f} points of weight" if np.isfinite(weight) else "weights without proof"
        yield f"{words}: {time:.2f} times the time, {proved}, {mota:+.4f} of MOTA{chance}"


def draw(runs: list[Run], path: Path) -> None:
    """Write a plot: for each data set processing time, gap of weight and MOTA.

    Bars and points are means; whiskers are minimum and maximum over repetitions.
    """
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(r.data for r in runs))
    figure = Figure(figsize=(12, 3.4 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), len(PANELS), squeeze=False)
    for row, name in enumerate(names):
        values = panels([r for r in runs if r.data == name])
        values[1] *= 100
        for axis, value, label in zip(axes[row], values, PANELS, strict=True):
            for b, start in enumerate(STARTS):
                _group(axis, value[:, b], 0.36 * (b - 0.5), (label, start))
            axis.set(xticks=range(len(FORMS)), xticklabels=list(FORMS), xlim=(-0.6, len(FORMS) - 0.4), ylabel=label, title=name)
            axis.grid(axis="y", alpha=0.3, zorder=0)
            axis.margins(y=0.25)
            if label != "MOTA":
                axis.set_ylim(bottom=0)
        axes[row, 0].legend(loc="upper right", ncols=2)
    with new_file(path) as part:
        figure.savefig(part, dpi=110)


def _group(axis: Any, value: Array, offset: float, names: tuple[str, str]) -> None:
    """Draw mean, minimum and maximum (forms, 3) of one start: bars, but points for MOTA, whose axis does not begin at 0."""
    label, start = names
    place, mean = np.arange(len(value)) + offset, value[:, 0]
    whiskers = np.maximum([mean - value[:, 1], value[:, 2] - mean], 0)
    if label == "MOTA":
        axis.errorbar(place, mean, whiskers, fmt="o", capsize=4, zorder=2)
    else:
        axis.bar(place, mean, 0.34, yerr=whiskers, capsize=4, label=f"{start} start", zorder=2)
    for x, y, top in zip(place, mean, value[:, 2], strict=True):
        if np.isfinite(y):
            text = f"{y:.4f}" if label == "MOTA" else f"{y:.3g}"
            axis.annotate(text, (x, top), (0, 5), textcoords="offset points", ha="center", fontsize=8)
