"""UTIAS Multi-Robot Cooperative Localization and Mapping (MRCLAM; Leung, Halpern, Barfoot, Liu 2011): five robots, fifteen landmarks, by barcode.

RobotN_Odometry.dat: time s, speed m/s, turn rad/s, as commanded. RobotN_Measurement.dat: time s, barcode, range m, bearing rad.
RobotN_Groundtruth.dat: time s, x, y m, heading rad. Landmark_Groundtruth.dat: subject, x, y, their deviations m.
Barcodes.dat: subject, barcode. Subjects 1 to 5 are the robots, 6 to 20 the landmarks; `#` begins a comment.

In set 1 the table of landmarks has 11 and 17 swapped: with the table as it stands 13 % of all sightings disagree with the truth, with the two places
exchanged 0.01 %. The reader knows the set by these places and exchanges them (`Team.mended` says so).
"""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array

ROBOTS = range(1, 6)
SWAPPED = {11: (3.15071999, 2.38294871), 17: (0.03596156, -2.84396626)}
"""Subjects of set 1 and the places, m, that its table gives them by mistake: each has the other's."""
NEAREST = 0.05  # m: a camera is no nearer to anything


@dataclass(frozen=True, eq=False)
class Robot:
    """odometry (n, 3): time s, m/s, rad/s, times in order. Sightings: seen (m, 3) time s, range m, bearing rad, in order of time, and subject (m,).
    truth (k, 4): time s, x, y m, heading rad, times ascending. rejected: how many sightings were no use, by reason.
    """

    odometry: Array
    seen: Array
    subject: NDArray[np.int64]
    truth: Array
    rejected: dict[str, int]


@dataclass(frozen=True, eq=False)
class Team:
    """robots by number; landmarks: subject → (2,) m; mended: faults of the set that the reader has taken out."""

    robots: dict[int, Robot]
    landmarks: dict[int, Array]
    mended: tuple[str, ...]


def is_utias(path: Path) -> bool:
    """Whether a folder looks like a set of MRCLAM."""
    return (path / "Barcodes.dat").is_file()


def read_team(path: Path) -> Team:
    """Read a set; a robot of which there is no file is not in the team.

    Raises ValueError naming file and line where something is missing or no number, or where time goes back in odometry or truth.
    """
    codes = _columns(path / "Barcodes.dat", 2)
    subject_of = {int(code): int(subject) for subject, code in codes}
    if len(subject_of) != len(codes):
        raise ValueError(f"{path / 'Barcodes.dat'}: {len(codes)} subjects share {len(subject_of)} barcodes, needs one each")
    table = _columns(path / "Landmark_Groundtruth.dat", 5)
    landmarks = {int(row[0]): row[1:3] for row in table}
    mended = []
    if all(s in landmarks and np.allclose(landmarks[s], place, atol=1e-6) for s, place in SWAPPED.items()):
        landmarks[11], landmarks[17] = landmarks[17], landmarks[11]
        mended.append("landmarks 11 and 17 of set 1 exchanged")
    here = [n for n in ROBOTS if any((path / f"Robot{n}_{kind}.dat").exists() for kind in ("Odometry", "Measurement", "Groundtruth"))]
    if not here:
        raise ValueError(f"{path}: no Robot1_Odometry.dat to Robot5_Odometry.dat, needs at least one robot")
    things = {*here, *landmarks}
    return Team({n: _robot(path, n, subject_of, things) for n in here}, landmarks, tuple(mended))


def _robot(path: Path, number: int, subject_of: dict[int, int], things: set[int]) -> Robot:
    odometry = _columns(path / f"Robot{number}_Odometry.dat", 3)
    truth = _columns(path / f"Robot{number}_Groundtruth.dat", 4)
    for name, times, least in (("Odometry", odometry[:, 0], 0.0), ("Groundtruth", truth[:, 0], 1e-9)):
        back = np.flatnonzero(np.diff(times) < least)
        if len(back):
            k = int(back[0])
            raise ValueError(f"{path / f'Robot{number}_{name}.dat'}: time is {times[k + 1]:.3f} after {times[k]:.3f}, needs to go on")
        if not len(times):
            raise ValueError(f"{path / f'Robot{number}_{name}.dat'}: no rows, needs at least one")
    raw = _columns(path / f"Robot{number}_Measurement.dat", 4)
    raw = raw[np.argsort(raw[:, 0], kind="stable")]
    subject = np.array([subject_of.get(int(code), -1) for code in raw[:, 1]], dtype=np.int64)
    reasons = np.full(len(raw), "", dtype="U24")
    reasons[raw[:, 2] < NEAREST] = "range not above zero"
    reasons[subject == number] = "robot sees itself"
    reasons[~np.isin(subject, list(things))] = "subject not in the set"
    reasons[subject < 0] = "barcode not in the table"
    good = reasons == ""
    return Robot(odometry, raw[good][:, [0, 2, 3]], subject[good], truth, dict(Counter(reasons[~good].tolist())))


def _columns(path: Path, columns: int) -> Array:
    """(n, columns) finite numbers of a table. Raises ValueError "path:line …"."""
    try:
        text = path.read_text(encoding="utf-8")
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
    # Something is wrong: look again for the line.
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.partition("#")[0].split()
        try:
            wrong = bool(cells) and (len(cells) != columns or not np.isfinite([float(cell) for cell in cells]).all())
        except ValueError:
            wrong = True
        if wrong:
            raise ValueError(f"{path}:line {number} is {line.strip()[:60]!r}, needs {columns} finite numbers")
    raise ValueError(f"{path}: cannot be read, needs rows of {columns} numbers")
