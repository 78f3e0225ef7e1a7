"""TUM trajectories: lines `timestamp tx ty tz qx qy qz qw` in seconds and metres, quaternion xyzw; `#` begins a comment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Pose, quaternion_from_rotation, rotation_from_quaternion
from tracker.io.atomic import write_text
from tracker.io.text_files import parse_number, read_lines
from tracker.io.time_order import LARGEST_STEP_BACK, first_large_step_back, say, time_order

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def read_tum(path: str | os.PathLike[str]) -> tuple[Array, list[Pose]]:
    """Read times (n,) s, strictly ascending, and n poses.

    Rows a little out of order are sorted and repeated rows merged, as in tracker/io/time_order.py; their numbers are logged.
    Raises ValueError with file and line for an invalid row, a large step back, and two poses of one time.
    """
    lines: list[int] = []
    rows: list[Array] = []
    for number, line in read_lines(path):
        content = line.partition("#")[0].split()
        if content:
            rows.append(_row(content, f"{path}:line {number}"))
            lines.append(number)
    table = np.array(rows).reshape(-1, len(COLUMNS))
    if fault := first_large_step_back(table[:, 0]):
        k, before = fault
        steps = f"timestamp is {table[k, 0]} after {table[before, 0]} in line {lines[before]}"
        raise ValueError(f"{path}:line {lines[k]}: {steps}, needs steps back of less than {LARGEST_STEP_BACK} s")
    order = time_order(table)
    table = table[order.rows]
    for k in (np.flatnonzero(np.diff(table[:, 0]) <= 0) + 1)[:1]:
        raise ValueError(f"{path}:line {lines[order.rows[k]]}: timestamp is {table[k, 0]} for a second time, with another pose")
    say(order.note(str(path)))
    return table[:, 0], [Pose(rotation_from_quaternion(row[[7, 4, 5, 6]]), row[1:4]) for row in table]


def _row(parts: list[str], where: str) -> Array:
    if len(parts) != len(COLUMNS):
        raise ValueError(f"{where}: {len(parts)} values, needs {len(COLUMNS)}")
    values = np.array([parse_number(part, f"{where}: {name}") for name, part in zip(COLUMNS, parts, strict=True)])
    if not abs(np.linalg.norm(values[4:]) - 1) < 1e-3:
        raise ValueError(f"{where}: the quaternion has length {np.linalg.norm(values[4:]):.6g}, needs 1")
    return values


def write_tum(path: str | os.PathLike[str], times: Sequence[float] | Array, poses: Sequence[Pose]) -> None:
    """Write times (n,) s and n poses T_world_body atomically. Raises ValueError where the lengths differ."""
    if len(times) != len(poses):
        raise ValueError(f"trajectory has {len(poses)} poses, needs {len(times)}")
    lines = ["# " + " ".join(COLUMNS) + "\n"]
    for time, pose in zip(times, poses, strict=True):
        w, x, y, z = quaternion_from_rotation(pose.rotation)
        lines.append(" ".join(repr(float(value)) for value in (time, *pose.translation, x, y, z, w)) + "\n")
    write_text(Path(path), "".join(lines))
