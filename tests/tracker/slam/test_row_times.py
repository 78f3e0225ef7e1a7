"""Bearings of a rolling shutter against those of poses computed row by row."""

from dataclasses import replace

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.sequence.calibration import calibration_of, setup_from
from tracker.slam.image_features import moved_to_frame, turned_to_frame
from tracker.types import Mount, Setup, Start

CAMERA = Panorama(1024, 512)
MOUNT = Mount(CAMERA, Pose.exp(np.array([0.1, 0.0, 1.4, 0.0, 0.05, 0.4])), "robot_0", readout=0.03)
MOTION = Pose.exp(np.array([0.2, 0.02, -0.01, 0.1, -0.08, 0.12]))


@pytest.mark.parametrize(("distance", "exposure"), [(1e9, 0.0), (3.0, 0.0), (3.0, 0.02)])
def test_rows_are_moved_to_the_time_of_the_frame(distance: float, exposure: float) -> None:
    """Points, each seen at the pose of its own row, come out where the camera at the end of the frame sees them."""
    rng, period, mount = np.random.default_rng(0), 1 / 6, replace(MOUNT, exposure=exposure)
    true = rng.normal(size=(200, 3))
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    seen = true.copy()
    for _ in range(20):  # The row of a point and its time depend on each other.
        share = CAMERA.pixels_from_bearings(seen)[0][:, 1] / CAMERA.height
        for k in range(len(true)):
            since = (0.03 * (1 - share[k]) + exposure / 2) / period
            T_now_row = mount.T_body_camera.inverse() @ Pose.exp(-since * MOTION.log()) @ mount.T_body_camera
            seen[k] = T_now_row.inverse().apply(distance * true[k : k + 1])[0]
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    raw = np.linalg.norm(seen - true, axis=1)
    turned = turned_to_frame(seen, mount, MOTION, period)
    moved = moved_to_frame(turned, np.full(len(true), distance), mount, MOTION, period)
    left, far = np.linalg.norm(moved - true, axis=1), np.linalg.norm(turned - true, axis=1)
    assert raw.max() > 0.01
    assert left.max() < (5e-4 if distance < 10 else 1e-5)
    assert distance > 10 or left.max() < far.max() / 20


def test_without_readout_nothing_changes() -> None:
    bearings = np.eye(3)
    mount = Mount(CAMERA, Pose.identity(), "robot_0")
    assert turned_to_frame(bearings, mount, MOTION, 0.1) is bearings
    assert moved_to_frame(bearings, np.ones(3), mount, MOTION, 0.1) is bearings


@pytest.mark.parametrize("key", ["readout", "exposure"])
def test_the_calibration_holds_times_of_rows(key: str) -> None:
    ground = Flat(0.0)
    start = Start(Pose.identity(), np.eye(6))
    mount = Mount(CAMERA, Pose.identity(), "robot_0", **{key: 0.03})  # type: ignore[arg-type]
    written = calibration_of(Setup({"robot_0_camera": mount}, ground, {"robot_0": start}, 0.1))
    assert getattr(setup_from(written, ground, None).mounts["robot_0_camera"], key) == 0.03
    written["cameras"]["robot_0_camera"][key] = 2.0
    with pytest.raises(ValueError, match=rf"{key} of camera 'robot_0_camera' is 2.0 s, needs 0 to 1"):
        setup_from(written, ground, None)
    del written["cameras"]["robot_0_camera"][key]
    assert getattr(setup_from(written, ground, None).mounts["robot_0_camera"], key) == 0
