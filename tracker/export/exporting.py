"""Export of a sequence or a dataset to a format of another project. Each export has a README.md that describes its columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tracker.export.aicity import README as README_AICITY
from tracker.export.aicity import export_aicity
from tracker.export.coco import README as README_COCO
from tracker.export.coco import export_coco
from tracker.export.jrdb import README as README_JRDB
from tracker.export.jrdb import export_jrdb
from tracker.export.motchallenge import README15, README17, export_mot15, export_mot17
from tracker.export.pets2009 import README as README_PETS
from tracker.export.pets2009 import export_pets
from tracker.export.recorded_sequence import Progress, RecordedSequence, export_folder
from tracker.export.recording import README as README_RECORDING
from tracker.export.recording import export_recording
from tracker.export.tum import README as README_TUM
from tracker.export.tum import export_tum
from tracker.export.wildtrack import README as README_WILDTRACK
from tracker.export.wildtrack import export_wildtrack
from tracker.io.atomic import write_text
from tracker.sequence.dataset import sequences


@dataclass(frozen=True)
class ExportFormat:
    """A format: its title, the description of its files in README.md, and its writer, which returns notes for README.md."""

    title: str
    readme: str
    write: Callable[[Path, Iterable[RecordedSequence]], list[str]]


FORMATS = {
    "pets": ExportFormat("PETS 2009", README_PETS, export_pets),
    "mot15": ExportFormat("MOTChallenge 2015, 2-D and 3-D", README15, export_mot15),
    "mot17": ExportFormat("MOTChallenge 2017", README17, export_mot17),
    "wildtrack": ExportFormat("WILDTRACK and MultiviewX", README_WILDTRACK, export_wildtrack),
    "coco": ExportFormat("COCO", README_COCO, export_coco),
    "jrdb": ExportFormat("JRDB", README_JRDB, export_jrdb),
    "aicity": ExportFormat("AI City Challenge, track 1", README_AICITY, export_aicity),
    "recording": ExportFormat("A recording of one's own", README_RECORDING, export_recording),
    "tum": ExportFormat("TUM trajectories", README_TUM, export_tum),
}


def export(folder: Path, form: str, out: Path, progress: Progress | None = None, rectangles: bool = False) -> list[Path]:
    """Write the sequences of `folder` (one, or a dataset) into `out` atomically; returns their folders.

    form: a key of FORMATS. rectangles: also write rectangles.pom, for wildtrack only.
    Raises ValueError for an unknown format, a folder without sequences, and an `out` that is not empty or lies in `folder`.
    Raises ValueError where a sequence lacks what the format needs, and where another process writes into `out`.
    Raises Kept where the disk is full, with the place of what was made.
    """
    if form not in FORMATS:
        raise ValueError(f"format is {form!r}, needs one of {', '.join(FORMATS)}")
    if rectangles and form != "wildtrack":
        raise ValueError(f"rectangles is set for {form}, needs wildtrack")
    write = partial(export_wildtrack, rectangles=True) if rectangles else FORMATS[form].write
    found = sequences(folder)
    with export_folder(folder, out) as unfinished:
        notes = write(unfinished, (RecordedSequence.open(path, progress) for path in found))
        names = ", ".join(path.resolve().name for path in found)
        head = f"# {FORMATS[form].title}, exported by pilsim\n\nFrom: {names}. Synthetic: people, places and images were made by a program.\n"
        tail = "".join(f"\n{note}\n" for note in notes)
        write_text(unfinished / "README.md", head + FORMATS[form].readme + tail)
    return found
