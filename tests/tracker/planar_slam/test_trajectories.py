"""Trajectories in the plane: written and read, and scores beside arithmetic by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tracker.planar_slam.trajectories import PlanarTrajectories, read_trajectories, score_trajectories, table, true_poses, write_trajectories
from tracker.planar_slam.utias_files import UtiasDataset, UtiasRobot

TIMES = np.arange(100) * 0.02


def straight(n: int) -> UtiasRobot:
    """1 m/s along x at y = n, truth at 50 Hz."""
    truth = np.stack([TIMES, TIMES, np.full(100, float(n)), np.zeros(100)], axis=1)
    return UtiasRobot(truth[:, :3], np.zeros((0, 3)), np.zeros(0, dtype=np.int64), truth, {})


def team() -> UtiasDataset:
    return UtiasDataset({1: straight(1), 2: straight(2)}, {6: np.array([0.0, 0.0]), 7: np.array([3.0, 4.0])}, ())


def paths(shift: tuple[float, float] = (0.0, 0.0)) -> PlanarTrajectories:
    poses = {n: r.truth[:, 1:] + [*shift, 0.0] for n, r in team().robots.items()}
    P = np.tile(np.diag([0.01, 0.01, 0.001]), (100, 1, 1))
    return PlanarTrajectories(TIMES, poses, {1: P, 2: P}, {s: p + shift for s, p in team().landmarks.items()}, {"map": "known"})


def test_write_then_read(tmp_path: Path) -> None:
    write_trajectories(tmp_path / "r", paths())
    back = read_trajectories(tmp_path / "r")
    for n in (1, 2):
        np.testing.assert_allclose(back.poses[n], paths().poses[n], atol=1e-6)
        np.testing.assert_allclose(back.covariances[n], paths().covariances[n], rtol=1e-5)
    np.testing.assert_allclose(back.landmarks[7], [3, 4])
    assert back.run["map"] == "known"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r"]


def test_a_translation_is_the_error_before_alignment_alone() -> None:
    s = score_trajectories(team(), paths((0.3, 0.4)))
    assert s["ate_m"] == pytest.approx(0.5)
    assert s["ate_aligned_m"] == pytest.approx(0, abs=1e-9)
    assert s["rpe_m"] == pytest.approx(0, abs=1e-9)
    assert s["map_m"] == pytest.approx(0.5)
    assert s["map_aligned_m"] == pytest.approx(0, abs=1e-9)
    # (0.3² + 0.4²) / 0.01 over three numbers
    assert s["nees_per_dof"] == pytest.approx(25 / 3)
    assert "0.500 m" in table({"robots": s, "dead_reckoning": {"ate_m": 1.0}})


def test_ate_is_the_mean_over_robots_and_rpe_shows_a_scale_error() -> None:
    p = paths()
    p.poses[1][:, 0] *= 1.1
    s = score_trajectories(team(), p)
    assert s["ate_m"] == pytest.approx(0.5 * 0.1 * np.sqrt((TIMES**2).mean()))
    assert s["rpe_m"] == pytest.approx(np.sqrt(0.5) * 0.1)


def test_steps_of_more_than_two_seconds_have_no_relative_error() -> None:
    robot = straight(1)
    slow = UtiasRobot(robot.odometry, robot.measurements, robot.subject, robot.truth * [150, 150, 1, 1], {})
    p = paths()
    far = PlanarTrajectories(TIMES * 150, {1: slow.truth[:, 1:]}, {1: p.covariances[1]}, p.landmarks, p.run)
    scores = score_trajectories(UtiasDataset({1: slow}, team().landmarks, ()), far)
    assert (scores["ate_m"], scores["rpe_m"]) == (0.0, None)


def test_truth_is_known_near_its_samples() -> None:
    robot = straight(1)
    sparse = UtiasRobot(robot.odometry, robot.measurements, robot.subject, robot.truth[[0, 1, 2, 60, 99]], {})
    poses, known = true_poses(sparse, TIMES)
    assert np.flatnonzero(known).tolist() == [0, 1, 2, 60, 99]
    np.testing.assert_allclose(poses[known], robot.truth[[0, 1, 2, 60, 99], 1:])


def test_a_robot_without_a_trajectory_is_an_error() -> None:
    p = paths()
    del p.poses[2]
    with pytest.raises(ValueError, match="robot 2 is in the set, needs a path"):
        score_trajectories(team(), p)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("robots.csv", "a,b\n", "robots.csv:1: columns are a,b, need timestamp"),
        ("map.csv", "subject,tx,ty\n1,2\n", "map.csv:2: 2 values, needs 3"),
        ("map.csv", "subject,tx,ty\n1,2,oops\n", "map.csv:2: ty is 'oops', needs a number"),
        ("run.json", '{"schema": 9}', "run.json: not a run in the plane"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    write_trajectories(tmp_path / "r", paths())
    (tmp_path / "r" / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        read_trajectories(tmp_path / "r")


@pytest.mark.parametrize(
    ("line", "change", "message"),
    [
        (5, lambda row: row.replace(row.split(",")[2], "oops", 1), "robots.csv:5: tx is 'oops', needs a number"),
        (5, lambda row: "-9" + row[row.index(",") :], "robots.csv:5: robot 1 has time -9.000, needs ascending times that all robots have"),
        (105, lambda row: "-9" + row[row.index(",") :], "robots.csv:105: robot 2 has time -9.000, needs ascending times that all robots have"),
        (201, lambda row: "", "robots.csv:200: robot 2 has 99 times, and robot 1 has 100, needs ascending times that all robots have"),
        (4, lambda row: row.replace(",1,", ",1.5,", 1), "robots.csv:4: robot is '1.5', needs a whole number"),
    ],
)
def test_bad_rows_are_named(tmp_path: Path, line: int, change: Callable[[str], str], message: str) -> None:
    write_trajectories(tmp_path / "r", paths())
    lines = (tmp_path / "r" / "robots.csv").read_text().splitlines()
    lines[line - 1] = change(lines[line - 1])
    (tmp_path / "r" / "robots.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=message):
        read_trajectories(tmp_path / "r")
