"""Opening a data set by what lies in its folder: a sequence of pilsim, or PETS 2009."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tracker.datasets.pets2009 import Choice, _read_pets
from tracker.sequence.reader import read_sequence
from tracker.types import Sequence


def open_source(path: Path, views: Iterable[int] = (), choice: Choice | None = None) -> Sequence:
    """The Sequence in `path`; `views` are the numbers of PETS cameras, none stands for all.

    Raises ValueError where there is nothing that can be read, or where a generated sequence is asked for with a choice of PETS.
    """
    choice = choice or Choice()
    if not path.is_dir():
        raise ValueError(f"{path}: no such folder")
    wanted = list(views)
    if len(set(wanted)) != len(wanted):
        raise ValueError(f"--views {','.join(map(str, wanted))} names a view twice")
    if (path / "manifest.json").is_file():
        if not choice.plain:
            raise ValueError(f"{path}: --detections and --degrade are for PETS folders")
        if wanted:
            raise ValueError(f"{path}: --views chooses PETS cameras; a generated sequence is tracked with all its robots")
        return read_sequence(path)
    if (path / "annotations").is_dir() or (path / "detections").is_dir():
        return _read_pets(path, wanted, choice)
    raise ValueError(f"{path}: neither a sequence (manifest.json) nor a PETS 2009 folder (annotations/, detections/)")
