"""Expected information: detection probabilities, covariances of views, and bounds against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from sim.placement.information import (
    LOST_SIGMA,
    Views,
    add_information,
    detection_probability,
    detector_of,
    move_robots,
    nats,
    predict_person,
    started_robots,
    unknown_people,
    update_person,
    view_covariance,
)
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import model_names, named_model

EXACT = detector_of(IndependentErrors(0.0), 1 / 6)
STILL = np.zeros((3, 3))


def views(cameras: list[list[float]], share: list[list[float]], detector: np.ndarray = EXACT, people: int = 1) -> Views:
    rows = np.array([[0.0, 3.0 * k, 0.0, 1.72] for k in range(people)])
    return Views(detector, np.zeros((len(cameras), 3, 3)), np.array(share), np.array(cameras), rows)


@pytest.mark.parametrize("name", model_names())
def test_detectors_find_less_of_what_is_hidden_and_measure_near_people_better(name):
    detector = detector_of(named_model(name), 1 / 6)
    found = [detection_probability(detector, share, (5.0, 1.5, 1.72)) for share in (0.1, 0.4, 0.7, 1.0)]
    assert 0.0 <= found[0] <= found[1] <= found[2] <= found[3] <= 1.0
    assert found[3] > 0.7
    areas = [xx * yy - xy * xy for xx, xy, yy in (view_covariance(detector, STILL, (r, 1.5, 1.72), (0.6, 0.8), 1.0) for r in (2.0, 4.0, 8.0))]
    assert areas[0] < areas[1] < areas[2]


def test_a_view_has_the_errors_of_elevation_along_and_those_of_the_robot_beside_its_own():
    xx, xy, yy = view_covariance(EXACT, STILL, (6.0, 1.5, 1.72), (1.0, 0.0), 1.0)
    sigma = np.radians(0.15)
    np.testing.assert_allclose([xx, xy, yy], [0.08**2 + (sigma * (36 + 2.25) / 1.5) ** 2, 0.0, 0.08**2 + 36 * sigma**2 / 2])
    turned = view_covariance(EXACT, np.diag([0.01, 0.04, 0.001]), (6.0, 1.5, 1.72), (1.0, 0.0), 1.0)
    np.testing.assert_allclose(np.array(turned) - [xx, xy, yy], [0.01, 0.0, 0.04 + 36 * 0.001], atol=1e-12)


def test_bounds_are_those_of_the_information_filter_and_never_exceed_the_unknown():
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(2, 2))
    P, J = A @ A.T, B @ B.T
    H = np.eye(2, 4)
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ J @ H)
    found = P.copy()
    update_person(found, J)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    update_person(found, -J)
    np.testing.assert_allclose(found, P, rtol=1e-7)
    for _ in range(100):
        predict_person(found, 0.5)
    assert np.linalg.eigvalsh(found)[0] > 0
    assert max(found[0, 0], found[1, 1]) <= LOST_SIGMA**2 / 2 + 1e-9
    assert nats(unknown_people(1)[0]) == pytest.approx(0.0)


def informed(people: int, *seen: Views) -> tuple[float, np.ndarray]:
    """Information and contributions after the last of some decisions with views `seen`."""
    bounds, found = unknown_people(people), (0.0, np.zeros(0))
    without = np.tile(bounds, (len(seen[0].cameras), 1, 1, 1))
    for k, one in enumerate(seen):
        found = add_information(bounds, without, one, (0.5 * (k > 0), 3.0))
    return found


def test_a_second_view_from_the_side_adds_information_and_misses_take_it():
    one, added = informed(1, views([[-6.0, 0.0, 1.5]], [[1.0]]))
    beside, _ = informed(1, views([[-6.0, 0.0, 1.5], [-6.0, 0.5, 1.5]], [[1.0], [1.0]]))
    across, both = informed(1, views([[-6.0, 0.0, 1.5], [0.0, -6.0, 1.5]], [[1.0], [1.0]]))
    missed, _ = informed(1, views([[-6.0, 0.0, 1.5]], [[1.0]], detector_of(IndependentErrors(0.5), 1 / 6)))
    assert across > beside > one > missed
    # Half of the boxes: each variance is twice as large, and so is the area.
    assert 0.1 < one - missed < np.log(2.0)
    assert added[0] == pytest.approx(one)
    np.testing.assert_allclose(both, across - one, rtol=0.05)


def test_nobody_seen_is_no_information_and_unseen_people_are_forgotten():
    nobody, first = (views([[-3.0, 0.0, 1.5]], [[share, 0.0]], people=2) for share in (0.0, 1.0))
    assert informed(2, nobody)[0] == pytest.approx(0.0)
    later = [informed(2, nobody, first, *[nobody] * count)[0] for count in range(21)]
    assert later[0] > later[1] > later[3] > later[-1]
    assert later[-1] < 0.1


def test_a_contribution_is_what_the_team_would_lose_without_the_robot_since_the_start():
    cameras, rng = [[-4.0, 0.0, 1.5], [0.0, -5.0, 1.5], [5.0, 5.0, 1.5]], np.random.default_rng(0)
    shares = rng.uniform(0, 1, (12, 3, 2)) * (rng.random((12, 3, 2)) < 0.5)
    for count in (1, 12):
        whole, added = informed(2, *(views(cameras, share, people=2) for share in shares[:count]))
        for k in range(3):
            others = np.delete(np.arange(3), k)
            left = informed(2, *(views([cameras[q] for q in others], share[others], people=2) for share in shares[:count]))[0]
            assert added[k] == pytest.approx(whole - left)


def test_driving_loses_the_pose_and_landmarks_find_it():
    before, after = np.zeros((1, 7)), np.zeros((1, 7))
    after[0, [0, 5]] = 2.0
    nodes, none, many = np.zeros((1, 2)), np.zeros((1, 3, 3)), np.diag([1e4, 1e4, 1e6])[None]
    lost, found = started_robots(1), started_robots(1)
    move_robots(lost, before, after, (nodes, none), 3.0)
    move_robots(found, before, after, (nodes, many), 3.0)
    assert lost[0, 0, 0] > started_robots(1)[0, 0, 0] + 0.0015
    assert np.linalg.eigvalsh(lost[0] - found[0])[0] > 0
    assert np.sqrt(found[0, 0, 0]) < 0.01
