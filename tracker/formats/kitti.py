"""KITTI odometry: trajectories of 12 numbers a line, times, and calibrations of rectified cameras (Geiger et al. 2012)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Pose
from tracker.io.atomic import write_text

CAMERAS = 4
"""Cameras of a calibration: P0 to P3."""


def write_poses(path: Path, poses: Iterable[Pose]) -> None:
    """Write poses, one a line: the upper three rows of the 4 × 4 matrix, row by row, in metres. Reading gives the same float64."""
    write_text(path, "".join(f"{_numbers(pose_matrix(pose))}\n" for pose in poses))


def write_times(path: Path, times: Sequence[float]) -> None:
    """Write times [s], one a line."""
    write_text(path, "".join(f"{time:.9e}\n" for time in times))


def write_calibration(path: Path, projections: Sequence[Array], transform: Pose) -> None:
    """Write P0 to P3, each (3, 4) px from points in the frame of camera 0, and Tr, the pose of the body's frame in that of camera 0.

    Where there are fewer than four cameras, the last is repeated, since readers want four.
    """
    filled = [projections[min(k, len(projections) - 1)] for k in range(CAMERAS)]
    lines = [f"P{k}: {_numbers(P)}\n" for k, P in enumerate(filled)]
    write_text(path, "".join(lines) + f"Tr: {_numbers(pose_matrix(transform))}\n")


def pose_matrix(pose: Pose) -> Array:
    """(3, 4): rotation and translation."""
    return np.column_stack([pose.rotation, pose.translation])


def _numbers(matrix: Array) -> str:
    return " ".join(repr(float(x) + 0.0) for x in matrix.ravel())
