"""`pilsim study`: studies of the paper's parameters: number of hypotheses, graphs of the clique search, and image tracklets.

A study is a StudyForm: settings with their values, and the measures of a run. A cell is one run with one seed, made once and kept in a CSV file.
"""

from __future__ import annotations

import csv
import itertools
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from sim.recording.record import record
from sim.scenario import Scenario
from sim.stress.bounds import clique_gap
from tracker.datasets import synthetic_crowd
from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PETS_VIEWS
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.io.atomic import new_file
from tracker.io.text_files import read_lines
from tracker.metrics.clear_mot import TargetScore, score
from tracker.metrics.evaluation import matching_frames
from tracker.mht.global_hypothesis import CliqueSolver, searched_cliques
from tracker.pipeline import Parameters, track
from tracker.sequence.reader import read_sequence
from tracker.tracks.parameters import MhtParameters
from tracker.types import Sequence, TicksInMemory, Truth
from tracker.types.truth import evaluated_people

PEOPLE, CLUTTER = 30, 1.0
"""People of the synthetic crowd, and its false boxes per view and tick. With fewer people, the search finds nearly the same for all seeds."""
DEGRADATION = "clutter=2"
"""Degradation of the detections of PETS 2009 (tracker/recordings/degradation.py). Graphs of the given detections are too small to differ."""
WARM_UP = 30
"""Number of ticks that are tracked before the first timing. On PETS 2009, the first ten need no search."""
FORMS = {"small graphs": 25, "one graph": 1}
"""Name of a form of graphs and its K_H."""
STARTS = {"warm": True, "cold": False}
PROVED = 50
"""Largest number of graphs of a run that are solved exactly. A tick may have forty graphs, and a proof takes up to a second."""
PAPER = TrackletParameters()
TRACKLETS: dict[str, TrackletParameters | None] = {
    "no images": None,
    "the paper's": PAPER,
    "L_c = 1": replace(PAPER, l_c=1),
    "L_c = 8": replace(PAPER, l_c=8),
    "δ_min = 0.5 px": replace(PAPER, delta_min=0.5),
    "ω = 0.1": replace(PAPER, omega=0.1),
    "ω = 0.6": replace(PAPER, omega=0.6),
}
DROPPED = "drop=0.5"
"""Degradation of the detections of PETS 2009 in the study of image tracklets, beside the given ones."""
CROWD = Scenario(robots=2, people=20, width=768)
"""The rendered scenario of image tracklets. Each repetition has another seed."""
DELAY = 10


@dataclass(frozen=True)
class Cell:
    """One run: data set, settings and repetition, and its measures, in the order of the study."""

    data: str
    settings: tuple[Any, ...]
    repetition: int
    measured: tuple[float, ...]


Cells = list[Cell]


@dataclass(frozen=True, eq=False)
class Material:
    """A data set. sequence: repetition → sequence with truth, of which `frames` frames are used. most: number of repetitions that differ."""

    name: str
    sequence: Callable[[int], Sequence]
    frames: int
    most: int = 1 << 30

    def tracked(
        self, sequence: Sequence, parameters: Parameters, solver: CliqueSolver | None = None, everybody: bool = True
    ) -> tuple[float, TargetScore]:
        """Track the sequence. Returns processor time, s, and scores at 1 m. everybody: whether people whom no view showed lately count, too."""
        assert sequence.truth is not None
        began = time.process_time()
        ticks = itertools.islice(iter(sequence.ticks), self.frames)
        estimates = list(track(sequence.setup, ticks, parameters, solver=solver))
        seconds = time.process_time() - began
        truth = sequence.truth[: len(estimates)]
        people, tracks = {t.index: (t.person_id, t.feet) for t in truth}, {e.index: (e.target_id, e.position) for e in estimates}
        return seconds, score(matching_frames(people, tracks, None if everybody else evaluated_people(truth, sequence.setup.period)))


