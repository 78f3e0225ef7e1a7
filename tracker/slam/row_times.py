"""Row times of a rolling shutter: bearings of all rows, turned to the time of the frame by the odometry."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Pose
from tracker.types import Mount


def at_frame_time(bearings: Array, mount: Mount, T_before_now: Pose, period: float) -> Array:
    """Unit bearings (n, 3) as the camera would see them at the end of its last row, which is the time of the frame.

    A row in the share s of the height is read out (1 − s) · readout before that. The robot turns evenly within a period of `period` s.
    Its motion within the readout is not corrected: it is below 2 cm for the usual rovers.
    """
    if not mount.readout or not len(bearings):
        return bearings
    pixels, _ = mount.camera.pixels_from_bearings(bearings)
    before = mount.readout * np.clip(1 - pixels[:, 1] / mount.camera.height, 0, 1)
    turn = mount.T_body_camera.rotation.T @ T_before_now.log()[3:]
    # A point that stands still turns against the camera, here from the row's time to the frame's. The series is exact to the third order.
    w = -(before / period)[:, None] * turn
    once = np.cross(w, bearings)
    out = bearings + once + np.cross(w, once) / 2
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
