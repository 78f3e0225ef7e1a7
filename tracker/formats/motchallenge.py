"""MOTChallenge 2015 files, 2-D and 3-D: CSV without a header, ten values a row.

frame (from 1), id (−1 in detections), left, top, width, height (pixels; all four −1 where there is no box), confidence (0 in a truth
file: a row that does not count), x, y, z (m; all three −1 where there is no position). Frames are kept as the file has them: subtract
1 for the index of a Tick.

MOTChallenge 2016, 2017 and 2020: truth in nine values a row (twelve with MOTSynth's place on the ground), and what lies beside it.

frame (from 1), id, left, top, width, height (pixels, the first is 1), consider (0: the row does not count), class (1: pedestrian),
visibility in [0, 1]; MOTSynth adds x, y, z of the feet (m). Detections and results are files of ten values (motchallenge.read_mot15).
"""

from __future__ import annotations

import configparser
import os
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, frozen
from tracker.io.atomic import write_text

COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence", "x", "y", "z")

ABSENT = -1.0

# The kit of the 3-D challenge takes an exact 0 for "absent"; tools write this many metres instead.
NUDGE = 1e-9

LARGEST = 2**53
"""What readers of this format hold numbers in is a float: whole ones are exact below this."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of one file: frame (n,) from 1, id (n,), box (n, 4) left, top, width, height px, confidence (n,), position (n, 3) m.

    Raises ValueError for a frame below 1, a negative width or height (all four −1 aside), NaN, or an id (−1 aside) that comes twice in
    a frame.
    """

    frame: Ints
    id: Ints
    box: Array
    confidence: Array
    position: Array

    def __post_init__(self) -> None:
        n = len(self.frame)
        for name, shape in (("box", (n, 4)), ("confidence", (n,)), ("position", (n, 3))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))
        for name in ("frame", "id"):
            object.__setattr__(self, name, whole(getattr(self, name), n, name))
        fault = first_fault(self.frame, self.id, self.box)
        if fault is not None:
            raise ValueError(f"row {fault[0]}: {fault[1]}")

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def positioned(self) -> NDArray[np.bool_]:
        """(n,) whether the row has a position: x, y, z are not all −1."""
        return np.asarray((self.position != ABSENT).any(axis=1))

    @property
    def boxed(self) -> NDArray[np.bool_]:
        """(n,) whether the row has a box: it is not all −1."""
        return _boxed(self.box)

    def by_frame(self) -> dict[int, NDArray[np.int64]]:
        """Frame → the indices of its rows, frames ascending, rows in the order of the file."""
        if not len(self):
            return {}
        order = np.argsort(self.frame, kind="stable")
        frames, first = np.unique(self.frame[order], return_index=True)
        return {int(f): rows for f, rows in zip(frames, np.split(order, first[1:]), strict=True)}


def whole(values: Ints, n: int, name: str) -> Ints:
    """A read-only copy of n whole numbers. Raises ValueError, with the name, for another shape."""
    array = np.array(values, dtype=np.int64)
    if array.shape != (n,):
        raise ValueError(f"{name} has shape {array.shape}, needs ({n},)")
    array.flags.writeable = False
    return array


def _boxed(box: Array) -> NDArray[np.bool_]:
    return np.asarray((box != ABSENT).any(axis=1))


def first_fault(frame: Ints, ids: Ints, box: Array) -> tuple[int, str] | None:
    """The first row that no file may hold, from 0, and what is wrong with it; None where all is well."""
    faults: list[tuple[int, str]] = []
    for name, values, bad, bound in (
        ("frame", frame, frame < 1, "at least 1"),
        ("id", ids, np.abs(ids) >= LARGEST, "less than 2^53"),
        ("width", box[:, 2], _boxed(box) & (box[:, 2] < 0), "at least 0"),
        ("height", box[:, 3], _boxed(box) & (box[:, 3] < 0), "at least 0"),
    ):
        if bad.any():
            k = int(np.argmax(bad))
            faults.append((k, f"{name} is {values[k]}, needs {bound}"))
    seen: set[tuple[int, int]] = set()
    for k, key in enumerate(zip(frame.tolist(), ids.tolist(), strict=True)):
        if key in seen:
            faults.append((k, f"frame {key[0]} holds id {key[1]} twice"))
            break
        if key[1] != -1:
            seen.add(key)
    return min(faults, default=None)