@dataclass(frozen=True, eq=False)
class StudyForm:
    """A study.

    file: of the cells. settings: name → title and values; the first is the x axis. measures: name → title. warm_up: K_H of the runs that compile.
    run: measures a material for a repetition and settings. notes: lines about the cells of one data set.
    materials: data sets for a folder of recordings, a PETS 2009 folder or None, and a number of frames. people: of the simulated crowd.
    """

    file: str
    settings: dict[str, tuple[str, tuple[Any, ...]]]
    measures: dict[str, str]
    run: Callable[..., tuple[float, ...]]
    notes: Callable[[StudyForm, Cells], Iterable[str]]
    materials: Callable[[Path, Path | None, int], list[Material]]
    people: int
    warm_up: tuple[int, ...] = ()

    def count(self, materials: list[Material], repetitions: int) -> int:
        """The number of cells."""
        return sum(len(list(self._choices(material, repetitions))) for material in materials)

    def _choices(self, material: Material, repetitions: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
        values = itertools.product(*(values for _, values in self.settings.values()))
        return itertools.product(range(min(repetitions, material.most)), list(values))

    def cells(self, folder: Path, materials: list[Material], repetitions: int) -> Iterator[Cell]:
        """All cells: read from the file in the folder, or run now and written. Raises ValueError naming the line that is no cell."""
        path = folder / self.file
        known = {(cell.data, cell.settings, cell.repetition): cell for cell in self.read(path)}
        for material in materials:
            missing = any((material.name, settings, repetition) not in known for repetition, settings in self._choices(material, repetitions))
            for k_h in self.warm_up if missing else ():
                # Compilation must not count in the first cell.
                replace(material, frames=WARM_UP).tracked(material.sequence(0), Parameters(targets=MhtParameters(k_h=k_h)), searched_cliques)
            for repetition, settings in self._choices(material, repetitions):
                key = material.name, settings, repetition
                if key not in known:
                    known[key] = Cell(*key, self.run(material, repetition, *settings))
                    self.write(path, list(known.values()))
                yield known[key]

    def read(self, path: Path) -> Cells:
        """The cells of a file, none where there is no file. Raises ValueError naming the line that is no cell."""
        lines = read_lines(path) if path.is_file() else iter(())
        names, out = next((line.split(",") for _, line in lines), []), []
        for number, line in lines:
            row = dict(zip(names, next(csv.reader([line])), strict=False))
            try:
                settings = tuple(type(values[0])(row[name]) for name, (_, values) in self.settings.items())
                out.append(Cell(row["data"], settings, int(row["repetition"]), tuple(float(row[name]) for name in self.measures)))
            except (KeyError, TypeError, ValueError):
                columns = ", ".join(("data", *self.settings, "repetition", *self.measures))
                raise ValueError(f"{path}:line {number}: is no cell, needs {columns}") from None
        return out

    def write(self, path: Path, cells: Cells) -> None:
        """Write all cells atomically."""
        with new_file(path) as part, part.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("data", *self.settings, "repetition", *self.measures))
            writer.writerows((cell.data, *cell.settings, cell.repetition, *cell.measured) for cell in cells)

    def values(self, cells: Cells) -> list[list[Any]]:
        """Distinct values of each setting, in the order of the cells."""
        return [list(dict.fromkeys(column)) for column in zip(*(cell.settings for cell in cells), strict=True)]

    def panel(self, cells: Cells, measure: str) -> Array:
        """Mean, minimum and maximum over repetitions: (values of a setting, ..., 3); NaN where nothing is finite."""
        names, column = self.values(cells), list(self.measures).index(measure)
        out = np.full((*map(len, names), 3), np.nan)
        for at in np.ndindex(out.shape[:-1]):
            wanted = tuple(of[k] for of, k in zip(names, at, strict=True))
            known = [value for cell in cells if cell.settings == wanted and np.isfinite(value := cell.measured[column])]
            if known:
                out[at] = np.mean(known), min(known), max(known)
        return out

    def summary(self, cells: Cells) -> str:
        """A table for each data set, then its notes. Values are means over repetitions, with minimum and maximum."""
        lines = []
        titles = ", ".join(title for title, _ in self.settings.values())
        for data, own in _by_data(cells).items():
            panels = [self.panel(own, measure) for measure in self.measures]
            lines += [data, f"  {titles:32}" + "".join(f"{title:>30}" for title in self.measures.values())]
            names = self.values(own)
            for at in np.ndindex(panels[0].shape[:-1]):
                numbers = ["{:.4f} ({:.4f} to {:.4f})".format(*panel[at]) if np.isfinite(panel[at][0]) else "–" for panel in panels]
                setting = ", ".join(str(of[k]) for of, k in zip(names, at, strict=True))
                lines.append(f"  {setting:32}" + "".join(f"{text:>30}" for text in numbers))
            lines += [f"  {line}" for line in self.notes(self, own)]
        return "\n".join(lines)

    def draw(self, cells: Cells, path: Path) -> None:
        """Write a plot: a row for each data set, a column for each measure, a line for each value of any second setting.

        Points are means, whiskers minimum and maximum over repetitions.
        """
        from matplotlib.figure import Figure

        data = _by_data(cells)
        figure = Figure(figsize=(4.2 * len(self.measures), 3.4 * len(data)), layout="constrained")
        axes = figure.subplots(len(data), len(self.measures), squeeze=False)
        for row, (name, own) in enumerate(data.items()):
            for axis, (measure, title) in zip(axes[row], self.measures.items(), strict=True):
                self._lines(axis, own, measure)
                axis.set(ylabel=title, title=name)
            if len(self.settings) > 1:
                axes[row, 0].legend()
        with new_file(path) as part:
            figure.savefig(part, dpi=110)

    def _lines(self, axis: Any, cells: Cells, measure: str) -> None:
        (x_title, _), *second = self.settings.values()
        x, *others = self.values(cells)
        lines = [f"{title} {value}" for (title, _), of in zip(second, others, strict=True) for value in of] or [""]
        places = np.arange(len(x)) if isinstance(x[0], str) else np.array(x)
        for label, of in zip(lines, self.panel(cells, measure).reshape(len(x), len(lines), 3).swapaxes(0, 1), strict=True):
            mean, low, high = of.T
            axis.errorbar(places, mean, [mean - low, high - mean], marker="o", ms=4, capsize=3, label=label)
        axis.set_xlabel(x_title)
        if isinstance(x[0], str):
            axis.set_xticks(places, x, rotation=30, ha="right")
        axis.ticklabel_format(axis="y", useOffset=False)
        axis.grid(alpha=0.3)


