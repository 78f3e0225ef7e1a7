"""MOT15 (MOTChallenge 2015, 2-D and 3-D): boxes, detections and tracks as rows of ten values; reader and writer.

Recordings and results of pilsim are in this form, too. Files are CSV without a header. Frames count from 1; the index of a Tick is the frame less 1.

Columns: frame, id, left, top, width, height (pixels), confidence, x, y, z (m). The id is −1 in detections. All four values of the box
are −1 where there is no box, and x, y, z are −1 where there is no position. A truth row with confidence 0 does not count.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array, set_ints
from tracker.io.atomic import write_text
from tracker.io.csv_tables import LARGEST_WHOLE, check_rows, faults_at_lines, read_rows
from tracker.io.text_files import read_lines
from tracker.io.time_order import say_repeated

COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence", "x", "y", "z")
WHOLE = ("frame", "id")
"""Columns of whole numbers."""

TRUTH_COLUMNS = ("frame", "id", "left", "top", "width", "height", "consider", "class", "visibility")
"""Columns of the truth of MOT16, MOT17 and MOT20."""
PEDESTRIAN, DISTRACTORS = 1, (2, 7, 8, 12)
"""Classes: a person on foot; a person on a vehicle, a static person, a distractor, a reflection, which detectors take for people."""
ABSENT = -1.0

ZERO_SUBSTITUTE = 1e-9
"""m: written for an x or y of exactly 0, which the evaluation kit of the 3-D challenge takes for an absent position."""

VISIBLE_FILE = ".visible.txt"
"""Ending of a file beside CAMERA.txt with a row for each of its rows. Its boxes are visible parts, its confidences visible shares."""

MAX_FRAME = 200_000
"""Highest number of a frame. A sequence takes about 1 kB of memory for each frame up to the last, empty frames included."""
LARGEST_PIXEL = 1e9
"""Bound of the numbers of a box, px. It keeps products and powers finite."""


@dataclass(frozen=True, eq=False)
class Mot15Rows:
    """The rows of a MOT15 file: frame (n,) from 1, id (n,), box (n, 4) left, top, width, height px, confidence (n,), position (n, 3) m.

    Raises ValueError for a frame below 1, a negative width or height, NaN, and for an id that occurs twice in a frame.
    Absent boxes and ids of −1 are allowed.
    """

    frame: Ints
    id: Ints
    box: Array
    confidence: Array
    position: Array

    def __post_init__(self) -> None:
        n = len(self.frame)
        for name, shape in (("box", (n, 4)), ("confidence", (n,)), ("position", (n, 3))):
            set_array(self, name, shape)
        for name in ("frame", "id"):
            set_ints(self, name, (n,))
        has_box, size = self.has_box, self.box[:, 2:]
        check_rows(
            ("frame", self.frame, self.frame < 1, "at least 1"),
            ("id", self.id, np.abs(self.id) >= LARGEST_WHOLE, "less than 2^53"),
            ("width", size[:, 0], has_box & (size[:, 0] < 0), "at least 0"),
            ("height", size[:, 1], has_box & (size[:, 1] < 0), "at least 0"),
            keys=np.column_stack([self.frame, self.id]),
        )

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def has_position(self) -> Mask:
        """(n,) whether each row has a position: x, y, z are not all −1."""
        return np.asarray((self.position != ABSENT).any(axis=1))

    @property
    def has_box(self) -> Mask:
        """(n,) whether each row has a box: its values are not all −1."""
        return np.asarray((self.box != ABSENT).any(axis=1))

    def by_frame(self) -> dict[int, Ints]:
        """Frame → indices of its rows, frames ascending, rows in the order of the file."""
        if not len(self):
            return {}
        order = np.argsort(self.frame, kind="stable")
        frames, first = np.unique(self.frame[order], return_index=True)
        return {int(f): rows for f, rows in zip(frames, np.split(order, first[1:]), strict=True)}


def read_mot15(path: str | os.PathLike[str], tracks: bool = False) -> Mot15Rows:
    """Read a MOT15 file: truth, detections or results. Blank lines are skipped. tracks: whether every row needs an id, as truth and results have.

    A row that equals one before it in every column is left out; their number is logged.
    Raises ValueError with file and line for a row without ten finite numbers, a frame or id that is no whole number, and as Mot15Rows.
    """
    lines, table, repeated = _different(path, COLUMNS)
    say_repeated(path, repeated)
    frame, ids = table[:, :2].astype(np.int64).T
    if tracks and (ids < 0).any():
        k = int(np.argmax(ids < 0))
        raise ValueError(f"{path}:{lines[k]}: id is {ids[k]}, needs at least 0; detections, whose ids are -1, are no tracks")
    with faults_at_lines(path, lines):
        return Mot15Rows(frame, ids, table[:, 2:6], table[:, 6], table[:, 7:10])


def _different(path: str | os.PathLike[str], columns: Sequence[str]) -> tuple[Ints, Array, int]:
    """Lines (n,) and values (n, columns) of the distinct rows, and the number of repeated rows."""
    lines, table = read_rows(Path(path), columns, WHOLE)
    kept = different_rows(table)
    return lines[kept], table[kept], len(table) - len(kept)


def different_rows(table: Array) -> Ints:
    """Index of the first occurrence of each distinct row of a table (n, columns), ascending."""
    return np.sort(np.unique(table, axis=0, return_index=True)[1]) if len(table) else np.arange(0)


def read_mot_truth(path: str | os.PathLike[str]) -> tuple[Mot15Rows, Ints]:
    """The truth of MOT15, or of MOT16 to MOT20 (nine columns: …, consider, class, visibility), and the class of each row (n,).

    With nine columns, the confidence is `consider`. All rows of MOT15 are pedestrians.
    Raises ValueError as read_mot15.
    """
    if _columns_of(path) == COLUMNS:
        rows = read_mot15(path, tracks=True)
        return rows, np.full(len(rows), PEDESTRIAN)
    lines, values = read_rows(Path(path), TRUTH_COLUMNS, (*WHOLE, "class"))
    kind, frame, ids = values[:, 7].astype(np.int64), *values[:, :2].astype(np.int64).T
    with faults_at_lines(path, lines):
        return Mot15Rows(frame, ids, values[:, 2:6], values[:, 6], np.full((len(values), 3), ABSENT)), kind


def _columns_of(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The columns of a file: those of MOT16 to MOT20 if its first line has as many, else those of MOT15."""
    first = next((line for _, line in read_lines(path)), "")
    return TRUTH_COLUMNS if first.count(",") == len(TRUTH_COLUMNS) - 1 else COLUMNS


