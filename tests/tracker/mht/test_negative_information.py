"""Negative information: posteriors against samples, and a person who stops behind a wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import FusionParameters
from tracker.detections.occlusion import Bodies, Viewpoint
from tracker.geometry import Array, Mask
from tracker.geometry.ground import Grid
from tracker.mht.negative_information import ExpectedVisibility
from tracker.mht.track_trees import TrackHypotheses, initiated
from tracker.pipeline import Parameters, Tracker
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import MotionParameters
from tracker.types import Setup

PARAMETERS = MhtParameters(fusion=FusionParameters(reach=60.0))
DETECTION = np.array([0.9])


def walled(end: float = 2.0) -> Setup:
    """Level ground with a wall along x, from (-2, 0) to (`end`, 0) m, between the view and what is to the north of it."""
    tops = np.zeros((81, 81))
    tops[40:42, 32 : round(41 + 4 * end)] = 2.5
    grid = [Grid(heights, np.array([-10.0, -10.0]), 0.25) for heights in (np.zeros((81, 81)), tops)]
    return replace(synthetic_crowd.setup(1), ground=grid[0], occluders=grid[1])


def leaf(place: tuple[float, float], sigma: float) -> TrackHypotheses:
    group = CrossViewGroup(((0, 0),), np.array(place), sigma**2 * np.eye(2))
    return initiated(1, [group], MotionParameters(), (1.7, 0.1), (1, 0, 0))


def visibility(setup: Setup, leaves: TrackHypotheses, missed: Mask | None = None) -> tuple[ExpectedVisibility, list[Viewpoint]]:
    views = []
    for name, mount in setup.mounts.items():
        start = setup.starts[mount.robot]
        assert start is not None
        views.append(Viewpoint(name, mount.camera, start.T_world_robot @ mount.T_body_camera))
    return ExpectedVisibility.of(leaves, views, SensorModel(setup, PARAMETERS), np.arange(0), missed), views


def test_posteriors_match_samples() -> None:
    setup, leaves = walled(), leaf((0.0, 2.0), 1.2)
    found, views = visibility(setup, leaves)
    state, covariance = found.given_misses(leaves.state, leaves.covariance, np.zeros((1, 1), dtype=bool), DETECTION)
    place = np.random.default_rng(0).multivariate_normal(leaves.state[0, :2], leaves.covariance[0, :2, :2], 50_000)
    bodies = Bodies(place, np.ones(len(place), dtype=np.int64), np.arange(0), setup, lambda camera, cover: np.ones(len(cover)))
    share = bodies.expected_detection(views[0], PARAMETERS.fusion.reach)
    weight = 1 - DETECTION * share
    expected: Array = weight @ place / weight.sum()
    assert found.share[0, 0] == pytest.approx(share.mean(), abs=0.05)
    np.testing.assert_allclose(state[0, :2], expected, atol=0.1)
    apart = place - expected
    np.testing.assert_allclose(covariance[0, :2, :2], (weight[:, None] * apart).T @ apart / weight.sum(), atol=0.1)
    assert np.linalg.norm(expected - place.mean(axis=0)) > 0.2


@pytest.mark.parametrize("why", ["seen", "sure", "unknown", "left out"])
def test_detected_and_certain_leaves_and_leaves_in_unknown_worlds_are_unchanged(why: str) -> None:
    setup, leaves = walled(), leaf((0.0, 2.0), 0.2 if why == "sure" else 1.2)
    setup = replace(setup, occluders=None) if why == "unknown" else setup
    found = visibility(setup, leaves, np.full((1, 1), why != "left out"))[0]
    state, covariance = found.given_misses(leaves.state, leaves.covariance, np.full((1, 1), why == "seen"), DETECTION)
    np.testing.assert_array_equal(state, leaves.state)
    np.testing.assert_array_equal(covariance, leaves.covariance)


@pytest.mark.parametrize("known", [False, True])
def test_a_person_who_stops_behind_a_wall_is_not_reported_beyond_it(known: bool) -> None:
    setup = walled(end=-1.0)
    # The wall hides from x = -1.1 m to 0.2 m; they stop at -0.5 m.
    x = np.minimum(-6.0 + 1.4 / synthetic_crowd.RATE * np.arange(60), -0.5)
    path = np.stack([x, np.full(60, 1.2)], axis=1)[:, None, :]
    ticks = synthetic_crowd.ticks(setup, path, np.random.default_rng(0), misses=0.0, clutter=0.0, lose=lambda frame, camera, person: x[frame] > -1.1)
    tracker, farthest = Tracker(setup if known else replace(setup, occluders=None), Parameters()), -np.inf
    for tick in ticks:
        estimate = tracker.step(tick)
        assert estimate is not None
        farthest = max(farthest, float(estimate.position[:, 0].max(initial=-np.inf)))
    assert (farthest < 0.3) == known
