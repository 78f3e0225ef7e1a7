"""The study of K_H, the number of hypotheses that the MHT keeps, and i_bls^max, the limit of moves of its clique search.

Each cell of the study is one run of the tracker with one seed of the search: processing time and MOTA. `cells.csv` is written atomically after each
cell. Cells that it holds are not run again.
"""

from __future__ import annotations

import csv
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar, get_type_hints

import numpy as np
from scipy.stats import spearmanr

from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PETS_VIEWS
from tracker.formats.source_options import SourceOptions
from tracker.io.atomic import new_file
from tracker.io.text_files import read_lines
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.mht.global_hypothesis import CliqueSolver, searched_cliques
from tracker.pipeline import Parameters, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Setup, Tick, Truth, sequence


class Keyed(Protocol):
    """A cell of a study."""

    @property
    def key(self) -> tuple[Any, ...]:
        """The unique key of a cell: its data set and settings."""


Row = TypeVar("Row", bound=Keyed)
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

    @property
    def key(self) -> tuple[str, int, int, int]:
        """Data set, settings and repetition."""
        return self.data, self.k_h, self.i_bls_max, self.repetition


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


def run_cell(material: Material, k_h: int, i_bls_max: int, repetition: int) -> Cell:
    """Run one cell: above K_H 1 a graph for each hypothesis, as in the paper, by the search without a proof of optimality."""
    many = MhtParameters(k_h=k_h, i_bls_max=i_bls_max, seed=repetition)
    return Cell(material.name, k_h, i_bls_max, repetition, *time_and_mota(material, many, searched_cliques))


def time_and_mota(material: Material, many: MhtParameters, solver: CliqueSolver) -> tuple[float, float]:
    """Track a data set: processor time, s, and MOTA at 1 m."""
    began = time.process_time()
    estimates = [(e.target_id, e.position) for e in track(material.setup, material.ticks, Parameters(targets=many), solver=solver)]
    seconds = time.process_time() - began
    return seconds, float(score(material.frames(estimates)).mota)


def read_cells(path: Path, kind: type[Row]) -> list[Row]:
    """The cells of a file, none where there is no file. Raises ValueError naming the line that is no cell.

    kind: a dataclass of texts and numbers.
    """
    if not path.is_file():
        return []
    columns = get_type_hints(kind)
    lines = read_lines(path)
    names = next((line.split(",") for _, line in lines), [])
    out = []
    for number, line in lines:
        row = dict(zip(names, next(csv.reader([line])), strict=False))
        try:
            out.append(kind(**{name: column(row[name]) for name, column in columns.items()}))
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{path}:line {number}: is no cell, needs {', '.join(columns)}") from None
    return out


def write_cells(path: Path, cells: Sequence[Any]) -> None:
    """Write all cells atomically."""
    with new_file(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(get_type_hints(type(cells[0]))))
        writer.writeheader()
        writer.writerows(asdict(cell) for cell in cells)


def study(out: Path, materials: list[Material], repetitions: int) -> Iterator[list[Cell]]:
    """Run the cells that out/cells.csv does not hold. Yields all cells so far after each."""
    for material in materials:
        # Compilation must not count in the first cell.
        list(track(material.setup, material.ticks[:WARM_UP], Parameters(targets=MhtParameters(k_h=2)), solver=searched_cliques))
        choices = ((k, moves, repetition) for repetition, k, moves in itertools.product(range(repetitions), K_H, I_BLS_MAX))
        yield from resumed(out / "cells.csv", Cell, choices, partial(run_cell, material), material.name)


def resumed(path: Path, kind: type[Row], choices: Iterable[tuple[Any, ...]], run: Callable[..., Row], data: str) -> Iterator[list[Row]]:
    """Run the choices that the file does not hold. Yields all cells so far after each choice, those of the file first.

    The key of a cell is `data`, the name of its data set, and its choice.
    """
    cells = read_cells(path, kind)
    done = {cell.key for cell in cells}
    for choice in choices:
        if (data, *choice) not in done:
            cells.append(run(*choice))
            write_cells(path, cells)
        yield cells


