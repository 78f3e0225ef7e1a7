"""UTIAS Multi-Robot Cooperative Localization and Mapping (MRCLAM; Leung et al. 2011): logs of five robots and fifteen landmarks with barcodes.

RobotN_Odometry.dat: time s, commanded speed m/s, turn rate rad/s. RobotN_Measurement.dat: time s, barcode, range m, bearing rad.
RobotN_Groundtruth.dat: time s, x, y m, heading rad. Landmark_Groundtruth.dat: subject, x, y, their standard deviations m.
Barcodes.dat: subject, barcode. Subjects 1 to 5 are the robots, 6 to 20 the landmarks. `#` begins a comment.

Logs of real robots have rows out of order and repeated rows. Rows that step back by less than LARGEST_STEP_BACK are sorted, and rows that equal
another in every column are merged; `UtiasDataset.repairs` counts both. Other steps back are errors.

The landmark table of set 1 has landmarks 11 and 17 swapped. With the table as it is, 13 % of all measurements disagree with the ground truth.
With the two positions exchanged, 0.01 % do. The reader recognizes the set by these positions and exchanges them (`UtiasDataset.repairs`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Ints
from tracker.io.csv_tables import read_rows
from tracker.io.time_order import LARGEST_STEP_BACK, counted, first_large_step_back, time_order

ROBOTS = range(1, 6)
SWAPPED = {11: (3.15071999, 2.38294871), 17: (0.03596156, -2.84396626)}
"""The swapped landmarks of set 1 and their positions in its table, m."""
MIN_RANGE = 0.05
"""m: measurements of a smaller range are rejected."""
LONG_GAP = 60.0
"""s: a longer gap of the odometry is an interrupted log or a wrong clock. In UTIAS sets the longest one is 2 s."""
MAX_TIME = 1e11
"""s: the year 5138 as a Unix time. Larger times are milliseconds or microseconds."""
MAX_VALUE = 1e6
"""Largest range, position, speed and angle (m, m/s, rad, rad/s), and largest subject and barcode."""


@dataclass(frozen=True, eq=False)
class UtiasRobot:
    """The log of one robot.

    odometry (n, 3): time s, m/s, rad/s, in order of time. truth (k, 4): time s, x, y m, heading rad, times strictly ascending.
    measurements (m, 3): range-bearing measurements: time s, range m, bearing rad, in order of time. subject (m,): what each measures.
    rejected: reason → number of measurements that were left out.
    """

    odometry: Array
    measurements: Array
    subject: Ints
    truth: Array
    rejected: dict[str, int]


@dataclass(frozen=True, eq=False)
class UtiasDataset:
    """A data set. robots: number → log. landmarks: subject → position (2,) m. repairs: errors of the data set that the reader has corrected."""

    robots: dict[int, UtiasRobot]
    landmarks: dict[int, Array]
    repairs: tuple[str, ...]


def is_utias(path: Path) -> bool:
    """Whether a folder holds an MRCLAM data set."""
    return (path / "Barcodes.dat").is_file()


def read_utias(path: Path) -> UtiasDataset:
    """Read a data set. A robot without any file is left out.

    Raises ValueError for a missing file. Raises ValueError with file and line for an invalid number and for two different true poses of one time.
    The same holds for a time that steps back by LARGEST_STEP_BACK or more.
    """
    codes, table = _table(path / "Barcodes.dat", 2), _table(path / "Landmark_Groundtruth.dat", 5)
    repairs = [codes.merge_repeated(), table.merge_repeated()]
    subject_of = {code: subject for subject, code in codes.whole_numbers((0, 1), unique=1)}
    landmarks = {subject: place for (subject,), place in zip(table.whole_numbers((0,), unique=0), table.values[:, 1:3], strict=True)}
    for k, subject in enumerate(landmarks):
        if subject in ROBOTS:
            raise ValueError(f"{table.where(k)}: subject of a landmark is {subject}, needs at least {ROBOTS.stop}; 1 to {ROBOTS.stop - 1} are robots")
    if all(s in landmarks and np.allclose(landmarks[s], place, atol=1e-6) for s, place in SWAPPED.items()):
        landmarks[11], landmarks[17] = landmarks[17], landmarks[11]
        repairs.append("landmarks 11 and 17 of set 1 exchanged")
    present = [n for n in ROBOTS if any((path / f"Robot{n}_{kind}.dat").exists() for kind in ("Odometry", "Measurement", "Groundtruth"))]
    if not present:
        raise ValueError(f"{path}: no Robot1_Odometry.dat to Robot5_Odometry.dat, needs at least one robot")
    subjects = {*present, *landmarks}
    robots = {n: _robot(path, n, subject_of, subjects, repairs) for n in present}
    return UtiasDataset(robots, landmarks, tuple(filter(None, repairs)))


def _robot(path: Path, number: int, subject_of: dict[int, int], subjects: set[int], repairs: list[str]) -> UtiasRobot:
    """The log of a robot; notes on what was sorted and merged are added to `repairs`."""
    columns = {"Odometry": 3, "Groundtruth": 4, "Measurement": 4}
    tables = {name: _table(path / f"Robot{number}_{name}.dat", count) for name, count in columns.items()}
    repairs += [table.sort() for table in tables.values()]
    odometry, truth, raw = (table.values for table in tables.values())
    for name in ("Odometry", "Groundtruth"):
        if not len(tables[name].values):
            raise ValueError(f"{tables[name].path}: no rows, needs at least one")
    twice = np.flatnonzero(np.diff(truth[:, 0]) <= 0)
    if len(twice):
        k = int(twice[0]) + 1
        raise ValueError(f"{tables['Groundtruth'].where(k)}: time is {truth[k, 0]:.3f} for a second time with another pose, needs one pose a time")
    early = truth[:, 0] < odometry[0, 0] - LONG_GAP
    if early.any() and not early.all():
        # A robot starts at its first true pose, and nothing is known of its motion so long before its odometry.
        repairs.append(
            f"{tables['Groundtruth'].path.name}: {counted(int(early.sum()), 'row')} more than {LONG_GAP:.0f} s before the odometry left out"
        )
        truth = truth[~early]
    subject = np.array([subject_of.get(code, -1) for code in raw[:, 1].tolist()], dtype=np.int64)
    reasons = np.full(len(raw), "", dtype="U24")
    reasons[raw[:, 2] < MIN_RANGE] = "range not above zero"
    reasons[subject == number] = "robot sees itself"
    reasons[~np.isin(subject, list(subjects))] = "subject not in the set"
    reasons[subject < 0] = "barcode not in the table"
    good = reasons == ""
    return UtiasRobot(odometry, raw[good][:, [0, 2, 3]], subject[good], truth, dict(Counter(reasons[~good].tolist())))


@dataclass(eq=False)
class _Table:
    """A table (n, columns) of finite numbers. line (n,): that of each row in the file."""

    path: Path
    values: Array
    line: Ints

    def where(self, k: int) -> str:
        """Path and line of row k."""
        return f"{self.path}:{self.line[k]}"

    def sort(self) -> str:
        """Sort by time and merge repeated rows. Returns a note on both. Raises ValueError for a time out of bounds, and for a large step back."""
        times = self.values[:, 0]
        for k in np.flatnonzero(np.abs(times) > MAX_TIME)[:1].tolist():
            raise ValueError(f"{self.where(k)}: time is {times[k]:.6g}, needs seconds, at most {MAX_TIME:.0e}")
        if fault := first_large_step_back(times):
            k, before = fault
            steps = f"time is {times[k]:.3f} after {times[before]:.3f} in line {self.line[before]}"
            raise ValueError(f"{self.where(k)}: {steps}, needs steps back of less than {LARGEST_STEP_BACK} s")
        order = time_order(self.values)
        self.values, self.line = self.values[order.rows], self.line[order.rows]
        return order.note(self.path.name)

    def merge_repeated(self) -> str:
        """Leave out rows that equal an earlier one. Returns a note on them."""
        first = np.sort(np.unique(self.values, axis=0, return_index=True)[1]) if len(self.values) else self.line
        repeated = len(self.values) - len(first)
        self.values, self.line = self.values[first], self.line[first]
        return f"{self.path.name}: {counted(repeated, 'repeated row')} merged" if repeated else ""

    def whole_numbers(self, columns: tuple[int, ...], unique: int) -> list[tuple[int, ...]]:
        """The `columns` of each row as whole numbers. Raises ValueError for others, and for two rows with the same number in column `unique`."""
        seen: dict[float, int] = {}
        for k, row in enumerate(self.values.tolist()):
            for column in columns:
                if not 0 <= row[column] <= MAX_VALUE or row[column] != round(row[column]):
                    raise ValueError(f"{self.where(k)}: value {column + 1} is {row[column]:g}, needs a whole number from 0 to {MAX_VALUE:g}")
            if seen.setdefault(row[unique], k) != k:
                raise ValueError(f"{self.where(k)}: value {unique + 1} is {row[unique]:g} as in line {self.line[seen[row[unique]]]}")
        return [tuple(int(row[column]) for column in columns) for row in self.values.tolist()]


def _table(path: Path, columns: int) -> _Table:
    """Read a table of finite numbers, whose first column is a time or a subject. Raises ValueError with path and line."""
    lines, values = read_rows(path, [f"value {k + 1}" for k in range(columns)], separator=None, comment="#")
    for k, column in np.argwhere(np.abs(values[:, 1:]) > MAX_VALUE)[:1].tolist():
        raise ValueError(f"{path}:{lines[k]}: value {column + 2} is {values[k, column + 1]:g}, needs at most {MAX_VALUE:g} in size")
    return _Table(path, values, lines)
