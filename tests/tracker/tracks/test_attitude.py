"""Attitude of moving robots: an error that all people of a view share is found, and boxes without people, or of a sure robot, change nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.geometry import Array, Pose, angles_from_bearing, bearing_from_angles, exp_so3
from tracker.tracks.attitude import corrected_pose
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.tracks import Places
from tracker.types import Detections, View

SETUP = synthetic_crowd.setup(1)
CAMERA = next(iter(SETUP.mounts))
TILT, NOISE, STATURE = np.radians(0.15), np.radians(0.1), 1.7
PARAMETERS = MhtParameters()
COVARIANCE = np.diag([1e-4, 1e-4, 1e-4, TILT**2, TILT**2, TILT**2])


def people(n: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    distance, azimuth = rng.uniform(4, 25, n), rng.uniform(-np.pi, np.pi, n)
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=1)


def true_pose() -> Pose:
    start = SETUP.starts[SETUP.mounts[CAMERA].robot]
    assert start is not None
    return start.T_world_robot


def seen(place: Array, seed: int, noise: float = NOISE) -> Detections:
    """Boxes of people at places (n, 2) m, as the true camera sees them."""
    rng, T = np.random.default_rng(seed), true_pose() @ SETUP.mounts[CAMERA].T_body_camera
    ends = []
    for height in (0.0, STATURE):
        rays = np.column_stack([place, np.full(len(place), height)]) - T.translation
        rays[:, :2] *= 1 - PARAMETERS.fusion.ahead * (height == 0) / np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
        ends.append(np.stack(angles_from_bearing(rays @ T.rotation), axis=1) + rng.normal(0, noise, (len(place), 2)))
    (across, low), (_, high) = (end.T for end in ends)
    extent = np.stack([np.full(len(place), 0.05), high - low], axis=1)
    covariance = np.tile(NOISE**2 * np.eye(2), (len(place), 1, 1))
    return Detections(bearing_from_angles(across, (low + high) / 2), extent, np.ones(len(place)), covariance, np.zeros((len(place), 0)))


def error_of(turn: Array, of: tuple[Pose, Array]) -> Array:
    """What is left (3,) rad of a turn of the true pose, in the frame of the robot."""
    return np.array(Pose(true_pose().rotation.T @ of[0].rotation, np.zeros(3)).log()[3:])


def corrected(turn: Array, detections: Detections, places: Places, covariance: Array = COVARIANCE) -> tuple[Pose, Array]:
    wrong = Pose(exp_so3(turn) @ true_pose().rotation, true_pose().translation)
    return corrected_pose(SETUP, (wrong, covariance), View(CAMERA, detections), places, PARAMETERS)


def sure(place: Array) -> Places:
    return Places(place, np.tile(0.05**2 * np.eye(2), (len(place), 1, 1)))


@pytest.mark.parametrize("n", [5, 40])
def test_an_error_of_all_people_is_found_with_its_covariance(n: int) -> None:
    rng, squares, left = np.random.default_rng(0), [], []
    for seed in range(60):
        turn, place = rng.normal(0, TILT, 3), people(n, seed)
        found = corrected(turn, seen(place, seed), sure(place))
        error = error_of(turn, found)
        left.append(np.linalg.norm(error))
        squares.append(error @ np.linalg.solve(found[1][3:, 3:], error))
        np.testing.assert_array_equal(found[0].translation, true_pose().translation)
        np.testing.assert_array_equal(found[1][:3, :3], COVARIANCE[:3, :3])
    assert np.mean(left) < (0.6 if n == 5 else 0.3) * np.sqrt(3) * TILT
    assert np.mean(squares) / 3 < 1.3


def test_boxes_that_end_above_the_feet_hardly_matter() -> None:
    place = people(20, 3)
    turn = np.array([TILT, -TILT, TILT])
    boxes = seen(place, 3)
    across, up = angles_from_bearing(boxes.bearing)
    short = np.arange(20) < 6
    half = boxes.extent[:, 1] / 2
    raised = replace(
        boxes,
        bearing=bearing_from_angles(across, np.where(short, up + half / 2, up)),
        extent=np.stack([boxes.extent[:, 0], np.where(short, half, 2 * half)], axis=1),
    )
    assert np.linalg.norm(error_of(turn, corrected(turn, raised, sure(place)))) < 0.5 * np.linalg.norm(turn)
    hidden = replace(raised, feet_seen=~short)
    columns = ("bearing", "covariance", "extent", "confidence", "appearance", "feet_seen")
    fewer = replace(boxes, **{name: getattr(boxes, name)[~short] for name in columns})
    a, b = (corrected(turn, detections, sure(place)) for detections in (hidden, fewer))
    np.testing.assert_allclose(a[0].rotation, b[0].rotation, atol=1e-12)


@pytest.mark.parametrize("case", ["no people", "no boxes", "nobody near a box", "sure pose"])
def test_nothing_changes_without_evidence(case: str) -> None:
    place, turn = people(10, 1), np.array([0.0, TILT, 0.0])
    boxes, places, covariance = seen(place, 1), sure(place), COVARIANCE
    if case == "no people":
        places = sure(np.zeros((0, 2)))
    elif case == "no boxes":
        boxes = seen(np.zeros((0, 2)), 1)
    elif case == "nobody near a box":
        places = sure(-2 * place)
    else:
        covariance = np.zeros((6, 6))
    wrong = exp_so3(turn) @ true_pose().rotation
    pose, P = corrected(turn, boxes, places, covariance)
    np.testing.assert_array_equal(pose.rotation, wrong)
    np.testing.assert_array_equal(P, covariance)
