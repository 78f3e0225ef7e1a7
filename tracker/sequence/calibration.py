"""The calibration of a sequence as JSON: cameras, their mounts, and the start poses of the robots; writer and reader."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Items
from dataclasses import asdict
from typing import Any

import numpy as np

from tracker.geometry import Mask, Pose, quaternion_from_rotation, rotation_from_quaternion
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai
from tracker.geometry.ground import Ground
from tracker.io.json_files import JsonObject
from tracker.types import Mount, Setup, Start

MAX_RATE, MIN_RATE = 1e4, 1e-4
"""Frames per second. A period beyond these bounds overflows what the tracker computes from it."""
MODELS: dict[str, type[Panorama | Cylinder | Pinhole | Fisheye | Tsai]] = {
    "panorama": Panorama,
    "tsai": Tsai,
    "pinhole": Pinhole,
    "fisheye": Fisheye,
    "cylinder": Cylinder,
}
"""Name of a camera model in the file → class; the fields of the class are those in the file."""


def pose_row(pose: Pose) -> list[float]:
    """A pose as x, y, z m, qw, qx, qy, qz."""
    return [*map(float, pose.translation), *map(float, quaternion_from_rotation(pose.rotation))]


def pose_from(row: Items[float]) -> Pose:
    """The pose that pose_row wrote."""
    return Pose(rotation_from_quaternion(row[3:7]), np.array(row[:3]))


def calibration_of(setup: Setup) -> dict[str, Any]:
    """A setup without its ground as JSON values. Raises ValueError for a camera whose class is not in MODELS."""
    return {
        "period": setup.period,
        "height": list(setup.height),
        "cameras": {
            name: _camera_json(mount.camera)
            | {"robot": mount.robot, "T_body_camera": pose_row(mount.T_body_camera)}
            | {key: value for key, value in (("readout", mount.readout), ("exposure", mount.exposure)) if value}
            | own_body_entry(mount.own_body)
            for name, mount in setup.mounts.items()
        },
        "starts": {
            name: {"T_world_robot": pose_row(start.T_world_robot), "covariance": start.covariance.tolist()} if start else None
            for name, start in setup.starts.items()
        },
    }


def setup_from(calibration: Mapping[str, Any], ground: Ground, occluders: Ground | None) -> Setup:
    """The setup that calibration_of wrote, with ground and occluders. Raises KeyError, TypeError or ValueError for other content."""
    mounts = {}
    for name, entry in calibration["cameras"].items():
        fields = JsonObject(entry, f"camera {name!r}")
        readout, exposure = (fields.number(key, 0.0, 1.0, "seconds") if key in entry else 0.0 for key in ("readout", "exposure"))
        own_body = own_body_from(entry, f"own_body of camera {name!r}")
        mounts[name] = Mount(_camera_from(entry), pose_from(entry["T_body_camera"]), entry["robot"], readout, exposure, own_body=own_body)
    starts = {
        name: Start(pose_from(entry["T_world_robot"]), np.array(entry["covariance"])) if entry else None
        for name, entry in calibration["starts"].items()
    }
    low, high = (float(height) for height in calibration["height"])
    period = calibration["period"]
    if isinstance(period, bool) or not isinstance(period, int | float) or not 1 / MAX_RATE <= period <= 1 / MIN_RATE:
        raise ValueError(f"period is {str(period)[:40]} s, needs {1 / MAX_RATE:g} to {1 / MIN_RATE:g}")
    if not 0 <= low < high:
        raise ValueError(f"height is {low:g} to {high:g} m, needs at least 0, the lowest first")
    return Setup(mounts, ground, starts, period, height=(low, high), occluders=occluders)


def own_body_entry(own_body: Mask | None) -> dict[str, list[str]]:
    """The field "own_body" of a camera, from that of Mount: rows of 0 and 1 over all directions, as in a panorama. Empty for None."""
    return {} if own_body is None else {"own_body": ["".join("01"[cell] for cell in row) for row in own_body.astype(int)]}


def own_body_from(entry: Mapping[str, Any], where: str) -> Mask | None:
    """Where a camera sees its own robot, or None. Raises ValueError that begins with `where` for other values than rows of 0 and 1 of one length."""
    rows = entry.get("own_body")
    if rows is None:
        return None
    if not isinstance(rows, list) or not rows or not all(isinstance(row, str) and row and not set(row) - {"0", "1"} for row in rows):
        raise ValueError(f"{where} is {str(rows)[:40]}, needs rows of 0 and 1")
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f"{where} has rows of several lengths, needs one")
    return np.array([[cell == "1" for cell in row] for row in rows])


def _camera_json(camera: Camera) -> dict[str, Any]:
    for model, kind in MODELS.items():
        if isinstance(camera, kind):
            return {"model": model} | asdict(camera)
    raise ValueError(f"camera is a {type(camera).__name__}, needs one of {', '.join(MODELS)}")


def _camera_from(entry: Mapping[str, Any]) -> Camera:
    kind = MODELS.get(entry["model"])
    if kind is None:
        raise ValueError(f"model is {entry['model']!r}, needs one of {', '.join(MODELS)}")
    # Older files have no field of view of a fisheye.
    return kind(**{name: entry[name] for name in kind.__dataclass_fields__ if name != "field_of_view" or name in entry})