def place_of_row(path: str | os.PathLike[str], row: int) -> str:
    """The place of a row of read_mot15 or read_mot_truth, counted from 0, for an error message: "path:N". The file is read again."""
    return f"{path}:{_different(path, _columns_of(path))[0][row]}"


def write_mot15(path: str | os.PathLike[str], rows: Mot15Rows) -> None:
    """Write `rows` atomically, sorted by frame, then id. Every number reads back the same.

    The exception is an x or y of exactly 0 in a row with a position: it is written as ZERO_SUBSTITUTE.
    """
    position = np.array(rows.position)
    planar = position[:, :2]
    planar[(planar == 0) & rows.has_position[:, None]] = ZERO_SUBSTITUTE
    out = []
    for k in np.lexsort((rows.id, rows.frame)):
        numbers = [*rows.box[k], rows.confidence[k], *position[k]]
        out.append(",".join([str(int(rows.frame[k])), str(int(rows.id[k])), *(number(x) for x in numbers)]) + "\n")
    write_text(Path(path), "".join(out))


def number(value: float) -> str:
    """The shortest text that reads back as the same number; whole numbers have no decimal point."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def rows_from_tracks(tracks: dict[int, tuple[Ints, Array]]) -> Mot15Rows:
    """Tracks as rows without boxes, confidence 1. tracks: frame (from 1) → ids (k,) and positions (k, 3) m."""
    ordered = sorted(tracks.items())
    frame = np.repeat(np.array([frame for frame, _ in ordered], dtype=np.int64), [len(ids) for _, (ids, _) in ordered])
    ids = np.concatenate([np.zeros(0, dtype=np.int64), *(np.asarray(ids, dtype=np.int64) for _, (ids, _) in ordered)])
    positions = np.concatenate([np.zeros((0, 3)), *(np.asarray(position, dtype=np.float64).reshape(-1, 3) for _, (_, position) in ordered)])
    return Mot15Rows(frame, ids, np.full((len(ids), 4), ABSENT), np.ones(len(ids)), positions)


def rows_from_boxes(boxes: Mapping[int, tuple[Array, Array]]) -> Mot15Rows:
    """Detections as rows without ids and positions. boxes: frame (from 1) → boxes (k, 4) px and confidence (k,)."""
    frame = np.repeat(np.array(list(boxes), dtype=np.int64), [len(box) for box, _ in boxes.values()])
    box = np.concatenate([np.zeros((0, 4)), *(box for box, _ in boxes.values())])
    confidence = np.concatenate([np.zeros(0), *(confidence for _, confidence in boxes.values())])
    return Mot15Rows(frame, np.full(len(frame), -1), box, confidence, np.full((len(frame), 3), ABSENT))


def read_detections(path: str | os.PathLike[str]) -> dict[int, tuple[Array, Array]]:
    """Read a MOT15 file: frame (from 1) → boxes (n, 4) left, top, width, height px and confidence (n,).

    Frames without detections have no entry. Raises ValueError as read_mot15, and with the frame of a detection without a box.
    """
    rows = read_mot15(path)
    if not rows.has_box.all():
        row = int(np.argmin(rows.has_box))
        raise ValueError(f"{place_of_row(path, row)}: frame {rows.frame[row]} has a detection without a box, needs width and height")
    large = np.abs(rows.box).max(axis=1, initial=0.0)
    if len(rows) and large.max() > LARGEST_PIXEL:
        row = int(np.argmax(large))
        raise ValueError(f"{place_of_row(path, row)}: box is {rows.box[row].tolist()}, needs pixels up to {LARGEST_PIXEL:g}")
    if len(rows) and rows.frame.max() > MAX_FRAME:
        raise ValueError(f"{place_of_row(path, int(np.argmax(rows.frame)))}: frame is {rows.frame.max()}, needs at most {MAX_FRAME}")
    return {frame: (rows.box[k], rows.confidence[k]) for frame, k in rows.by_frame().items()}
