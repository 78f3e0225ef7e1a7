"""A room whose cameras are not calibrated, and errors of a calibration after the best similarity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.tracker.recordings.walked_room import walked_room
from tracker.calibration import Calibration
from tracker.calibration.body import angles_of
from tracker.geometry import Array
from tracker.recordings import Recording, RecordingCamera


def blind(room: Recording, intrinsics: bool = False) -> Recording:
    """The recording without truth and area, of whose cameras the sizes alone are known, or the intrinsics, too."""
    cameras = {
        name: RecordingCamera.uncalibrated(camera.camera.width, camera.camera.height, camera.camera if intrinsics else None)
        for name, camera in room.cameras.items()
    }
    return replace(room, cameras=cameras, truth=None, area=None, visible={})


def late(room: Recording, name: str, frames: int) -> Recording:
    """The recording whose camera `name` is late: what it sees is in frames that are `frames` lower."""
    boxes = {frame - frames: of for frame, of in room.detections[name].items() if frame >= frames}
    return replace(room, detections={**room.detections, name: boxes})


def place_errors(found: Calibration, room: Recording) -> Array:
    """m (cameras,) from the true places, after the best rotation about the vertical, shift and factor."""
    z, w = (_places({name: cameras[name] for name in found.cameras}) for cameras in (found.cameras, room.cameras))
    a, b = z[0] - z[0].mean(), w[0] - w[0].mean()
    turn = np.vdot(a, b) / abs(np.vdot(a, b))
    factor = (np.vdot(a * turn, b).real + z[1] @ w[1]) / ((np.abs(a) ** 2).sum() + z[1] @ z[1])
    return np.asarray(np.hypot(np.abs(factor * turn * a - b), factor * z[1] - w[1]))


def _places(cameras: dict[str, RecordingCamera]) -> tuple[Array, Array]:
    at = np.array([camera.pose.translation for camera in cameras.values()])
    return at[:, 0] + 1j * at[:, 1], at[:, 2]


def tilt_errors(found: Calibration, room: Recording) -> Array:
    """Errors (cameras, 2) of pitch and roll, degrees."""
    pairs = [(angles_of(c.pose.rotation), angles_of(room.cameras[name].pose.rotation)) for name, c in found.cameras.items()]
    return np.degrees([[a[k] - b[k] for k in (0, 1)] for a, b in pairs])


__all__ = ["blind", "late", "place_errors", "tilt_errors", "walked_room"]
