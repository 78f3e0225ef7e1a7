"""Opening a folder as a sequence: a recording of pilsim, or PETS 2009."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tracker.datasets.pets2009 import PetsOptions, read_pets
from tracker.sequence.reader import read_sequence
from tracker.types import Sequence


def open_sequence(path: Path, views: Iterable[int] = (), options: PetsOptions | None = None) -> Sequence:
    """Open the sequence in the folder `path`.

    views: numbers of the PETS 2009 cameras to use; empty for all. options: how a PETS 2009 folder is read.
    Raises ValueError for an unknown folder, invalid content, and options of PETS 2009 for a recording of pilsim.
    """
    options = options or PetsOptions()
    if not path.is_dir():
        raise ValueError(f"{path}: no such folder")
    wanted = list(views)
    if len(set(wanted)) != len(wanted):
        raise ValueError(f"--views {','.join(map(str, wanted))} names a view twice")
    if (path / "manifest.json").is_file():
        if not options.is_default:
            raise ValueError(f"{path}: --detections and --degrade are for PETS folders")
        if wanted:
            raise ValueError(f"{path}: --views chooses PETS cameras; a generated sequence is tracked with all its robots")
        return read_sequence(path)
    if (path / "annotations").is_dir() or (path / "detections").is_dir():
        return read_pets(path, wanted, options)
    raise ValueError(f"{path}: neither a sequence (manifest.json) nor a PETS 2009 folder (annotations/, detections/)")
