"""TUM trajectories: lines `timestamp tx ty tz qx qy qz qw` in seconds and metres, quaternion xyzw; `#` begins a comment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Pose, quaternion_from_rotation, rotation_from_quaternion
from tracker.io.atomic import write_text
from tracker.io.text_files import parse_number, read_lines

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def read_tum(path: str | os.PathLike[str]) -> tuple[Array, list[Pose]]:
    """Read times (n,) s, strictly ascending, and n poses. Raises ValueError with file and line."""
    times: list[float] = []
    poses: list[Pose] = []
    for number, line in read_lines(path):
        content = line.partition("#")[0].split()
        if content:
            time, pose = _pose(content, f"{path}:line {number}")
            if times and not time > times[-1]:
                raise ValueError(f"{path}:line {number}: timestamp is {time}, needs more than {times[-1]}, the one before")
            times.append(time)
            poses.append(pose)
    return np.array(times), poses


def _pose(parts: list[str], where: str) -> tuple[float, Pose]:
    if len(parts) != len(COLUMNS):
        raise ValueError(f"{where}: {len(parts)} values, needs {len(COLUMNS)}")
    values = np.array([parse_number(part, f"{where}: {name}") for name, part in zip(COLUMNS, parts, strict=True)])
    if not abs(np.linalg.norm(values[4:]) - 1) < 1e-3:
        raise ValueError(f"{where}: the quaternion has length {np.linalg.norm(values[4:]):.6g}, needs 1")
    return float(values[0]), Pose(rotation_from_quaternion(values[[7, 4, 5, 6]]), values[1:4])


def write_tum(path: str | os.PathLike[str], times: Sequence[float] | Array, poses: Sequence[Pose]) -> None:
    """Write times (n,) s and n poses T_world_body atomically. Raises ValueError where the lengths differ."""
    if len(times) != len(poses):
        raise ValueError(f"trajectory has {len(poses)} poses, needs {len(times)}")
    lines = ["# " + " ".join(COLUMNS) + "\n"]
    for time, pose in zip(times, poses, strict=True):
        w, x, y, z = quaternion_from_rotation(pose.rotation)
        lines.append(" ".join(repr(float(value)) for value in (time, *pose.translation, x, y, z, w)) + "\n")
    write_text(Path(path), "".join(lines))
