"""Errors that last: their law, and what the filter makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.walled_room import Room, simulate
from tracker.ekf.gaussian import nees
from tracker.ekf.linearization import linearise
from tracker.ekf.odometry_biases import COUNT, BiasModel, bias_corrected, root
from tracker.ekf.state import JointState, Linear
from tracker.geometry import Pose
from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters
from tracker.types import Odometry, Start, Tick

RULE = BiasModel()
OFF = {"r0": (0.0, 0.0, 0.0, 1.0, 1.0, -1.0), "r1": (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)}
"""By how many stated standard deviations the turns of these robots are off."""


def test_the_root_squares_to_the_covariance_even_where_it_is_flat() -> None:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(6, 4))
    np.testing.assert_allclose(root(A @ A.T) @ root(A @ A.T), A @ A.T, atol=1e-12)
    np.testing.assert_allclose(root(np.diag([4.0, 0, 1, 9, 0, 1])), np.diag([2.0, 0, 1, 3, 0, 1]), atol=1e-12)


@pytest.mark.parametrize("size", [0.3, 1e-8])
def test_the_jacobian_of_the_freed_motion_is_that_of_differences(size: float) -> None:
    rng = np.random.default_rng(2)
    motion, lasting = Pose.exp(rng.normal(size=6)), size * rng.normal(size=6)
    A = rng.normal(size=(6, 6))
    scale = root(A @ A.T)
    there, G = bias_corrected(motion, scale, lasting)
    for axis, step in enumerate(1e-6 * np.eye(6)):
        ahead, back = (bias_corrected(motion, scale, lasting + sign * step)[0] for sign in (1, -1))
        difference = ((there.inverse() @ ahead).log() - (there.inverse() @ back).log()) / 2e-6
        np.testing.assert_allclose(G[:, axis], difference, atol=1e-6)


def test_a_way_with_errors_that_last_is_as_uncertain_as_their_sum() -> None:
    """Straight ahead for n steps: Var = (spread σ)² Σᵢⱼ ρ^|i − j| + n σ² of what is new (by hand, from the law of the process)."""
    joint, n, sigma, period = JointState(1, 1, None, "iekf", RULE), 20, 0.01, 0.2
    joint.join(Start(Pose.identity(), np.zeros((6, 6))))
    odometry = Odometry(Pose(np.eye(3), np.array([0.1, 0, 0])), np.diag([sigma**2, 0, 0, 0, 0, 0]))
    white, _ = RULE.whitened(odometry)
    for _ in range(n):
        joint.fade(RULE.kept(period))
        joint.predict(0, odometry.T_before_now, white, root(odometry.covariance))
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    expected = sigma**2 * ((RULE.spread[0] ** 2 * np.exp(-period / RULE.memory[0]) ** apart).sum() + n * RULE.white[0])
    assert joint.P[0, 0] == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(np.diag(joint.P[6 : 6 + COUNT, 6 : 6 + COUNT]), np.square(RULE.spread), rtol=1e-12)


def biased(ticks: list[Tick], truth: list[dict[str, Pose]]) -> list[Tick]:
    """The same ticks with turns that are off in each robot's way for good, by a stated standard deviation about each axis; else they are right."""
    out = []
    for before, now, tick in zip(truth[:-1], truth[1:], ticks[1:], strict=True):
        views = []
        for v, name in zip(tick.views, OFF, strict=True):
            assert v.odometry is not None
            error = np.array(OFF[name]) * np.sqrt(np.diag(v.odometry.covariance))
            views.append(replace(v, odometry=replace(v.odometry, T_before_now=before[name].inverse() @ now[name] @ Pose.exp(-error))))
        out.append(replace(tick, views=tuple(views)))
    return [ticks[0], *out]


@pytest.mark.slow
def test_a_gyroscope_that_is_off_for_good_is_found_out() -> None:
    setup, ticks, truth, _ = simulate(Room(robots=2, ticks=70, landmarks=90, seed=3))
    honest = {}
    for rule in (None, RULE):
        slam, consistency = Slam(setup, SlamParameters(mode="fej", persistence=rule, turn_memory=0.0)), []
        for tick, true in zip(biased(ticks, truth), truth, strict=True):
            slam.step(tick)
            consistency += [nees((slam.pose(name).inverse() @ true[name]).log()[3:], slam.covariance(name)[3:, 3:]) for name in true]
        honest[rule] = float(np.mean(consistency))
    assert honest[RULE] < 2
    assert honest[None] > 2 * honest[RULE]
    np.testing.assert_allclose(slam._joint.lasting[:, 3:6], np.array(list(OFF.values()))[:, 3:], atol=0.5)


@pytest.mark.parametrize(("name", "value"), [("memory", (1.0,) * 7), ("spread", (0.0,) * 8), ("white", (np.nan,) * 7)])
def test_a_wrong_parameter_is_named(name: str, value: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=f"{name} is .*, needs"):
        BiasModel(**{name: value})


def test_the_invariant_filter_keeps_none() -> None:
    with pytest.raises(ValueError, match="mode is 'invariant', needs fej or iekf"):
        SlamParameters(mode="invariant", persistence=RULE)


def test_the_columns_of_what_lasts_of_up_are_those_of_differences() -> None:
    """No sighting, "up" alone, as it is expected: the residual by the two numbers that are kept of its error."""
    joint = JointState(1, 1, None, "fej", RULE)
    joint.join(Start(Pose.exp(np.array([0.0, 0, 0, 0.1, -0.2, 0.7])), 1e-4 * np.eye(6)))
    up = joint.rotation[0].T @ np.array([0.0, 0.0, 9.8])
    level = Odometry(Pose.identity(), np.zeros((6, 6)), up, 0.02)

    def looked() -> Linear:
        return linearise(joint, 0, None, level)

    kept, here, columns = joint.lasting.copy(), looked(), []
    for axis in (6, 7):
        ends = []
        for sign in (1, -1):
            joint.lasting = kept.copy()
            joint.lasting[0, axis] += sign * 1e-5
            ends.append(looked().residual)
        columns.append((ends[1] - ends[0]) / 2e-5)
    H = here.H.reshape(2, -1)[:, joint.stride - 2 : joint.stride]
    np.testing.assert_allclose(H, np.array(columns).T, atol=1e-6)
