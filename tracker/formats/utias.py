"""UTIAS Multi-Robot Cooperative Localization and Mapping (MRCLAM; Leung et al. 2011): logs of five robots and fifteen landmarks with barcodes.

RobotN_Odometry.dat: time s, commanded speed m/s, turn rate rad/s. RobotN_Measurement.dat: time s, barcode, range m, bearing rad.
RobotN_Groundtruth.dat: time s, x, y m, heading rad. Landmark_Groundtruth.dat: subject, x, y, their standard deviations m.
Barcodes.dat: subject, barcode. Subjects 1 to 5 are the robots, 6 to 20 the landmarks. `#` begins a comment.

The landmark table of set 1 has landmarks 11 and 17 swapped. With the table as it is, 13 % of all measurements disagree with the ground truth.
With the two positions exchanged, 0.01 % do. The reader recognizes the set by these positions and exchanges them (`UtiasDataset.repairs`).
"""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Ints

ROBOTS = range(1, 6)
SWAPPED = {11: (3.15071999, 2.38294871), 17: (0.03596156, -2.84396626)}
"""The swapped landmarks of set 1 and their positions in its table, m."""
MIN_RANGE = 0.05
"""m: measurements of a smaller range are rejected."""


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

    Raises ValueError with file and line for a missing file, an invalid number, and decreasing times in odometry or truth.
    """
    codes = _columns(path / "Barcodes.dat", 2)
    subject_of = {int(code): int(subject) for subject, code in codes}
    if len(subject_of) != len(codes):
        raise ValueError(f"{path / 'Barcodes.dat'}: {len(codes)} subjects share {len(subject_of)} barcodes, needs one each")
    table = _columns(path / "Landmark_Groundtruth.dat", 5)
    landmarks = {int(row[0]): row[1:3] for row in table}
    repairs = []
    if all(s in landmarks and np.allclose(landmarks[s], place, atol=1e-6) for s, place in SWAPPED.items()):
        landmarks[11], landmarks[17] = landmarks[17], landmarks[11]
        repairs.append("landmarks 11 and 17 of set 1 exchanged")
    present = [n for n in ROBOTS if any((path / f"Robot{n}_{kind}.dat").exists() for kind in ("Odometry", "Measurement", "Groundtruth"))]
    if not present:
        raise ValueError(f"{path}: no Robot1_Odometry.dat to Robot5_Odometry.dat, needs at least one robot")
    subjects = {*present, *landmarks}
    return UtiasDataset({n: _robot(path, n, subject_of, subjects) for n in present}, landmarks, tuple(repairs))


def _robot(path: Path, number: int, subject_of: dict[int, int], subjects: set[int]) -> UtiasRobot:
    odometry = _columns(path / f"Robot{number}_Odometry.dat", 3)
    truth = _columns(path / f"Robot{number}_Groundtruth.dat", 4)
    for name, times, least in (("Odometry", odometry[:, 0], 0.0), ("Groundtruth", truth[:, 0], 1e-9)):
        back = np.flatnonzero(np.diff(times) < least)
        if len(back):
            k = int(back[0])
            raise ValueError(f"{path / f'Robot{number}_{name}.dat'}: time is {times[k + 1]:.3f} after {times[k]:.3f}, needs ascending times")
        if not len(times):
            raise ValueError(f"{path / f'Robot{number}_{name}.dat'}: no rows, needs at least one")
    raw = _columns(path / f"Robot{number}_Measurement.dat", 4)
    raw = raw[np.argsort(raw[:, 0], kind="stable")]
    subject = np.array([subject_of.get(int(code), -1) for code in raw[:, 1]], dtype=np.int64)
    reasons = np.full(len(raw), "", dtype="U24")
    reasons[raw[:, 2] < MIN_RANGE] = "range not above zero"
    reasons[subject == number] = "robot sees itself"
    reasons[~np.isin(subject, list(subjects))] = "subject not in the set"
    reasons[subject < 0] = "barcode not in the table"
    good = reasons == ""
    return UtiasRobot(odometry, raw[good][:, [0, 2, 3]], subject[good], truth, dict(Counter(reasons[~good].tolist())))


def _columns(path: Path, columns: int) -> Array:
    """Read a table (n, columns) of finite numbers. Raises ValueError "path:line …"."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: byte {error.start} is not UTF-8") from None
    try:
        values = np.loadtxt(io.StringIO(text), ndmin=2)
        if values.size == 0:
            return np.zeros((0, columns))
        if values.shape[1] == columns and np.isfinite(values).all():
            return values
    except ValueError:
        pass
    # The fast parser does not tell the line of an error.
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.partition("#")[0].split()
        try:
            wrong = bool(cells) and (len(cells) != columns or not np.isfinite([float(cell) for cell in cells]).all())
        except ValueError:
            wrong = True
        if wrong:
            raise ValueError(f"{path}:line {number} is {line.strip()[:60]!r}, needs {columns} finite numbers")
    raise ValueError(f"{path}: cannot be read, needs rows of {columns} numbers")
