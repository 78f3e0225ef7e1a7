"""The study of K_H, the number of hypotheses that the MHT keeps, and i_bls^max, the limit of moves of its clique search.

Each cell is one run of the tracker with one seed of the search: processing time and MOTA.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from sim.studies.study_cells import Cells, StudyForm
from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PETS_VIEWS
from tracker.formats.source_options import SourceOptions
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.mht.global_hypothesis import CliqueSolver, searched_cliques
from tracker.pipeline import Parameters, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Setup, Tick, Truth, sequence

K_H = (1, 5, 10, 15, 20, 25, 30)
I_BLS_MAX = (500, 1000, 2000)
PEOPLE = 30
"""Number of people of the synthetic crowd. With fewer, the search finds nearly the same for all seeds."""
CLUTTER = 1.0
"""Mean number of false boxes of the synthetic crowd, per view and tick."""
DEGRADATION = "clutter=2"
"""Degradation of the detections of PETS 2009 (tracker/recordings/degradation.py). Graphs of the given detections are too small for a difference."""
WARM_UP = 30
"""Number of ticks that are tracked before the first timing. On PETS 2009, the first ten need no search."""


@dataclass(frozen=True, eq=False)
class Material:
    """A data set: its name, setup and ticks, and `frames`, which matches estimates (ids, positions) a tick with the truth."""

    name: str
    setup: Setup
    ticks: tuple[Tick, ...]
    frames: Callable[[list[tuple[np.ndarray, np.ndarray]]], list[MatchingFrame]]


@dataclass(frozen=True)
class Cell:
    """One run: processor time, s, and MOTA at 1 m."""

    data: str
    k_h: int
    i_bls_max: int
    repetition: int
    seconds: float
    mota: float


def check(folder: Path, videos: bool) -> None:
    """Raises ValueError where a PETS 2009 folder has no truth, or no videos where `videos` are needed."""
    _with_truth(folder, images=videos)


def _with_truth(folder: Path, degrade: str = "", images: bool = False) -> tuple[sequence.Sequence, tuple[Truth, ...]]:
    """A PETS 2009 sequence with degraded detections, and its truth. Raises ValueError where there is no truth."""
    sequence = open_sequence(folder, SourceOptions.parse((), degrade, cameras=",".join(map(str, PETS_VIEWS)), images=images))
    if sequence.truth is None:
        raise ValueError(f"{folder}: no annotations/*-cropped.xml")
    return sequence, sequence.truth


def pets(folder: Path, frames: int, degrade: str = "") -> Material:
    """The first frames of a PETS 2009 folder, views 1, 5 and 7, with degraded detections. Raises ValueError where there is no truth."""
    sequence, truth = _with_truth(folder, degrade)
    ticks = tuple(itertools.islice(iter(sequence.ticks), min(frames, len(truth))))

    def matching_frames(estimates: list[tuple[np.ndarray, np.ndarray]]) -> list[MatchingFrame]:
        return [MatchingFrame(t.person_id, t.feet[:, :2], ids, places[:, :2]) for t, (ids, places) in zip(truth, estimates, strict=False)]

    return Material(", ".join(filter(None, ("PETS S2.L1", degrade))), sequence.setup, ticks, matching_frames)


def synthetic(frames: int, seed: int = 0) -> Material:
    """A synthetic crowd of PEOPLE people among three fixed panoramas, with missed and false boxes."""
    rng = np.random.default_rng([seed, 4])
    setup, paths = synthetic_crowd.setup(), synthetic_crowd.paths(PEOPLE, frames, rng)
    ticks = tuple(synthetic_crowd.ticks(setup, paths, rng, clutter=CLUTTER))
    people = np.arange(PEOPLE)

    def matching_frames(estimates: list[tuple[np.ndarray, np.ndarray]]) -> list[MatchingFrame]:
        return [MatchingFrame(people, places, ids, found[:, :2]) for places, (ids, found) in zip(paths, estimates, strict=True)]

    return Material("synthetic crowd", setup, ticks, matching_frames)


def time_and_mota(material: Material, many: MhtParameters, solver: CliqueSolver) -> tuple[float, float]:
    """Track a data set: processor time, s, and MOTA at 1 m."""
    began = time.process_time()
    estimates = [(e.target_id, e.position) for e in track(material.setup, material.ticks, Parameters(targets=many), solver=solver)]
    seconds = time.process_time() - began
    return seconds, float(score(material.frames(estimates)).mota)


def study(out: Path, materials: list[Material], repetitions: int) -> Iterator[Cell]:
    """The cells of a study, of which out/cells.csv keeps what is done."""
    by_name = {material.name: material for material in materials}

    def run(data: str, k_h: int, i_bls_max: int, repetition: int) -> Cell:
        """Above K_H 1 a graph for each hypothesis, as in the paper, by the search without a proof of optimality."""
        many = MhtParameters(k_h=k_h, i_bls_max=i_bls_max, seed=repetition)
        return Cell(data, k_h, i_bls_max, repetition, *time_and_mota(by_name[data], many, searched_cliques))

    for material in materials:
        # Compilation must not count in the first cell.
        list(track(material.setup, material.ticks[:WARM_UP], Parameters(targets=MhtParameters(k_h=2)), solver=searched_cliques))
        choices = ((material.name, k, moves, repetition) for repetition, k, moves in itertools.product(range(repetitions), K_H, I_BLS_MAX))
        yield from FORM.resumed(out, choices, run)


def _notes(cells: Cells) -> Iterator[str]:
    """Whether time is linear in i_bls^max, and whether the spread of MOTA falls as K_H grows."""
    seconds, mota = FORM.panel(cells, "seconds")[..., 0], FORM.panel(cells, "mota")
    yield f"four times the moves cost {np.mean(seconds[:, -1] / seconds[:, 0]):.2f} times the time (4 would be in proportion)"
    first, second = np.diff(seconds, axis=1).mean(axis=0)
    yield f"moves 1001 to 2000 cost {second:.2f} s, moves 501 to 1000 {first:.2f} s (twice that would be a straight line)"
    if len(FORM.values(cells, "repetition")) < 2:
        yield "too few repetitions for a spread"
        return
    k, spread = np.array(FORM.values(cells, "k_h")), (mota[..., 2] - mota[..., 1]).mean(axis=1)
    falls = "falls" if _falls(k, spread) else "does not fall significantly"
    yield f"spread of MOTA (max − min) {falls} with K_H: {np.polyfit(k, spread, 1)[0]:+.5f} a hypothesis"


def _falls(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether y falls significantly with x: Spearman's rank correlation at 5 %."""
    if np.ptp(y) == 0:
        return False
    rank, chance = spearmanr(x, y)
    return bool(rank < 0 and chance < 0.05)


FORM = StudyForm(Cell, "cells.csv", {"k_h": "K_H", "i_bls_max": "i_bls^max"}, {"seconds": "processing time / s", "mota": "MOTA"}, _notes)
