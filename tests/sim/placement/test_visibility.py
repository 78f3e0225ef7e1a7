"""Visibility against MuJoCo's rays and in analytic scenes; the filter of a person; GOSPA."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim.placement.episode import gospa
from sim.placement.information import Beliefs, Views, detector_of
from sim.placement.map import MapKey, map_of
from sim.placement.visibility import (
    BLIND_RADIUS,
    BODY_POINTS,
    ElevationMap,
    VisibilityLimits,
    _body_point,
    _occluded_by_person,
    line_of_sight,
    seen_share,
    visible_points,
)
from tracker.detector_models.independent import IndependentErrors

FLAT = ElevationMap(np.zeros((41, 41)), np.array([-10.0, -10.0, 0.5]))
CAMERA = np.array([[0.0, 0.0, 1.5]])
UNLIMITED = VisibilityLimits(99.0, 0.0, 0.0)


def person(x: float, y: float, stature: float = 1.75) -> list[float]:
    return [x, y, 0.0, stature]


def test_on_a_plane_everybody_within_the_limits_is_seen():
    people = np.array([person(3.0, 0.0), person(0.0, -8.0), person(7.0, 7.0)])
    np.testing.assert_array_equal(seen_share(FLAT, CAMERA, people, UNLIMITED), [[1.0, 1.0, 1.0]])
    np.testing.assert_array_equal(seen_share(FLAT, CAMERA, people, VisibilityLimits(9.0, 0.01, 0.25)), [[1.0, 1.0, 0.0]])
    # atan(1.75 / 8) is 0.215 rad.
    np.testing.assert_array_equal(seen_share(FLAT, CAMERA, people, VisibilityLimits(99.0, 0.22, 0.25)), [[1.0, 0.0, 0.0]])


def test_walls_occlude_people():
    top = np.zeros((41, 41))
    top[:, 26] = 3.0
    high, low = ElevationMap(top, FLAT.frame), ElevationMap(np.where(top > 0, 1.0, 0.0), FLAT.frame)
    people = np.array([person(5.0, 0.0), person(2.0, 3.0), person(-5.0, 0.0)])
    np.testing.assert_array_equal(seen_share(high, CAMERA, people, UNLIMITED), [[0.0, 1.0, 1.0]])
    share = seen_share(low, CAMERA, people, UNLIMITED)[0]
    # The wall is 3 m away and 1 m high: the line over its top is at 1.5 − 0.5 · 5 / 3 = 0.67 m at the person, above the knees.
    assert share[0] == 6 / 8
    assert (share[1:] == 1.0).all()


def test_people_occlude_people():
    behind = np.array([person(3.0, 0.0), person(6.0, 0.0), person(6.0, 3.0)])
    share = seen_share(FLAT, CAMERA, behind, UNLIMITED)[0]
    assert share[0] == share[2] == 1.0
    assert share[1] <= 2 / 8


def test_shares_are_those_of_all_lines_of_sight():
    """Rough ground, walls and a crowd: what blocks of columns and free ways to the middle of a body tell is what each line would."""
    rng = np.random.default_rng(0)
    top = 0.6 * rng.random((61, 83)) + 2.5 * (rng.random((61, 83)) < 0.02)
    elevation = ElevationMap(top, np.array([-4.0, -3.0, 0.15]))
    people = np.column_stack([rng.uniform((-4.5, -3.5), (8.5, 6.5), (60, 2)), rng.uniform(0.0, 0.8, 60), rng.uniform(1.5, 2.0, 60)])
    cameras = np.column_stack([rng.uniform((-4.5, -3.5), (8.5, 6.5), (20, 2)), rng.uniform(0.8, 2.6, 20)])
    shares = seen_share(elevation, cameras, people, UNLIMITED)
    for camera, share in zip(cameras, shares, strict=True):
        goals = np.array([[_body_point(camera, one, k) for k in range(len(BODY_POINTS))] for one in people])
        hidden = np.array([[_occluded_by_person(people, p, camera, tuple(goal)) for goal in goals[p]] for p in range(len(people))])
        free = line_of_sight(elevation, camera, goals.reshape(-1, 3)).reshape(hidden.shape)
        every = np.where(hidden | (np.hypot(*(people[:, :2] - camera[:2]).T) < BLIND_RADIUS)[:, None], 0.0, free)
        np.testing.assert_array_equal(visible_points(elevation, camera, people), every)
        np.testing.assert_array_equal(share, every.mean(axis=1))
    assert 0.05 < (shares == 1.0).mean() < 0.9


@pytest.mark.parametrize("world", ["pilsun", pytest.param("ruins", marks=pytest.mark.soak)])
def test_lines_of_sight_agree_with_mujoco_rays(world):
    place = map_of(MapKey(world, 0.5, 0, 6))
    model = place.world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(3)
    agree = []
    for camera in place.node_cameras[rng.choice(len(place.node_cameras), 5, replace=False)]:
        ground = place.walkable_points[rng.choice(len(place.walkable_points), 60, replace=False)]
        goals = ground + np.outer(rng.uniform(0.4, 1.7, len(ground)), [0.0, 0.0, 1.0])
        way = goals - camera
        length = np.linalg.norm(way, axis=1)
        geom, distance = np.zeros((len(way), 1), np.int32), np.zeros((len(way), 1))
        mujoco.mj_multiRay(model, data, camera.copy(), (way / length[:, None]).ravel(), None, 1, -1, geom, distance, None, len(way), 1e3)
        free = (geom[:, 0] < 0) | (distance[:, 0] > length)
        agree.append(free == (line_of_sight(place.elevation, camera, goals) > 0))
    assert np.mean(agree) > 0.9


@pytest.mark.soak
def test_the_filter_of_a_walking_person_is_consistent():
    rng = np.random.default_rng(0)
    detector, cameras = detector_of(IndependentErrors(0.0, noise=0.01), 1 / 6), np.array([[-5.0, 0.0, 1.5], [5.0, 4.0, 1.5]])
    spread = np.linalg.cholesky(0.6 * np.array([[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]]))
    squared = []
    for _ in range(300):
        beliefs, feet, velocity = Beliefs.none(1), np.array([[0.0, 0.0]]), rng.normal(0, 0.8, 2)
        for _ in range(4):
            shake = spread @ rng.normal(size=(2, 2))
            feet, velocity = feet + 0.5 * velocity + shake[0], velocity + shake[1]
            views = Views(detector, np.zeros((2, 3, 3)), np.ones((2, 1)), cameras, np.array([[*feet[0], 0.0, 1.72]]))
            beliefs = beliefs.predicted(0.5).observed(views, rng)
        error = beliefs.mean[0, :2] - feet[0]
        squared.append(error @ np.linalg.solve(beliefs.covariance[0, :2, :2], error))
    # The mean of 300 χ² of 2 degrees has a standard deviation of 0.12.
    assert 1.5 < np.mean(squared) < 2.5


def test_gospa_of_known_cases():
    assert gospa(np.zeros((0, 2)), np.zeros((0, 2))) == 0
    here = np.array([[0.0, 0.0], [5.0, 0.0]])
    assert gospa(here, here) == 0
    # One matched 1 m off, one missed, one false: √(1 + 4/2 · 2).
    assert gospa(here, np.array([[1.0, 0.0], [9.0, 9.0]])) == pytest.approx(np.sqrt(5.0))
    assert gospa(here, np.zeros((0, 2))) == pytest.approx(2.0)
