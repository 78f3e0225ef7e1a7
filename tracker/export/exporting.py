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
from tracker.export.colmap import README as README_COLMAP
from tracker.export.colmap import export_colmap
from tracker.export.euroc import README as README_EUROC
from tracker.export.euroc import export_euroc
from tracker.export.jrdb import README as README_JRDB
from tracker.export.jrdb import export_jrdb
from tracker.export.kitti import README as README_KITTI
from tracker.export.kitti import export_kitti
from tracker.export.motchallenge import README15, README17, export_mot15, export_mot17
from tracker.export.pets2009 import README as README_PETS
from tracker.export.pets2009 import export_pets
from tracker.export.recorded_sequence import Progress, RecordedSequence, export_folder
from tracker.export.recording import README as README_RECORDING
from tracker.export.recording import export_recording
from tracker.export.ros2.mcap import README as README_MCAP
from tracker.export.ros2.mcap import export_mcap
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
    "euroc": ExportFormat("EuRoC MAV data", README_EUROC, export_euroc),
    "kitti": ExportFormat("KITTI odometry", README_KITTI, export_kitti),
    "colmap": ExportFormat("COLMAP", README_COLMAP, export_colmap),
    "mcap": ExportFormat("MCAP with ROS 2 messages", README_MCAP, export_mcap),
}


@dataclass(frozen=True)
class ExportOptions:
    """rectangles: also write rectangles.pom (wildtrack). epoch: time of frame 0, whole s (euroc, mcap). faces: panoramas as cube faces (euroc)."""

    rectangles: bool = False
    epoch: int = 0
    faces: bool = False

    def writer(self, form: str) -> Callable[[Path, Iterable[RecordedSequence]], list[str]]:
        """The writer of a format with these options. Raises ValueError for one that is set and that the format does not have."""
        for name, forms in OPTIONS.items():
            if getattr(self, name) and form not in forms:
                raise ValueError(f"{name} is set for {form}, needs {' or '.join(forms)}")
        if not 0 <= self.epoch <= LATEST:
            raise ValueError(f"epoch is {self.epoch} s, needs 0 to {LATEST}")
        if form == "wildtrack":
            return partial(export_wildtrack, rectangles=self.rectangles)
        if form == "euroc":
            return partial(export_euroc, epoch=self.epoch, as_faces=self.faces)
        if form == "mcap":
            return partial(export_mcap, epoch=self.epoch)
        return FORMATS[form].write


OPTIONS = {"rectangles": ("wildtrack",), "epoch": ("euroc", "mcap"), "faces": ("euroc",)}
"""Option → the formats that have it."""
LATEST = 2**31 - 1000000
"""s: times of ROS 2 end at 2³¹ s; the rest is for the length of the sequence."""
PLAIN = ExportOptions()


def export(folder: Path, form: str, out: Path, progress: Progress | None = None, options: ExportOptions = PLAIN) -> list[Path]:
    """Write the sequences of `folder` (one, or a dataset) into `out` atomically; returns their folders.

    form: a key of FORMATS. Raises ValueError for an unknown format, for options that it does not have, and for a folder without sequences.
    Raises ValueError for an `out` that is not empty or lies in `folder`.
    Raises ValueError where a sequence lacks what the format needs, and where another process writes into `out`.
    Raises Kept where the disk is full, with the place of what was made.
    """
    if form not in FORMATS:
        raise ValueError(f"format is {form!r}, needs one of {', '.join(FORMATS)}")
    write = options.writer(form)
    found = sequences(folder)
    with export_folder(folder, out) as unfinished:
        notes = write(unfinished, (RecordedSequence.open(path, progress) for path in found))
        names = ", ".join(path.resolve().name for path in found)
        head = f"# {FORMATS[form].title}, exported by pilsim\n\nFrom: {names}. Synthetic: people, places and images were made by a program.\n"
        tail = "".join(f"\n{note}\n" for note in notes)
        write_text(unfinished / "README.md", head + FORMATS[form].readme + tail)
    return found
