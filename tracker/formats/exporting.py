"""Export of a sequence or a dataset to a format of another project. Each export has a README.md that describes its columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tracker.formats.exported_sequence import Progress, RecordedSequence, export_folder
from tracker.formats.opening import open_recording
from tracker.formats.recording_export import README
from tracker.formats.registry import EXPORTS, Export
from tracker.io.atomic import write_text
from tracker.recordings.folder import write_recording
from tracker.sequence.dataset import sequences

LATEST = 2**31 - 1000000
"""s: times of ROS 2 end at 2³¹ s; the rest is for the length of the sequence."""


@dataclass(frozen=True)
class ExportOptions:
    """rectangles: also write rectangles.pom (wildtrack). epoch: time of frame 0, whole s (euroc, mcap). faces: panoramas as cube faces (euroc)."""

    rectangles: bool = False
    epoch: int = 0
    faces: bool = False

    def of(self, export: Export) -> dict[str, object]:
        """The options of an export by their names. Raises ValueError for an option that is set and that the export does not have."""
        for name, value in vars(self).items():
            if value and name not in export.options:
                having = [other.name for other in EXPORTS.values() if name in other.options]
                raise ValueError(f"{name} is set for {export.name}, needs {' or '.join(having)}")
        if not 0 <= self.epoch <= LATEST:
            raise ValueError(f"epoch is {self.epoch} s, needs 0 to {LATEST}")
        return {name: getattr(self, name) for name in export.options}


PLAIN = ExportOptions()


def export(folder: Path, form: str, out: Path, progress: Progress | None = None, options: ExportOptions = PLAIN) -> list[Path]:
    """Write the sequences of `folder` (one, or a dataset) into `out` atomically; returns their folders.

    form: a name of EXPORTS. Raises ValueError for an unknown format, for options that the format does not have, and for a folder without sequences.
    Raises ValueError for an `out` that is not empty or lies in `folder`.
    Raises ValueError where a sequence lacks what the format needs, and where another process writes into `out`.
    Raises Kept where the disk is full, with the path of the unfinished files.
    """
    if form not in EXPORTS:
        raise ValueError(f"format is {form!r}, needs one of {', '.join(EXPORTS)}")
    chosen = options.of(EXPORTS[form])
    found = sequences(folder)
    with export_folder(folder, out) as unfinished:
        notes = EXPORTS[form].write(unfinished, (RecordedSequence.open(path, progress) for path in found), **chosen)
        names = ", ".join(path.resolve().name for path in found)
        head = f"# {EXPORTS[form].title}, exported by pilsim\n\nFrom: {names}. Synthetic: people, places and images were made by a program.\n"
        tail = "".join(f"\n{note}\n" for note in notes)
        write_text(unfinished / "README.md", head + EXPORTS[form].readme + tail)
    return found


def export_source(source: Path, out: Path) -> None:
    """Write a source of any format but pilsim's own as a recording into `out` atomically.

    Raises ValueError as open_recording, for an `out` that is not empty or lies in `source`, and where another process writes into it.
    """
    recording = open_recording(source)
    with export_folder(source, out) as unfinished:
        write_recording(unfinished, recording)
        write_text(unfinished / "README.md", f"# A recording, exported by pilsim\n\nFrom: {source.resolve().name}.\n{README}")
