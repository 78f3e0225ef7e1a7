"""Scores of robots."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from tracker.geometry import Pose
from tracker.trajectory import RobotScore, align, score_robots


def walk(rng: np.random.Generator, length: int = 20) -> list[Pose]:
    pose, out = Pose.exp(rng.normal(0, 1, 6)), []
    for _ in range(length):
        pose = pose @ Pose.exp(rng.normal(0, [0.3, 0.3, 0.05, 0.05, 0.05, 0.3]))
        out.append(pose)
    return out


def team(rng: np.random.Generator, robots: int = 3) -> dict[str, list[Pose]]:
    return {f"r{i}": walk(rng) for i in range(robots)}


def test_the_truth_scores_zero() -> None:
    truth = team(np.random.default_rng(0))
    s = score_robots(truth, truth, {r: [np.eye(6)] * 20 for r in truth})
    assert_allclose([s.ate_m, s.ate_aligned_m, s.rpe_m, s.nees_per_dof], 0, atol=1e-9)
    assert (s.robots, s.frames, s.absent, s.steps, s.nees_frames) == (3, 60, 0, 57, 60)


def test_by_hand() -> None:
    # r0 is 3 m off throughout: RMSE 3. r1 is 0, 0, 4 m off in its three frames: RMSE √(16 / 3). ATE is the mean of the two.
    # Relative errors: r0 0, 0; r1 0, 4: RMSE √(16 / 4) = 2.
    truth = {"r0": [Pose.planar(k, 0, 0) for k in range(3)], "r1": [Pose.planar(0, k, 1) for k in range(3)]}
    estimate = {
        "r0": [Pose.planar(k, 3, 0) for k in range(3)],
        "r1": [Pose.planar(0, 0, 1), Pose.planar(0, 1, 1), Pose.planar(4, 2, 1)],
    }
    s = score_robots(truth, estimate)
    assert_allclose([s.ate_m, s.rpe_m], [(3 + math.sqrt(16 / 3)) / 2, 2])
    assert math.isnan(s.nees_per_dof)
    # Over two frames: one relative error a robot, 0 and 4.
    assert_allclose(score_robots(truth, estimate, delta=2).rpe_m, math.sqrt(16 / 2))


def test_one_motion_of_the_whole_team_is_aligned_away_and_two_are_not() -> None:
    rng = np.random.default_rng(1)
    truth = team(rng)
    T = Pose.exp([3, -2, 1, 0.3, -0.2, 2.5])
    moved = {r: [T @ p for p in poses] for r, poses in truth.items()}
    s = score_robots(truth, moved)
    assert s.ate_m > 1
    assert_allclose([s.ate_aligned_m, s.rpe_m], 0, atol=1e-9)
    moved["r0"] = [Pose.planar(0, 0, 1) @ p for p in moved["r0"]]
    s = score_robots(truth, moved)
    assert s.ate_aligned_m > 0.1
    assert_allclose(s.rpe_m, 0, atol=1e-9)


def test_alignment_against_an_oracle() -> None:
    rng = np.random.default_rng(2)
    for n in (3, 5, 50):
        onto = rng.normal(0, 5, (n, 3))
        points = onto @ Pose.exp(rng.normal(0, 2, 6)).rotation.T + rng.normal(0, 0.5, (n, 3))
        T = align(points, onto)
        peer, _ = Rotation.align_vectors(onto - onto.mean(axis=0), points - points.mean(axis=0))
        assert_allclose(T.rotation, peer.as_matrix(), atol=1e-9)
        assert_allclose(T.apply(points).mean(axis=0), onto.mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_alignment_of_too_few_or_collinear_points(n: int) -> None:
    points = np.outer(np.arange(n), [1.0, 2, 3])
    T = Pose.exp([1, 2, 3, 0.5, 0.6, 0.7])
    assert_allclose(align(points, T.apply(points)).apply(points), T.apply(points), atol=1e-9)


def test_a_mirror_is_not_an_alignment() -> None:
    points = np.random.default_rng(3).normal(0, 1, (10, 3))
    assert_allclose(np.linalg.det(align(points, points * [1, 1, -1]).rotation), 1)


def test_nees_of_errors_drawn_from_the_covariance_is_one() -> None:
    # 500 draws of χ²(6) / 6: mean 1, standard deviation √(2 · 6 / 500) / 6 = 0.0258; the band is 4 of them.
    rng = np.random.default_rng(4)
    A = rng.normal(0, 1, (6, 6)) * [0.2, 0.2, 0.1, 0.01, 0.01, 0.05]
    P = A.T @ A
    truth = [Pose.exp(rng.normal(0, 1, 6)) for _ in range(500)]
    # T_truth = T_estimate · Exp(ξ).
    estimate = [T @ Pose.exp(xi).inverse() for T, xi in zip(truth, rng.multivariate_normal(np.zeros(6), P, 500), strict=True)]
    s = score_robots({"r": truth}, {"r": estimate}, {"r": [P] * 500})
    assert abs(s.nees_per_dof - 1) < 4 * 0.0258
    assert_allclose(score_robots({"r": truth}, {"r": estimate}, {"r": [P / 4] * 500}).nees_per_dof, 4 * s.nees_per_dof)


def test_frames_without_an_estimate_are_counted_and_left_out() -> None:
    truth = {"r0": [Pose.planar(k, 0, 0) for k in range(4)], "r1": [Pose.identity()] * 4}
    estimate = {"r0": [None, Pose.planar(1, 2, 0), None, Pose.planar(3, 2, 0)], "r1": [None] * 4}
    s = score_robots(truth, estimate, {"r0": [None, np.eye(6), None, np.eye(6)], "r1": None})
    assert (s.robots, s.frames, s.absent, s.steps, s.nees_frames) == (1, 2, 6, 0, 2)
    assert_allclose([s.ate_m, s.nees_per_dof], [2, 4 / 6])
    assert math.isnan(s.rpe_m)


def test_a_certain_pose_has_no_nees() -> None:
    truth = {"r": [Pose.identity()] * 3}
    singular = np.diag([1.0, 1, 0, 1, 1, 1])
    assert math.isnan(score_robots(truth, truth, {"r": [np.zeros((6, 6)), singular, None]}).nees_per_dof)
    # A small variance is not none.
    tiny = np.diag([1.0, 1, 1e-18, 1, 1, 1e-18])
    assert score_robots(truth, truth, {"r": [tiny] * 3}).nees_frames == 3


def test_scores_add_and_nothing_is_neutral() -> None:
    rng = np.random.default_rng(5)
    truth, noisy = team(rng), {}
    for robot, poses in truth.items():
        noisy[robot] = [p @ Pose.exp(rng.normal(0, 0.1, 6)) for p in poses]
    a, b = score_robots(truth, noisy), score_robots(truth, truth)
    assert a + RobotScore() == a
    assert_allclose((a + b).ate_m, (a.ate_m + b.ate_m) / 2)
    assert_allclose((a + b).rpe_m ** 2, (a.rpe_m**2 + b.rpe_m**2) / 2)


def test_nothing_at_all_is_undefined() -> None:
    for s in (score_robots({}, {}), score_robots({"r": []}, {"r": []}), RobotScore()):
        assert s.to_dict() == {"ate_m": None, "ate_aligned_m": None, "rpe_m": None, "nees_per_dof": None}


def test_json_types() -> None:
    truth = {"r": [Pose.identity()] * 2}
    d = score_robots(truth, truth, {"r": [np.eye(6)] * 2}).to_dict()
    assert list(d) == ["ate_m", "ate_aligned_m", "rpe_m", "nees_per_dof"]
    assert all(type(v) is float for v in d.values())
    json.dumps(d, allow_nan=False)


def test_errors_name_robot_and_frame() -> None:
    truth = {"rover": [Pose.identity()] * 2}
    with pytest.raises(ValueError, match="robot rover is in the truth"):
        score_robots(truth, {})
    with pytest.raises(ValueError, match="robot rover has 1 estimates, needs 2"):
        score_robots(truth, {"rover": [Pose.identity()]})
    with pytest.raises(ValueError, match="robot rover has 1 covariances, needs 2"):
        score_robots(truth, truth, {"rover": [np.eye(6)]})
    with pytest.raises(ValueError, match="delta is 0"):
        score_robots(truth, truth, delta=0)
    lopsided, nan = np.eye(6), np.full((6, 6), np.nan)
    lopsided[0, 1] = 0.5
    indefinite = np.eye(6)
    indefinite[0, 1] = indefinite[1, 0] = 2
    for P, text in ((np.eye(3), "shape"), (nan, "finite"), (-np.eye(6), "variance"), (lopsided, "transpose"), (indefinite, "eigenvalue")):
        with pytest.raises(ValueError, match=f"covariance of robot rover in frame 1 .*{text}"):
            score_robots(truth, truth, {"rover": [np.eye(6), P]})
