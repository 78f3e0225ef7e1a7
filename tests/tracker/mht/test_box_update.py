"""Likelihood and update of a leaf by a box whose feet are visible: derivatives against differences, the update against linear algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.detections.test_ground_points import seen
from tracker.datasets import synthetic_crowd
from tracker.detections.cross_view import CrossViewGroup
from tracker.geometry import Array
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.mht.box_update import PREDICTED, head_of, log_likelihood, predict_measurement, update_child
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, ParentHypotheses, empty_children
from tracker.mht.track_trees import initiated
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import MotionParameters

LIMITS = BranchingConstants(4.0, 0.2, 1.4, 2.3, -5.0, -np.inf, 15.0, 8, 3)
COVARIANCE = np.array([
    [0.20, 0.05, 0.10, 0.00, 0.01],
    [0.05, 0.15, 0.00, 0.08, 0.00],
    [0.10, 0.00, 0.50, 0.00, 0.00],
    [0.00, 0.08, 0.00, 0.40, 0.00],
    [0.01, 0.00, 0.00, 0.00, 0.01],
])  # fmt: skip


def hills() -> Grid:
    heights = 0.3 * np.sin(np.linspace(0, 20, 201))[:, None] * np.cos(np.linspace(0, 60, 801))[None, :]
    return Grid(heights, np.array([-40.0, -10.0]), 0.1)


def parents_of(x: Array, ground: Ground, boxes: int) -> ParentHypotheses:
    """One leaf with the state x (5,) and COVARIANCE."""
    leaf = initiated(1, [CrossViewGroup(((0, 0),), x[:2], COVARIANCE[:2, :2])], MotionParameters(), (x[4], 0.1), (1, 0, 0))
    leaf = replace(leaf, state=x[None].copy(), covariance=COVARIANCE[None].copy())
    return ParentHypotheses.of(leaf, ground, np.zeros((1, 1)), np.zeros((1, boxes)))


def table(people: list[tuple[float, float]], ground: Ground | None = None) -> BoxTable:
    """Boxes of people at (azimuth rad, distance m), whose feet are taken as visible, and whose heads measure statures on known ground."""
    feet = seen(people, ground=ground, occluders=ground if isinstance(ground, Grid) else None)
    setup = synthetic_crowd.setup(1)
    feet = replace(feet, camera=next(iter(setup.mounts)), ambiguous=np.zeros(len(feet), dtype=bool))
    return BoxTable.of([feet], SensorModel(setup, MhtParameters()), 2.5)


@pytest.mark.parametrize("ground", [Flat(), hills()], ids=["flat", "hills"])
def test_derivatives_match_differences(ground: Ground) -> None:
    """Of the direction to the feet and of the head, on the ground as it is linearized at the leaf."""
    boxes, x, step = table([(0.0, 6.0), (0.2, 9.0)], ground), np.array([7.0, 0.5, 0.0, 0.0, 1.72]), 1e-4
    parents, here = parents_of(x, ground, 2), np.empty(PREDICTED)
    predict_measurement(x, 0, parents, 0, boxes, here)
    for d in range(2):
        H = head_of(here, x, COVARIANCE, 0, d, boxes).H
        for axis, column in enumerate((0, 1, 4)):
            above, directions = [], []
            for side in (-1, 1):
                moved, there = x.copy(), np.empty(PREDICTED)
                moved[column] += side * step
                predict_measurement(moved, 0, parents, 0, boxes, there)
                above.append(head_of(there, moved, COVARIANCE, 0, d, boxes).above)
                directions.append(there[:3].copy())
            assert -H[axis] == pytest.approx((above[1] - above[0]) / (2 * step), abs=1e-5)
            if axis < 2:
                turn = here[3:9].reshape(2, 3) @ (directions[1] - directions[0]) / (2 * step)
                np.testing.assert_allclose(here[9:13].reshape(2, 2)[:, axis], turn, atol=1e-6)


@pytest.mark.parametrize("later", [0.0, 0.15, -0.1])
def test_the_likelihood_is_gaussian_and_the_update_that_of_kalman(later: float) -> None:
    """Of a view that is so many s later than its tick, of which the box tells where the person is then."""
    boxes, x = table([(0.05, 7.2)])._replace(later=np.array([later])), np.array([7.0, 0.5, 0.3, -0.2, 1.72])
    assert not boxes.stature[0]
    parents, predicted = parents_of(x, Flat(), 1), np.empty(PREDICTED)
    predict_measurement(x, 0, parents, 0, boxes, predicted)
    H = np.zeros((2, 5))
    H[:, :2] = predicted[9:13].reshape(2, 2)
    H[:, 2:4] = later * H[:, :2]
    np.testing.assert_allclose(predicted[19:21], x[:2] + later * x[2:4])
    r = predicted[3:9].reshape(2, 3) @ boxes.direction[0]
    # The feet are about the ground under the body by a deviation of their own.
    S = H @ COVARIANCE @ H.T + boxes.covariance[0] + LIMITS.foot_spread**2 * H[:, :2] @ H[:, :2].T
    K = COVARIANCE @ H.T @ np.linalg.inv(S)
    child = ChildHypotheses(*empty_children(1, 1))
    child.state[:], child.covariance[:] = x, COVARIANCE
    ratio = log_likelihood(predicted, x, COVARIANCE, 0, 0, boxes, LIMITS)
    update_child(0, 0, 0, 0, parents, boxes, LIMITS, child)
    np.testing.assert_allclose(child.state[0], x + K @ r, atol=1e-9)
    np.testing.assert_allclose(child.covariance[0], COVARIANCE - K @ S @ K.T, atol=1e-9)
    np.testing.assert_allclose(child.residual[0, 0], r, atol=1e-9)
    np.testing.assert_allclose(child.S[0, 0], S, atol=1e-12)
    density = -0.5 * (r @ np.linalg.solve(S, r) + np.log((2 * np.pi) ** 2 * np.linalg.det(S)))
    assert ratio == pytest.approx(boxes.detection_ratio[0] + np.log(1 - boxes.feet_hidden[0]) + density, abs=1e-9)


def test_a_head_measures_the_stature_where_the_ground_is_known() -> None:
    """The box is 1.7 m high at the place that its feet tell."""
    level = Grid(np.zeros((201, 801)), np.array([-40.0, -10.0]), 0.1)
    boxes, x = table([(0.0, 7.0)], level), np.array([7.0, 0.0, 0.0, 0.0, 1.85])
    assert boxes.stature[0]
    child = ChildHypotheses(*empty_children(1, 1))
    child.state[:], child.covariance[:] = x, COVARIANCE
    update_child(0, 0, 0, 0, parents_of(x, Flat(), 1), boxes, LIMITS, child)
    assert child.state[0, 4] == pytest.approx(1.7, abs=0.05)
    assert child.covariance[0, 4, 4] < 0.5 * COVARIANCE[4, 4]
    assert (np.linalg.eigvalsh(child.covariance[0]) > 0).all()


def test_boxes_outside_the_gate_or_of_no_height_of_people_have_no_likelihood() -> None:
    plain, predicted = table([(0.0, 7.0)]), np.empty(PREDICTED)
    high = plain._replace(head_slope=np.array([0.3]))  # 3.6 m where its feet are

    def at(place: float, side: float, boxes: BoxTable = plain) -> float:
        x = np.array([place, side, 0.0, 0.0, 1.7])
        predict_measurement(x, 0, parents_of(x, Flat(), 1), 0, boxes, predicted)
        return float(log_likelihood(predicted, x, COVARIANCE, 0, 0, boxes, LIMITS))

    assert np.isfinite(at(7.0, 0.0))
    assert at(7.0, 4.0) == at(-7.0, 0.0) == at(7.0, 0.0, high) == -np.inf
