from __future__ import annotations

import numpy as np
import pytest

from tracker.ekf.state import JointState
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.landmark_initialization import FeatureTracks, InitializationParameters, LandmarkInitializer
from tracker.slam.landmark_map import LandmarkMap
from tracker.types import Mount, Sightings, Start

MOUNT = Mount(Panorama(64, 32), Pose(np.eye(3), np.array([0, 0, 0.5])), "r")
SIGMA = 0.001


def drive(
    points: np.ndarray, step: float, sigma: float = 0.0, seed: int = 0, trial: InitializationParameters | None = None, velocity: float = 0.0
) -> tuple[JointState, LandmarkInitializer]:
    """A robot along x, ten ticks, a clone at every other; the points may move along y by `velocity` m a tick."""
    rng = np.random.default_rng(seed)
    joint, book = JointState(clones=4, capacity=10, correction_sigma=None), LandmarkMap(10, 1)
    joint.join(Start(Pose.identity(), 1e-12 * np.eye(6)))
    frontier = LandmarkInitializer(0, MOUNT, (joint, book), Flat(0.0), trial or InitializationParameters())
    for k in range(10):
        if k:
            joint.predict(0, Pose(np.eye(3), np.array([step, 0, 0])), 1e-14 * np.eye(6))
        p = points + np.array([-step * k, velocity * k, -0.5])
        b = p / np.linalg.norm(p, axis=1, keepdims=True)
        b = b + (sigma * rng.normal(size=(len(b), 1, 2)) @ tangent_basis(b))[:, 0]
        b /= np.linalg.norm(b, axis=1, keepdims=True)
        n = len(points)
        seen = Sightings(b, np.full(n, np.nan), np.arange(n), np.zeros((n, 4), dtype=np.float32), np.tile(np.eye(2) * SIGMA**2, (n, 1, 1)))
        known = book.subject[: book.count]
        frontier.advance(seen, np.flatnonzero(~np.isin(np.arange(n), known)), 10, k)
        if k % 2 == 0:
            joint.clone(0, (k // 2) % 4)
            frontier.remember((k // 2) % 4)
    return joint, frontier


def test_points_are_placed_once_the_rays_cross() -> None:
    points = np.array([[3.0, 2, 1], [-2, 4, 0.5], [1, -3, 2]])
    joint, frontier = drive(points, 0.12)
    assert frontier.counters["new"] == 3
    order = np.argsort(frontier.book.subject[:3])
    np.testing.assert_allclose(joint.point[:3][order], points, atol=0.02)
    assert len(frontier.candidates) == 0


def test_without_a_baseline_nothing_is_placed() -> None:
    joint, frontier = drive(np.array([[3.0, 2, 1]]), 0.0)
    assert joint.count == 0
    assert frontier.counters["little parallax"] > 0


@pytest.mark.parametrize(("point", "reason"), [((2.0, 3.0, -1.0), "below ground"), ((1.0, 5.0, 0.6), "out of range")])
def test_refusals_have_reasons(point: tuple[float, float, float], reason: str) -> None:
    joint, frontier = drive(np.array([point]), 0.15, trial=InitializationParameters(farthest=4.0))
    assert joint.count == 0
    assert frontier.counters[reason] > 0


def test_a_thing_that_moves_is_not_placed_where_it_was() -> None:
    """Moving across the line of sight of a robot that drives past: the rays of three ticks do not meet."""
    joint, frontier = drive(np.array([[1.0, 2, 1]]), 0.12, velocity=-0.15)
    assert joint.count == 0 or frontier.counters["rays disagree"] > 0


def test_the_new_covariance_is_honest() -> None:
    errors = []
    for seed in range(60):
        joint, frontier = drive(np.array([[1.5, 3, 1]]), 0.1, SIGMA, seed)
        assert frontier.counters["new"] == 1
        e = joint.point[0] - [1.5, 3, 1]
        errors.append(e @ np.linalg.solve(joint.P[-3:, -3:], e) / 3)
    assert 0.5 < np.mean(errors) < 1.6


def candidates(directions: np.ndarray) -> FeatureTracks:
    c, n = FeatureTracks(2), len(directions)
    c.born(0, np.zeros(3), (directions, directions, np.tile(np.eye(2), (n, 1, 1))), (np.eye(n, dtype=np.float32), np.full(n, -1)))
    return c


def test_candidates_are_looked_for_along_their_way_only() -> None:
    c, look = candidates(np.array([[0.0, 1, 0]])), (np.ones((1, 1), dtype=np.float32), np.array([-1]))
    eye = np.array([0.1, 0, 0])
    for point, found in (([0, 2, 0], True), ([0, 50, 0], True), ([0.2, 2, 0], False), ([0, 2, 0.2], False), ([0, -2, 0], False)):
        d = (np.array(point) - eye)[None]
        c = candidates(np.array([[0.0, 1, 0]]))
        assert (c.follow(eye, d / np.linalg.norm(d), look, InitializationParameters())[0] >= 0) == found, point


def test_a_tick_without_anything_to_follow_is_a_miss() -> None:
    """Rain on the lens, a white wall: candidates wait, and the next tick may see them again."""
    _, frontier = drive(np.array([[3.0, 2, 1]]), 0.0)
    candidates = len(frontier.candidates)
    assert candidates
    nothing = Sightings(np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 4), dtype=np.float32), np.zeros((0, 2, 2)))
    frontier.advance(nothing, np.zeros(0, dtype=np.int64), 10, 10)
    frontier.remember(1)
    assert len(frontier.candidates) == candidates


def test_blunt_bearings_must_cross_more_widely() -> None:
    rule = InitializationParameters()
    sharp, blunt = (rule.fitted(np.tile(np.eye(2) * np.deg2rad(noise) ** 2, (5, 1, 1))) for noise in (0.12, 0.5))
    assert sharp == rule == rule.fitted(np.zeros((0, 2, 2)))
    assert 2 * rule.parallax < blunt.parallax < 3 * rule.parallax
    assert 2 * rule.strip < blunt.strip < 3 * rule.strip
