"""Features found ahead of the filter: the robot's own "up", which images are searched, and that the filter takes what was found."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.tracker.slam.test_features import panorama
from tracker.geometry import Array, Pose, exp_so3
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.sequence.calibration import calibration_of, setup_from
from tracker.slam.features import FeatureParameters, extract
from tracker.slam.filter import Slam
from tracker.slam.image_features import ImageFeatures, moved_to_frame, turned_to_frame
from tracker.slam.parameters import SlamParameters
from tracker.types import Detections, Mount, Odometry, Setup, Start, Tick, View

CAMERA = Panorama(1024, 512)
T_BODY_CAMERA = Pose(exp_so3(np.array([0.0, 0.1, 0.0])), np.array([0.0, 0.0, 0.5]))
TILTED = exp_so3(np.array([0.2, -0.1, 0.6]))


def setup(start: Start | None) -> Setup:
    return Setup({"c": Mount(CAMERA, T_BODY_CAMERA, "r")}, Flat(), {"r": start}, 0.25)


def started(rotation: Array, sigma: float = 0.01) -> Start:
    return Start(Pose(rotation, np.zeros(3)), sigma**2 * np.eye(6))


def driven(rotations: list[Array], rng: np.random.Generator, sigma: float = 0.012, bias: float = 0.001) -> list[Odometry | None]:
    """Odometry of a robot that turns: its gyroscope is off by `bias` rad a tick in roll, its accelerometer by `sigma` rad an axis."""
    out: list[Odometry | None] = [None]
    for before, now in pairwise(rotations):
        gravity = exp_so3(sigma * rng.normal(size=3)) @ now[2]
        out.append(Odometry(Pose(before.T @ now @ exp_so3(np.array([bias, 0, 0])), np.zeros(3)), 1e-6 * np.eye(6), gravity, sigma))
    return out


def turned(features: ImageFeatures, odometry: list[Odometry | None]) -> None:
    """Give a robot its odometry, without images."""
    for k, one in enumerate(odometry):
        features.find(Tick(k, 0.25 * k, (View("c", Detections.none(), odometry=one),)))


def error(features: ImageFeatures, rotation: Array) -> float:
    """Angle between the robot's own "up" and the true one, rad."""
    return float(np.arccos(np.clip(features._up["r"] @ rotation[2], -1, 1)))


def test_up_is_that_of_the_body_while_it_turns_and_tilts() -> None:
    rotations = [exp_so3(np.array([0.15 * np.sin(k / 9), 0.1 * np.cos(k / 7), 0.0])) @ exp_so3(np.array([0.0, 0.0, 0.05 * k])) for k in range(200)]
    for start in (started(rotations[0]), None):
        features = ImageFeatures(setup(start), FeatureParameters())
        odometry = driven(rotations, np.random.default_rng(0))
        errors = []
        for k in range(200):
            features.find(Tick(k, 0.25 * k, (View("c", Detections.none(), odometry=odometry[k]),)))
            errors += [error(features, rotations[k])] if k > 20 else []
        # The gyroscope alone would be 0.2 rad off, the accelerometer alone 0.015 rad on average.
        assert np.mean(errors) < 0.013
        assert max(errors) < 0.03


def test_after_a_gap_and_after_a_motion_that_was_not_measured_the_accelerometer_counts() -> None:
    level = [np.eye(3)] * 5
    for gap in (1, 4):
        features = ImageFeatures(setup(started(np.eye(3))), FeatureParameters())
        turned(features, driven(level, np.random.default_rng(1)))
        still = Odometry(Pose.identity(), 1e-6 * np.eye(6), TILTED[2], 0.01)
        features.find(Tick(4 + gap, 1.0, (View("c", Detections.none(), odometry=still),)))
        assert error(features, TILTED) < 1e-9
    small = exp_so3(np.array([0.05, 0.0, 0.0]))
    features.find(Tick(9, 1.0, (View("c", Detections.none(), odometry=replace(still, gravity=(TILTED @ small)[2])),)))
    assert 0.03 < error(features, TILTED @ small) < 0.05, "one measurement turns it by a tenth"


def test_a_tilted_image_is_levelled_and_the_filter_takes_what_was_found() -> None:
    T_world_camera = TILTED @ T_BODY_CAMERA.rotation
    view = View("c", Detections.none(), image=panorama(T_world_camera))
    features, slam = ImageFeatures(setup(started(TILTED)), FeatureParameters()), Slam(setup(started(TILTED)), SlamParameters())
    tick = features.find(Tick(0, 0.0, (view,)))
    found = tick.views[0].features
    assert found is not None
    assert view.image is not None
    expected = extract(view.image, CAMERA, T_world_camera[2], Detections.none(), FeatureParameters()).sightings()
    np.testing.assert_allclose(found.bearing, expected.bearing, atol=1e-9)
    slam.step(tick)
    assert len(slam.sighted["c"]) > 100
    again = Tick(1, 0.25, (replace(view, sightings=found),))
    assert ImageFeatures(setup(started(TILTED)), FeatureParameters()).find(again) is again


def test_images_of_fixed_cameras_are_not_searched() -> None:
    fixed = ImageFeatures(setup(Start(Pose.identity(), np.zeros((6, 6)))), FeatureParameters())
    tick = Tick(0, 0.0, (View("c", Detections.none(), image=np.zeros((512, 1024, 3), np.uint8)),))
    assert fixed.find(tick) is tick


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
    with pytest.raises(ValueError, match=rf"camera 'robot_0_camera': {key} is 2.0, needs a number from 0 to 1: seconds"):
        setup_from(written, ground, None)
    del written["cameras"]["robot_0_camera"][key]
    assert getattr(setup_from(written, ground, None).mounts["robot_0_camera"], key) == 0