def _by_data(cells: Cells) -> dict[str, Cells]:
    return {data: [cell for cell in cells if cell.data == data] for data in dict.fromkeys(cell.data for cell in cells)}


def synthetic(frames: int) -> Material:
    """A synthetic crowd of PEOPLE people among three fixed panoramas, with missed and false boxes."""
    rng = np.random.default_rng([0, 4])
    setup, paths = synthetic_crowd.setup(), synthetic_crowd.paths(PEOPLE, frames, rng)
    ticks = tuple(synthetic_crowd.ticks(setup, paths, rng, clutter=CLUTTER))
    seen, level = np.ones((PEOPLE, len(setup.mounts))), np.zeros(PEOPLE)
    truth = tuple(Truth(k, {}, np.arange(PEOPLE), np.column_stack([places, level]), seen) for k, places in enumerate(paths))
    sequence = Sequence(setup, TicksInMemory(ticks, setup.mounts), truth, {})
    return Material("synthetic crowd", lambda _: sequence, frames)


def _opened(folder: Path, views: tuple[int, ...], degrade: str, seed: int, images: bool) -> Sequence:
    """A PETS 2009 sequence with degraded detections. Raises ValueError where there is no truth."""
    sequence = open_sequence(folder, SourceOptions.parse((), degrade, seed, ",".join(map(str, views)), images=images))
    if sequence.truth is None:
        raise ValueError(f"{folder}: no annotations/*-cropped.xml")
    return sequence


