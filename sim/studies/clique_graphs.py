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

import numpy as np

from sim.stress.bounds import clique_gap
from sim.studies.hypothesis_count import Material, time_and_mota
from sim.studies.study_cells import Cells, StudyForm
from tracker.mht.global_hypothesis import searched_cliques
from tracker.pipeline import Parameters, track
from tracker.tracks.parameters import MhtParameters

FORMS = {"small graphs": 25, "one graph": 1}
"""Name of a form and its K_H."""
STARTS = {"warm": True, "cold": False}
PROVED = 50
"""Largest number of graphs of a run that are solved exactly. A tick may have forty graphs, and a proof takes up to a second."""


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


def run_cell(material: Material, form: str, start: str, repetition: int) -> Run:
    """Run one cell by the search alone, without branch and bound. The gap is NaN where no graph has a proof."""
    many, solver = MhtParameters(k_h=FORMS[form], seed=repetition), partial(searched_cliques, warm=STARTS[start])
    seconds, mota = time_and_mota(material, many, solver)
    with tempfile.TemporaryDirectory(prefix="pilsim-graphs-") as folder:
        for _ in track(material.setup, material.ticks, Parameters(targets=many, graphs=Path(folder)), solver=solver):
            pass
        gap = clique_gap(Path(folder), PROVED)
    return Run(material.name, form, start, repetition, seconds, float("nan") if gap is None else gap, mota)


def study(out: Path, materials: list[Material], repetitions: int) -> Iterator[Run]:
    """The cells of a study, of which out/runs.csv keeps what is done."""
    for material in materials:
        for form in FORMS:
            # Compilation must not count in the first run.
            list(track(material.setup, material.ticks[:3], Parameters(targets=MhtParameters(k_h=FORMS[form])), solver=searched_cliques))
        choices = ((material.name, form, start, repetition) for repetition, form, start in itertools.product(range(repetitions), FORMS, STARTS))
        yield from FORM.resumed(out, choices, lambda _, *choice, material=material: run_cell(material, *choice))


def _notes(cells: Cells) -> Iterator[str]:
    """A sentence for each choice.

    A difference of means is within the spread where it is no larger than the spread over repetitions, or there is one repetition only.
    """
    values = np.array([FORM.panel(cells, measure) for measure in FORM.measures])
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


MEASURES = {"seconds": "processing time / s", "gap": "missing share of the weight", "mota": "MOTA"}
FORM = StudyForm(Run, "runs.csv", {"form": "form", "start": "start"}, MEASURES, _notes)