def read_mot15(path: str | os.PathLike[str]) -> Rows:
    """Read a MOT15 file, truth, detections or results; blank lines are passed over.

    Raises ValueError naming file and line: not ten values, not a finite number, a frame or an id that is no whole number, and all
    that Rows refuses. OSError where the file cannot be read.
    """
    table = read_rows(path, COLUMNS)
    frame, ids = table[:, :2].astype(np.int64).T
    return Rows(frame, ids, table[:, 2:6], table[:, 6], table[:, 7:10])


def read_rows(path: str | os.PathLike[str], columns: tuple[str, ...], whole: tuple[str, ...] = ("frame", "id")) -> Array:
    """A file of such columns, frame, id and box first → (n, columns) numbers; those of `whole` are whole numbers.

    Raises ValueError as read_mot15.
    """
    values: list[list[float]] = []
    lines: list[int] = []
    for count, line in enumerate(_text(path).splitlines(), start=1):
        if line.strip():
            values.append(_values(line, f"{path}:line {count}", columns, whole))
            lines.append(count)
    table = np.array(values, dtype=np.float64).reshape(-1, len(columns))
    frame, ids = table[:, :2].astype(np.int64).T
    fault = first_fault(frame, ids, table[:, 2:6])
    if fault is not None:
        raise ValueError(f"{path}:line {lines[fault[0]]}: {fault[1]}")
    return table


def _text(path: str | os.PathLike[str]) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: byte {error.start} is not UTF-8") from None


def _values(line: str, where: str, columns: tuple[str, ...], whole: tuple[str, ...]) -> list[float]:
    parts = line.split(",")
    if len(parts) != len(columns):
        raise ValueError(f"{where}: {len(parts)} values, needs {len(columns)}")
    out: list[float] = []
    for name, part in zip(columns, parts, strict=True):
        try:
            value = float(part)
        except ValueError:
            raise ValueError(f"{where}: {name} is {part.strip()!r}, needs a number") from None
        if not np.isfinite(value):
            raise ValueError(f"{where}: {name} is {value}, needs a finite number")
        if name in whole and (value != round(value) or abs(value) >= LARGEST):
            raise ValueError(f"{where}: {name} is {part.strip()}, needs a whole number below 2^53")
        out.append(value)
    return out


def write_mot15(path: str | os.PathLike[str], rows: Rows) -> None:
    """Write `rows` sorted by frame, then id, every number so that it reads back the same.

    The one exception: an x or y of exactly 0 in a row with a position is written as 1e-9 m, because the 3-D kit takes 0 for absent.
    The file appears whole or not at all.
    """
    position = np.array(rows.position)
    planar = position[:, :2]
    planar[(planar == 0) & rows.positioned[:, None]] = NUDGE
    out = []
    for k in np.lexsort((rows.id, rows.frame)):
        numbers = [*rows.box[k], rows.confidence[k], *position[k]]
        out.append(",".join([str(int(rows.frame[k])), str(int(rows.id[k])), *(number(x) for x in numbers)]) + "\n")
    write_text(Path(path), "".join(out))


def number(value: float) -> str:
    """The shortest text that reads back as the same number; whole numbers without a point."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def rows_from_tracks(tracks: dict[int, tuple[Ints, Array]]) -> Rows:
    """Frame (from 1) → (ids (k,), positions (k, 3) m) to Rows without boxes, confidence 1."""
    columns: dict[str, list[float]] = defaultdict(list)
    positions: list[Array] = []
    for frame, (ids, position) in sorted(tracks.items()):
        columns["frame"] += [frame] * len(ids)
        columns["id"] += np.asarray(ids).tolist()
        positions.append(np.asarray(position, dtype=np.float64).reshape(-1, 3))
    n = len(columns["id"])
    return Rows(
        np.array(columns["frame"], dtype=np.int64),
        np.array(columns["id"], dtype=np.int64),
        np.full((n, 4), ABSENT),
        np.ones(n),
        np.concatenate([np.zeros((0, 3)), *positions]),
    )


MOT17_COLUMNS = ("frame", "id", "left", "top", "width", "height", "consider", "class", "visibility")

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
    columns = MOT17_COLUMNS + PLACE if many == len(MOT17_COLUMNS + PLACE) else MOT17_COLUMNS
    table = read_rows(path, columns, WHOLE)
    frame, ids, consider, category = table[:, [0, 1, 6, 7]].astype(np.int64).T
    try:
        return Annotated(frame, ids, table[:, 2:6], consider, category, table[:, 8], table[:, 9:] if len(columns) > len(MOT17_COLUMNS) else None)
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
