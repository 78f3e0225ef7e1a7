"""Row times of a rolling shutter and of an exposure: bearings of all rows, moved to the time of the frame by the odometry."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Pose
from tracker.types import Mount


def row_delays(bearings: Array, mount: Mount) -> Array:
    """Times (n,) s from the middle of the exposure of the rows in which bearings (n, 3) are seen to the time of the frame.

    The time of the frame is the end of the exposure of the last row. A row in the share s of the height is read out (1 − s) · readout before that.
    """
    pixels, _ = mount.camera.pixels_from_bearings(bearings)
    return np.asarray(mount.exposure / 2 + mount.readout * np.clip(1 - pixels[:, 1] / mount.camera.height, 0, 1))


def turned_to_frame(bearings: Array, mount: Mount, T_before_now: Pose, period: float) -> Array:
    """Unit bearings (n, 3) of far points as the camera would see them at the time of the frame.

    The robot turns evenly within a period of `period` s.
    """
    if not (mount.readout or mount.exposure) or not len(bearings):
        return bearings
    turn = mount.T_body_camera.rotation.T @ T_before_now.log()[3:]
    # A point that stands still turns against the camera, here from the row's time to the frame's. The series is exact to the third order.
    w = -(row_delays(bearings, mount) / period)[:, None] * turn
    once = np.cross(w, bearings)
    out = bearings + once + np.cross(w, once) / 2
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def moved_to_frame(bearings: Array, ranges: Array, mount: Mount, T_before_now: Pose, period: float) -> Array:
    """Bearings (n, 3) of `turned_to_frame` of points that are `ranges` (n,) m away, less the parallax of the camera's way since their rows.

    The camera moves evenly: by (v + ω × t) · delay / period in the body, with [v, ω] the logarithm of T_before_now and t its place in the body.
    """
    if not (mount.readout or mount.exposure) or not len(bearings):
        return bearings
    motion, T = T_before_now.log(), mount.T_body_camera
    way = T.rotation.T @ (motion[:3] + np.cross(motion[3:], T.translation))
    out = ranges[:, None] * bearings - (row_delays(bearings, mount) / period)[:, None] * way
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
