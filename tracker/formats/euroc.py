"""EuRoC MAV data (ASL): tables of images, of an IMU and of the true state with times in nanoseconds, and a sensor.yaml for each sensor.

Burri et al. 2016, "The EuRoC micro aerial vehicle datasets". Numbers are written so that reading gives the same float64.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Pose, quaternion_from_rotation
from tracker.io.atomic import write_text

IMAGES = ("timestamp [ns]", "filename")
IMU = ("timestamp [ns]", *(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"))
STATE = (
    "timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz"), *(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"),
    *(f"b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)  # fmt: skip
"""Columns of the three tables; their names stand in a first line after `#`."""


def write_images(path: Path, stamps: Sequence[int], names: Sequence[str]) -> None:
    """Write the table of a camera: times [ns] and names of the files in `data/`."""
    _write(path, IMAGES, (f"{stamp},{name}" for stamp, name in zip(stamps, names, strict=True)))


def write_imu(path: Path, stamps: Sequence[int], rates: Array, accelerations: Array) -> None:
    """Write n times [ns], angular rates (n, 3) rad/s and specific forces (n, 3) m/s², both in the sensor's frame."""
    _write(path, IMU, _rows(stamps, np.hstack([rates, accelerations])))


def write_states(path: Path, stamps: Sequence[int], poses: Sequence[Pose], velocities: Array, biases: Array) -> None:
    """Write n times [ns], poses T_R_S, velocities (n, 3) m/s in R, and biases (n, 6) of gyroscope rad/s and accelerometer m/s²."""
    places = np.array([[*pose.translation, *quaternion_from_rotation(pose.rotation)] for pose in poses]).reshape(-1, 7)
    _write(path, STATE, _rows(stamps, np.hstack([places, velocities, biases])))


def sensor_yaml(kind: str, comment: str, T_body_sensor: Pose, fields: dict[str, str | float | Sequence[float]]) -> str:
    """The text of a sensor.yaml. kind: camera, imu or visual-inertial. fields: what else it says, in order."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = T_body_sensor.rotation, T_body_sensor.translation
    numbers = ", ".join(repr(float(x) + 0.0) for x in matrix.ravel())
    lines = [f"sensor_type: {kind}", f"comment: {comment}", "T_BS:", "  cols: 4", "  rows: 4", f"  data: [{numbers}]"]
    for name, value in fields.items():
        shown = value if isinstance(value, str) else repr(value) if isinstance(value, float | int) else f"[{', '.join(map(repr, value))}]"
        lines.append(f"{name}: {shown}")
    return "\n".join(lines) + "\n"


def _rows(stamps: Sequence[int], numbers: Array) -> Iterable[str]:
    return (",".join([str(stamp), *(repr(float(x)) for x in row)]) for stamp, row in zip(stamps, numbers, strict=True))


def _write(path: Path, columns: Sequence[str], rows: Iterable[str]) -> None:
    write_text(path, "".join(f"{line}\n" for line in [f"#{','.join(columns)}", *rows]))
