"""Bearings of a rolling shutter against those of poses computed row by row."""

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.sequence.calibration import calibration_of, setup_from
from tracker.slam.row_times import at_frame_time
from tracker.types import Mount, Setup, Start

CAMERA = Panorama(1024, 512)
MOUNT = Mount(CAMERA, Pose.exp(np.array([0.1, 0.0, 1.4, 0.0, 0.05, 0.4])), "robot_0", readout=0.03)
MOTION = Pose.exp(np.array([0.0, 0.0, 0.0, 0.1, -0.08, 0.12]))


def test_rows_are_turned_to_the_time_of_the_frame() -> None:
    """Far points, each seen at the pose of its own row, come out where the camera at the end of the frame sees them."""
    rng, period = np.random.default_rng(0), 1 / 6
    true = rng.normal(size=(200, 3))
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    seen = true.copy()
    for _ in range(20):  # The row of a point and its time depend on each other.
        share = CAMERA.pixels_from_bearings(seen)[0][:, 1] / CAMERA.height
        for k in range(len(true)):
            since = 0.03 * (1 - share[k]) / period
            T_now_row = MOUNT.T_body_camera.inverse() @ Pose.exp(-since * MOTION.log()) @ MOUNT.T_body_camera
            seen[k] = T_now_row.rotation.T @ true[k]
    raw = np.linalg.norm(seen - true, axis=1)
    left = np.linalg.norm(at_frame_time(seen, MOUNT, MOTION, period) - true, axis=1)
    assert raw.max() > 0.01
    assert left.max() < 1e-5


def test_without_readout_nothing_changes() -> None:
    bearings = np.eye(3)
    assert at_frame_time(bearings, Mount(CAMERA, Pose.identity(), "robot_0"), MOTION, 0.1) is bearings


def test_the_calibration_holds_the_readout() -> None:
    ground = Flat(0.0)
    start = Start(Pose.identity(), np.eye(6))
    written = calibration_of(Setup({"robot_0_camera": MOUNT}, ground, {"robot_0": start}, 0.1))
    assert setup_from(written, ground, None).mounts["robot_0_camera"].readout == 0.03
    written["cameras"]["robot_0_camera"]["readout"] = 2.0
    with pytest.raises(ValueError, match=r"readout of camera 'robot_0_camera' is 2.0 s, needs 0 to 1"):
        setup_from(written, ground, None)
    del written["cameras"]["robot_0_camera"]["readout"]
    assert setup_from(written, ground, None).mounts["robot_0_camera"].readout == 0