def pets(folder: Path, frames: int, degrade: str = "") -> Material:
    """The first frames of a PETS 2009 folder, views 1, 5 and 7, with degraded detections. Raises ValueError where there is no truth."""
    opened = _opened(folder, PETS_VIEWS, degrade, 0, images=False)
    ticks = tuple(itertools.islice(iter(opened.ticks), min(frames, len(opened.truth or ()))))
    sequence = replace(opened, ticks=TicksInMemory(ticks, opened.setup.mounts))
    return Material(", ".join(filter(None, ("PETS S2.L1", degrade))), lambda _: sequence, frames)


def _counted(material: Material, repetition: int, k_h: int, i_bls_max: int) -> tuple[float, ...]:
    """Processor time, s, and MOTA. Above K_H = 1, each hypothesis has a graph, as in the paper. The search proves no optimum."""
    many = MhtParameters(k_h=k_h, i_bls_max=i_bls_max, seed=repetition)
    seconds, found = material.tracked(material.sequence(repetition), Parameters(targets=many), searched_cliques)
    return seconds, float(found.mota)


def _count_notes(form: StudyForm, cells: Cells) -> Iterator[str]:
    """Whether time is linear in i_bls^max, and whether the spread of MOTA falls as K_H grows."""
    seconds, mota = form.panel(cells, "seconds")[..., 0], form.panel(cells, "mota")
    yield f"four times the moves cost {np.mean(seconds[:, -1] / seconds[:, 0]):.2f} times the time (4 would be in proportion)"
    first, second = np.diff(seconds, axis=1).mean(axis=0)
    yield f"moves 1001 to 2000 cost {second:.2f} s, moves 501 to 1000 {first:.2f} s (twice that would be a straight line)"
    if len({cell.repetition for cell in cells}) < 2:
        yield "too few repetitions for a spread"
        return
    k, spread = np.array(form.values(cells)[0]), (mota[..., 2] - mota[..., 1]).mean(axis=1)
    # Spearman's rank correlation at 5 %.
    rank, chance = spearmanr(k, spread) if np.ptp(spread) > 0 else (0.0, 1.0)
    falls = "falls" if rank < 0 and chance < 0.05 else "does not fall significantly"
    yield f"spread of MOTA (max − min) {falls} with K_H: {np.polyfit(k, spread, 1)[0]:+.5f} a hypothesis"


def _searched(material: Material, repetition: int, form: str, start: str) -> tuple[float, ...]:
    """Time, gap and MOTA of the search alone, without branch and bound. A second run writes the graphs, some of which are solved exactly.

    The gap is the share of the largest weight that the chosen cliques lack, NaN where no graph has a proof.
    """
    many, solver = MhtParameters(k_h=FORMS[form], seed=repetition), partial(searched_cliques, warm=STARTS[start])
    seconds, found = material.tracked(material.sequence(repetition), Parameters(targets=many), solver)
    with tempfile.TemporaryDirectory(prefix="pilsim-graphs-") as folder:
        material.tracked(material.sequence(repetition), Parameters(targets=many, graphs=Path(folder)), solver)
        gap = clique_gap(Path(folder), PROVED)
    return seconds, float("nan") if gap is None else gap, float(found.mota)


def _search_notes(form: StudyForm, cells: Cells) -> Iterator[str]:
    """A sentence for each choice.

    A difference of means is within the spread where it is no larger than the spread over repetitions, or there is one repetition only.
    """
    values = np.array([form.panel(cells, measure) for measure in form.measures])
    mean, spread = values[..., 0], values[..., 2] - values[..., 1]
    pairs = (
        ("small graphs against one graph", (slice(None), 0, 0), (slice(None), 1, 0)),
        ("a warm start against a cold one (small graphs)", (slice(None), 0, 0), (slice(None), 0, 1)),
        ("a warm start against a cold one (one graph)", (slice(None), 1, 0), (slice(None), 1, 1)),
    )
    for words, a, b in pairs:
        seconds, weight, mota = mean[a][0] / mean[b][0], mean[b][1] - mean[a][1], mean[a][2] - mean[b][2]
        widest = max(spread[a][2], spread[b][2])
        chance = " (within the spread)" if abs(mota) <= widest or widest == 0 else ""
        proved = f"{100 * weight:+.4f} points of weight" if np.isfinite(weight) else "weights without proof"
        yield f"{words}: {seconds:.2f} times the time, {proved}, {mota:+.4f} of MOTA{chance}"


