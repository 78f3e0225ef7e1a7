"""The study of image tracklets: corners in boxes tracked back through the images, with the paper's parameters and others, and without images.

The data are PETS 2009, where views with a video have images, and a rendered recording. A cell is one run with delayed output.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim.recording.record import record
from sim.scenario import Scenario
from sim.studies.study_cells import Cells, StudyForm
from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import PETS_VIEWS
from tracker.formats.source_options import SourceOptions
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


def study(out: Path, chosen: list[ImageMaterial], frames: int, repetitions: int) -> Iterator[ImageCell]:
    """The cells of a study, of which out/cells.csv keeps what is done."""
    for material in chosen:
        choices = ((material.name, setting, k) for k, setting in itertools.product(range(material.runs(repetitions)), SETTINGS))
        yield from FORM.resumed(out, choices, lambda _, *choice, material=material: run_cell(material, frames, *choice))


def count_runs(chosen: list[ImageMaterial], repetitions: int) -> int:
    """The number of runs of a study."""
    return sum(len(SETTINGS) * m.runs(repetitions) for m in chosen)


def _notes(cells: Cells) -> Iterator[str]:
    """For each setting, the numbers of repetitions with more and with less MOTA and IDF1 than without images."""
    plain = {cell.repetition: cell for cell in cells if cell.setting == "no images"}
    for setting in FORM.values(cells, "setting"):
        if SETTINGS[setting] is None:
            continue
        pairs = [(cell, plain[cell.repetition]) for cell in cells if cell.setting == setting]
        change = np.array([(a.mota - b.mota, a.idf1 - b.idf1) for a, b in pairs])
        mota, idf1 = (f"{int((d > 1e-9).sum())} better and {int((d < -1e-9).sum())} worse" for d in change.T)
        yield f"{setting} against no images: MOTA {mota}; IDF1 {idf1}"


MEASURES = {"mota": "MOTA", "idf1": "IDF1", "switches": "switches", "seconds": "processing time / s"}
FORM = StudyForm(ImageCell, "cells.csv", {"setting": "setting"}, MEASURES, _notes)
