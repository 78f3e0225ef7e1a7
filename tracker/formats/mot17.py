"""MOTChallenge 2016, 2017 and 2020: truth in nine values a row (twelve with MOTSynth's place on the ground), and what lies beside it.

frame (from 1), id, left, top, width, height (pixels, the first is 1), consider (0: the row does not count), class (1: pedestrian),
visibility in [0, 1]; MOTSynth adds x, y, z of the feet (m). Detections and results are files of ten values (motchallenge.read_mot15).
"""

from __future__ import annotations

import configparser
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.atomic import write_text
from tracker.formats.motchallenge import Ints, first_fault, number, read_rows, whole
from tracker.geometry import Array, frozen

COLUMNS = ("frame", "id", "left", "top", "width", "height", "consider", "class", "visibility")
PLACE = ("x", "y", "z")
WHOLE = ("frame", "id", "consider", "class")
PEDESTRIAN = 1
CLASSES = 13
"""Of MOT16, from 1 to this."""


@dataclass(frozen=True, eq=False)
class Annotated:
    """Rows of one truth file: frame (n,) from 1, id (n,), box (n, 4) left, top, width, height px from 1, consider (n,) 0 or 1, category (n,)
    from 1, visibility (n,) in [0, 1]; position (n, 3) m or None.

    Raises ValueError for a number beyond these bounds, a negative size, or an id that comes twice in a frame.
    """

    frame: Ints
    id: Ints
    box: Array
    consider: Ints
    category: Ints
    visibility: Array
    position: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.frame)
        object.__setattr__(self, "box", frozen(self.box, (n, 4), "box"))
        object.__setattr__(self, "visibility", frozen(self.visibility, (n,), "visibility"))
        if self.position is not None:
            object.__setattr__(self, "position", frozen(self.position, (n, 3), "position"))
        for name in ("frame", "id", "consider", "category"):
            object.__setattr__(self, name, whole(getattr(self, name), n, name))
        fault = first_fault(self.frame, self.id, self.box)
        if fault is not None:
            raise ValueError(f"row {fault[0]}: {fault[1]}")
        bounds = {"consider": (0, 1), "category": (1, CLASSES), "visibility": (0, 1)}
        for name, (low, high) in bounds.items():
            values = getattr(self, name)
            bad = (values < low) | (values > high)
            if bad.any():
                raise ValueError(f"row {int(np.argmax(bad))}: {name} is {values[np.argmax(bad)]}, needs {low} to {high}")

    def __len__(self) -> int:
        return len(self.frame)


def write_mot17(path: Path, rows: Annotated) -> None:
    """Write `rows` by frame, then id, every number so that it reads back the same; nine values, twelve where there are positions."""
    out = []
    for k in np.lexsort((rows.id, rows.frame)):
        place = [] if rows.position is None else [number(x) for x in rows.position[k]]
        whole = str(int(rows.consider[k])), str(int(rows.category[k])), number(float(rows.visibility[k]))
        out.append(",".join([str(int(rows.frame[k])), str(int(rows.id[k])), *(number(x) for x in rows.box[k]), *whole, *place]) + "\n")
    write_text(path, "".join(out))


def read_mot17(path: str | os.PathLike[str]) -> Annotated:
    """Read a truth file of nine or twelve values a row (the first row says which). ValueError naming file and line as motchallenge.read_mot15."""
    with Path(path).open(encoding="utf-8-sig", errors="replace") as file:
        many = file.readline(1 << 12).count(",") + 1
    columns = COLUMNS + PLACE if many == len(COLUMNS + PLACE) else COLUMNS
    table = read_rows(path, columns, WHOLE)
    frame, ids, consider, category = table[:, [0, 1, 6, 7]].astype(np.int64).T
    try:
        return Annotated(frame, ids, table[:, 2:6], consider, category, table[:, 8], table[:, 9:] if len(columns) > len(COLUMNS) else None)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


@dataclass(frozen=True)
class SeqInfo:
    """seqinfo.ini: name of the sequence, rate in frames/s, number of frames, size of the images in px, their suffix and folder."""

    name: str
    rate: float
    frames: int
    width: int
    height: int
    suffix: str = ".jpg"
    images: str = "img1"


def write_seqinfo(path: Path, info: SeqInfo) -> None:
    """The file that read_seqinfo reads; keys and spelling are the challenge's."""
    lines = [
        "[Sequence]",
        f"name={info.name}",
        f"imDir={info.images}",
        f"frameRate={number(info.rate)}",
        f"seqLength={info.frames}",
        f"imWidth={info.width}",
        f"imHeight={info.height}",
        f"imExt={info.suffix}",
    ]
    write_text(path, "\n".join(lines) + "\n")


def read_seqinfo(path: Path) -> SeqInfo:
    """Raises ValueError with the file's name where it is not there, no INI file, or lacks a field."""
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(path.read_text(encoding="utf-8-sig"), str(path))
        s = parser["Sequence"]
        frames, width, height = (int(s[key]) for key in ("seqLength", "imWidth", "imHeight"))
        return SeqInfo(s["name"], float(s["frameRate"]), frames, width, height, s["imExt"], s["imDir"])
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except (configparser.Error, KeyError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def write_seqmap(path: Path, names: Iterable[str]) -> None:
    """The list of sequences that TrackEval asks for; its first line is `name`."""
    write_text(path, "\n".join(["name", *names]) + "\n")