def _image_materials(out: Path, folder: Path | None, frames: int) -> list[Material]:
    """A rendered recording, and PETS 2009, where views with a video have images. Raises ValueError for a folder without truth."""

    def rendered(repetition: int) -> Sequence:
        recording = out / f"recording-{repetition}"
        if not recording.exists():
            record(replace(CROWD, seed=repetition, frames=frames), recording)
        return read_sequence(recording)

    made = [Material("rendered crowd", rendered, frames)]
    if folder is None:
        return made
    _opened(folder, PETS_VIEWS, "", 0, images=True)
    for views, degrade in itertools.product(((1,), PETS_VIEWS), ("", DROPPED)):
        name = ", ".join(filter(None, ("PETS S2.L1, view " + " ".join(map(str, views)), degrade)))
        # With the given detections, nothing depends on a seed.
        made.append(Material(name, partial(_opened, folder, views, degrade, images=True), frames, *([] if degrade else [1])))
    return made


def _seen(material: Material, repetition: int, setting: str) -> tuple[float, ...]:
    """MOTA, IDF1, switches and processor time, s, with delayed output."""
    parameters = Parameters(images=ImageParameters(TRACKLETS[setting]), delay=DELAY)
    seconds, found = material.tracked(material.sequence(repetition), parameters, everybody=False)
    return float(found.mota), float(found.idf1), float(found.switches), seconds


def _image_notes(form: StudyForm, cells: Cells) -> Iterator[str]:
    """For each setting, the numbers of repetitions with more and with less MOTA and IDF1 than without images."""
    plain = {cell.repetition: np.array(cell.measured[:2]) for cell in cells if cell.settings == ("no images",)}
    for setting in form.values(cells)[0]:
        if TRACKLETS[setting] is not None:
            change = np.array([cell.measured[:2] - plain[cell.repetition] for cell in cells if cell.settings == (setting,)])
            mota, idf1 = (f"{int((d > 1e-9).sum())} better and {int((d < -1e-9).sum())} worse" for d in change.T)
            yield f"{setting} against no images: MOTA {mota}; IDF1 {idf1}"


TIME, MOTA = "processing time / s", "MOTA"
STUDIES = {
    "fig4": StudyForm(
        "cells.csv",
        {"k_h": ("K_H", (1, 5, 10, 15, 20, 25, 30)), "i_bls_max": ("i_bls^max", (500, 1000, 2000))},
        {"seconds": TIME, "mota": MOTA},
        _counted,
        _count_notes,
        lambda _, folder, frames: [synthetic(frames), *([pets(folder, frames), pets(folder, frames, DEGRADATION)] if folder else [])],
        PEOPLE,
        (2,),
    ),
    "graphs": StudyForm(
        "runs.csv",
        {"form": ("form", tuple(FORMS)), "start": ("start", tuple(STARTS))},
        {"seconds": TIME, "gap": "missing share of the weight", "mota": MOTA},
        _searched,
        _search_notes,
        lambda _, folder, frames: [synthetic(frames), *([pets(folder, frames)] if folder else [])],
        PEOPLE,
        tuple(FORMS.values()),
    ),
    "images": StudyForm(
        "cells.csv",
        {"setting": ("setting", tuple(TRACKLETS))},
        {"mota": MOTA, "idf1": "IDF1", "switches": "switches", "seconds": TIME},
        _seen,
        _image_notes,
        _image_materials,
        CROWD.people,
    ),
}
"""The studies by name: K_H and i_bls^max (fig4), graphs and starts of the clique search (graphs), parameters of image tracklets (images).

The paper makes a small graph of each global hypothesis of the previous frame, and starts each search with the tracks of the previous solution (warm).
The alternatives are one graph of all tracks, and a start with the heaviest tracks (cold).
"""