def summary(cells: list[Cell]) -> str:
    """A table with its summary: whether time is linear in i_bls^max, and whether the spread of MOTA falls as K_H grows."""
    lines = []
    for name in dict.fromkeys(c.data for c in cells):
        seconds, mota, spread = panels([c for c in cells if c.data == name])
        lines += [f"{name}: processing time, MOTA (its max − min)", f"{'K_H':>5}" + "".join(f"{f'i_max {m}':>28}" for m in I_BLS_MAX)]
        for r, k in enumerate(K_H):
            cells_of = [f"{seconds[r, c]:7.2f} s {mota[r, c]:.4f} ({spread[r, c]:.4f})" for c in range(len(I_BLS_MAX))]
            lines.append(f"{k:>5}" + "".join(f"{text:>28}" for text in cells_of))
        growth = np.nanmean(seconds[:, -1] / seconds[:, 0])
        lines.append(f"  four times the moves cost {growth:.2f} times the time (4 would be in proportion)")
        first, second = np.nanmean(np.diff(seconds, axis=1), axis=0)
        lines.append(f"  moves 1001 to 2000 cost {second:.2f} s, moves 501 to 1000 {first:.2f} s (twice that would be a straight line)")
        whole = np.isfinite(spread).all(axis=1)
        if whole.sum() < 3:
            lines.append("  too few repetitions for a spread")
            continue
        slope = np.polyfit(np.array(K_H)[whole], spread[whole].mean(axis=1), 1)[0]
        falls = "falls" if _falls(np.array(K_H)[whole], spread[whole].mean(axis=1)) else "does not fall significantly"
        lines.append(f"  spread of MOTA (max − min) {falls} with K_H: {slope:+.5f} a hypothesis")
    return "\n".join(lines)


def _falls(x: np.ndarray, y: np.ndarray) -> bool:
    """Whether y falls significantly with x: Spearman's rank correlation at 5 %."""
    if np.ptp(y) == 0:
        return False
    rank, chance = spearmanr(x, y)
    return bool(rank < 0 and chance < 0.05)


def panels(cells: list[Cell]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean time, mean MOTA and its max − min over repetitions, each (K_H, I_BLS_MAX). NaN without runs, and max − min for one run."""
    out = np.full((3, len(K_H), len(I_BLS_MAX)), np.nan)
    for r, c in np.ndindex(len(K_H), len(I_BLS_MAX)):
        here = [x for x in cells if (x.k_h, x.i_bls_max) == (K_H[r], I_BLS_MAX[c])]
        if here:
            mota = [x.mota for x in here]
            out[:, r, c] = np.mean([x.seconds for x in here]), np.mean(mota), max(mota) - min(mota) if len(mota) > 1 else np.nan
    return out[0], out[1], out[2]


def draw(cells: list[Cell], path: Path) -> None:
    """Write a plot: for each data set processing time, MOTA and spread of MOTA against K_H, a line for each i_bls^max."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(c.data for c in cells))
    figure = Figure(figsize=(12, 3.4 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 3, squeeze=False)
    for row, name in enumerate(names):
        values = panels([c for c in cells if c.data == name])
        for axis, value, label in zip(axes[row], values, ("processing time / s", "MOTA", "spread of MOTA (max − min)"), strict=True):
            for c, moves in enumerate(I_BLS_MAX):
                axis.plot(K_H, value[:, c], marker="o", ms=4, label=f"$i_{{bls}}^{{max}}$ = {moves}")
            axis.set(xlabel="$K_H$", ylabel=label, title=name)
            axis.ticklabel_format(useOffset=False)
            axis.grid(alpha=0.3)
        axes[row, 0].set_ylim(bottom=0)
        axes[row, 0].legend()
    with new_file(path) as part:
        figure.savefig(part, dpi=110)
