"""Scores of robots."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tracker.geometry import Pose
from tracker.metrics.trajectory import RobotScore, align, score_robots


def walk(rng: np.random.Generator, length: int = 20) -> list[Pose]:
    pose, out = Pose.exp(rng.normal(0, 1, 6)), []
    for _ in range(length):
        pose = pose @ Pose.exp(rng.normal(0, [0.3, 0.3, 0.05, 0.05, 0.05, 0.3]))
        out.append(pose)
    return out


def team(rng: np.random.Generator, robots: int = 3) -> dict[str, list[Pose]]:
    return {f"r{i}": walk(rng) for i in range(robots)}


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


def test_alignment_removes_one_motion_of_the_whole_team() -> None:
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


def test_yaw_alignment_removes_a_rotation_about_the_vertical_alone() -> None:
    rng = np.random.default_rng(6)
    truth = team(rng)
    for T, found in ((Pose.planar(3, -2, 2.5), True), (Pose.exp([3, -2, 1, 0.3, -0.2, 2.5]), False)):
        s = score_robots(truth, {r: [T @ p for p in poses] for r, poses in truth.items()})
        assert (s.ate_yaw_m < 1e-9) == found
        assert s.ate_aligned_m < 1e-9
        assert_allclose([s.rpe_m, s.rpe_between_m], 0, atol=1e-9)


def test_errors_between_robots_by_hand() -> None:
    # r1 stands 3 m ahead of r0, which turns a quarter to the left in its own belief: r0 then has r1 at (0, -3) instead of (3, 0), √18 off; r1, who
    # still looks along x, has r0 where it is. Over both ordered pairs: √(18 / 2) = 3.
    truth = {"r0": [Pose.identity()], "r1": [Pose.planar(3, 0, 0)]}
    s = score_robots(truth, truth | {"r0": [Pose.planar(0, 0, np.pi / 2)]})
    assert_allclose(s.rpe_between_m, 3)
    assert s.relative_pairs == 2
    assert math.isnan(score_robots({"r0": truth["r0"]}, truth).rpe_between_m)


def test_the_band_contains_consistent_runs() -> None:
    # Whole runs are one error each: of 400 means of ten such runs 95 % lie inside, ± 4 standard deviations √(0.95 · 0.05 / 400).
    rng = np.random.default_rng(7)
    values = rng.chisquare(6, (400, 10)).mean(axis=1) / 6
    low, high = sum([RobotScore(nees_frames=50, runs=1)] * 10, RobotScore()).nees_band
    assert abs(((values > low) & (values < high)).mean() - 0.95) < 4 * 0.0109
    wide = RobotScore(nees_frames=50, runs=1).nees_band
    assert wide[0] < low < 1 < high < wide[1]


def test_scores_of_a_team_equal_those_of_evo() -> None:
    metrics, trajectory = pytest.importorskip("evo.core.metrics"), pytest.importorskip("evo.core.trajectory")
    from evo.core.geometry import umeyama_alignment

    rng = np.random.default_rng(8)
    truth, T = team(rng), Pose.exp([3, -2, 1, 0.1, -0.2, 2.5])
    estimate = {r: [T @ p @ Pose.exp(rng.normal(0, 0.1, 6)) for p in poses] for r, poses in truth.items()}
    s = score_robots(truth, estimate)

    def matrix(pose: Pose) -> np.ndarray:
        return np.block([[pose.rotation, pose.translation[:, None]], [np.zeros((1, 3)), np.eye(1)]])

    def path(poses: list[Pose]) -> object:
        return trajectory.PosePath3D(poses_se3=[matrix(p) for p in poses])

    def rmse(given: dict[str, np.ndarray]) -> float:
        values = []
        for r, moved in given.items():
            ape = metrics.APE(metrics.PoseRelation.translation_part)
            ape.process_data((path(truth[r]), path([Pose(np.eye(3), p) for p in moved])))
            values.append(ape.get_statistic(metrics.StatisticsType.rmse))
        return float(np.mean(values))

    given = {r: np.array([p.translation for p in poses]) for r, poses in estimate.items()}
    points, onto = np.concatenate(list(given.values())).T, np.array([p.translation for poses in truth.values() for p in poses]).T
    R, t, _ = umeyama_alignment(points, onto)
    assert_allclose(s.ate_aligned_m, rmse({r: p @ R.T + t for r, p in given.items()}))
    flat, shift, _ = umeyama_alignment(points[:2], onto[:2])
    yaw, lift = np.block([[flat, np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]]), np.append(shift, (onto - points)[2].mean())
    assert_allclose(s.ate_yaw_m, rmse({r: p @ yaw.T + lift for r, p in given.items()}))
    pairs = [(a, b, k) for a in truth for b in truth if a != b for k in range(len(truth[a]))]
    ends = [[matrix(poses[r][k]) for poses in (truth, estimate) for r in (a, b)] for a, b, k in pairs]
    errors = [metrics.RPE.rpe_base(*four)[:3, 3] for four in ends]
    assert_allclose(s.rpe_between_m, np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("n", [1, 2, 4])
def test_alignment_of_too_few_or_collinear_points(n: int) -> None:
    points = np.outer(np.arange(n), [1.0, 2, 3])
    T = Pose.exp([1, 2, 3, 0.5, 0.6, 0.7])
    assert_allclose(align(points, T.apply(points)).apply(points), T.apply(points), atol=1e-9)


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


def test_errors_name_robot_and_frame() -> None:
    truth = {"rover": [Pose.identity()] * 2}
    with pytest.raises(ValueError, match="robot rover is in the truth"):
        score_robots(truth, {})
    with pytest.raises(ValueError, match="robot rover has 1 estimates, needs 2"):
        score_robots(truth, {"rover": [Pose.identity()]})
    with pytest.raises(ValueError, match="robot rover has 1 covariances, needs 2"):
        score_robots(truth, truth, {"rover": [np.eye(6)]})
    lopsided, nan = np.eye(6), np.full((6, 6), np.nan)
    lopsided[0, 1] = 0.5
    indefinite = np.eye(6)
    indefinite[0, 1] = indefinite[1, 0] = 2
    for P, text in ((np.eye(3), "shape"), (nan, "finite"), (-np.eye(6), "variance"), (lopsided, "transpose"), (indefinite, "eigenvalue")):
        with pytest.raises(ValueError, match=f"covariance of robot rover in frame 1 .*{text}"):
            score_robots(truth, truth, {"rover": [np.eye(6), P]})
