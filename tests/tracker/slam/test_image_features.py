"""Features found ahead of the filter: the robot's own "up", which images are searched, and that the filter takes what was found."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from tests.tracker.slam.test_features import panorama
from tracker.geometry import Array, Pose, exp_so3
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.features import FeatureParameters, extract
from tracker.slam.filter import Slam
from tracker.slam.image_features import ImageFeatures
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
