"""The study of image tracklets: corners in boxes tracked back through the images, with the paper's parameters and others, and without images.

The data are PETS 2009, where views with a video have images, and a rendered recording. A cell is one run with delayed output.
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from sim.recording.record import record
from sim.scenario import Scenario
from sim.studies.hypothesis_count import resumed
from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PETS_VIEWS
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.io.atomic import new_file
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, track
from tracker.sequence.reader import read_sequence
from tracker.types import Sequence
from tracker.types.truth import evaluated_people

PAPER = TrackletParameters()
SETTINGS: dict[str, TrackletParameters | None] = {
    "no images": None,
    "the paper's": PAPER,
    "L_c = 1": replace(PAPER, l_c=1),
    "L_c = 8": replace(PAPER, l_c=8),
    "δ_min = 0.5 px": replace(PAPER, delta_min=0.5),
    "ω = 0.1": replace(PAPER, omega=0.1),
    "ω = 0.6": replace(PAPER, omega=0.6),
}
VIEWS = (1,), PETS_VIEWS
DROPPED = "drop=0.5"
"""Degradation of the detections of PETS 2009, beside the given ones."""
CROWD = Scenario(robots=2, people=20, width=768)
"""The rendered scenario. Each repetition has another seed."""
DELAY = 10
PANELS = "MOTA", "IDF1", "processing time / s"


@dataclass(frozen=True)
class ImageCell:
    """One run: MOTA, IDF1 and switches at 1 m, and processor time, s."""

    data: str
    setting: str
    repetition: int
    mota: float
    idf1: float
    switches: int
    seconds: float

    @property
    def key(self) -> tuple[str, str, int]:
        """Data set, setting and repetition."""
        return self.data, self.setting, self.repetition


@dataclass(frozen=True)
class ImageMaterial:
    """A data set with images: a PETS 2009 folder with views and a degradation of its detections, or a rendered recording.

    pets: the PETS 2009 folder; None for the recording. folder: where recordings are written.
    """

    name: str
    folder: Path
    pets: Path | None = None
    views: tuple[int, ...] = ()
    degrade: str = ""

    def runs(self, repetitions: int) -> int:
        """The number of runs of each setting. It is 1 for PETS 2009 with its given detections, where nothing depends on a seed."""
        return 1 if self.pets is not None and not self.degrade else repetitions

    def sequence(self, repetition: int, frames: int) -> Sequence:
        """The sequence with images. The repetition is the seed."""
        if self.pets is None:
            folder = self.folder / f"recording-{repetition}"
            if not folder.exists():
                record(replace(CROWD, seed=repetition, frames=frames), folder)
            return read_sequence(folder)
        return open_sequence(self.pets, SourceOptions.parse((), self.degrade, repetition, ",".join(map(str, self.views)), images=True))


def materials(out: Path, pets: Path | None) -> list[ImageMaterial]:
    """All data sets of the study."""
    real = [ImageMaterial(_name(views, degrade), out, pets, views, degrade) for views, degrade in itertools.product(VIEWS, ("", DROPPED))]
    return [ImageMaterial("rendered crowd", out), *(real if pets is not None else [])]


def _name(views: tuple[int, ...], degrade: str) -> str:
    return ", ".join(filter(None, ("PETS S2.L1, view " + " ".join(map(str, views)), degrade)))


def run_cell(material: ImageMaterial, frames: int, setting: str, repetition: int) -> ImageCell:
    """Run one cell on the first `frames` frames."""
    sequence = material.sequence(repetition, frames)
    assert sequence.truth is not None
    parameters = Parameters(images=ImageParameters(SETTINGS[setting]), delay=DELAY)
    began = time.process_time()
    estimates = list(track(sequence.setup, itertools.islice(iter(sequence.ticks), frames), parameters))
    seconds = time.process_time() - began
    counts = evaluated_people(sequence.truth, sequence.setup.period)
    scored = zip(sequence.truth, counts, estimates, strict=False)
    found = score([MatchingFrame(t.person_id, t.feet, e.target_id, e.position, counts=c) for t, c, e in scored])
    return ImageCell(material.name, setting, repetition, float(found.mota), float(found.idf1), int(found.switches), seconds)


def study(out: Path, chosen: list[ImageMaterial], frames: int, repetitions: int) -> Iterator[list[ImageCell]]:
    """Run the cells that out/cells.csv does not hold. Yields all cells so far after each."""
    for material in chosen:
        choices = ((setting, repetition) for repetition, setting in itertools.product(range(material.runs(repetitions)), SETTINGS))
        yield from resumed(out / "cells.csv", ImageCell, choices, partial(run_cell, material, frames), material.name)


def count_runs(chosen: list[ImageMaterial], repetitions: int) -> int:
    """The number of runs of a study."""
    return sum(len(SETTINGS) * m.runs(repetitions) for m in chosen)


def differences(cells: list[ImageCell], setting: str) -> Array:
    """(r, 2): MOTA and IDF1 of a setting less those without images, a row for each repetition that has both."""
    plain = {c.repetition: c for c in cells if c.setting == "no images"}
    pairs = [(c, plain[c.repetition]) for c in cells if c.setting == setting and c.repetition in plain]
    return np.array([(a.mota - b.mota, a.idf1 - b.idf1) for a, b in pairs]).reshape(-1, 2)


def _complete(cells: list[ImageCell], name: str) -> list[ImageCell]:
    """The cells of a data set of repetitions with all settings. A repetition that was interrupted cannot be compared."""
    own = [c for c in cells if c.data == name]
    counts = Counter(c.repetition for c in own)
    whole = max(counts.values(), default=0)
    return [c for c in own if counts[c.repetition] == whole]


def summary(cells: list[ImageCell]) -> str:
    """A table for each data set: means, and the numbers of runs that were better and worse than without images."""
    lines = []
    for name in dict.fromkeys(c.data for c in cells):
        own = _complete(cells, name)
        lines += [name, f"{'':18}{'MOTA':>8}{'IDF1':>8}{'switches':>10}{'seconds':>9}   MOTA better, worse; IDF1 better, worse"]
        for setting in SETTINGS:
            here = [c for c in own if c.setting == setting]
            if not here:
                continue
            mota, idf1, switches, seconds = np.mean([(c.mota, c.idf1, c.switches, c.seconds) for c in here], axis=0)
            change = differences(own, setting)
            counts = "" if SETTINGS[setting] is None else "; ".join(f"{int((d > 1e-9).sum())}, {int((d < -1e-9).sum())}" for d in change.T)
            lines.append(f"  {setting:16}{mota:>8.4f}{idf1:>8.4f}{switches:>10.1f}{seconds:>9.1f}   {counts}".rstrip())
    return "\n".join(lines)


def draw(cells: list[ImageCell], path: Path) -> None:
    """Write a plot: for each data set MOTA, IDF1 and processing time of each setting.

    A dot is a run. A line marks the mean of the runs without images.
    """
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(c.data for c in cells))
    figure = Figure(figsize=(12, 2.9 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), len(PANELS), squeeze=False)
    for row, name in enumerate(names):
        own = _complete(cells, name)
        for axis, column, label in zip(axes[row], ("mota", "idf1", "seconds"), PANELS, strict=True):
            plain = [getattr(c, column) for c in own if c.setting == "no images"]
            if plain:
                axis.axvline(float(np.mean(plain)), color="0.6", zorder=1)
            for k, setting in enumerate(SETTINGS):
                values = [getattr(c, column) for c in own if c.setting == setting]
                if values:
                    axis.plot(values, [k] * len(values), "o", ms=4, alpha=0.5, zorder=2)
                    axis.plot(np.mean(values), k, "k|", ms=14, zorder=3)
            axis.set(yticks=range(len(SETTINGS)), yticklabels=list(SETTINGS) if column == "mota" else [], xlabel=label, title=name)
            axis.ticklabel_format(axis="x", useOffset=False)
            axis.locator_params(axis="x", nbins=5)
            axis.set_ylim(len(SETTINGS) - 0.5, -0.5)
            axis.grid(axis="x", alpha=0.3)
    with new_file(path) as part:
        figure.savefig(part, dpi=110)
