"""MOTChallenge 2015 files, 2-D and 3-D: CSV without a header, ten values a row.

frame (from 1), id (−1 in detections), left, top, width, height (pixels; all four −1 where there is no box), confidence (0 in a truth
file: a row that does not count), x, y, z (m; all three −1 where there is no position). Frames are kept as the file has them: subtract
1 for the index of a Tick.
"""

from __future__ import annotations

import os
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.atomic import write_text
from tracker.geometry import Array, frozen

Ints = NDArray[np.int64]

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
