"""Evaluated people, scores of a sequence, dead reckoning, and scores of files."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tracker.geometry import Pose
from tracker.metrics.evaluation import dead_reckoning, efficiency, evaluate, evaluate_files, evaluated_people, table
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results
from tracker.types import LandmarkHistory, Start, Truth


def test_a_person_is_evaluated_for_nine_frames_after_being_seen() -> None:
    """At 7 frames/s: person 1 is seen in frame 2 alone, by the second camera; person 2 never enough."""
    truth = tuple(Truth(k, {}, np.array([1, 2]), np.zeros((2, 3)), np.array([[0.0, 0.2 if k == 2 else 0.19], [0.19, 0.1]])) for k in range(15))
    counts = np.array(evaluated_people(truth, 1 / 7))
    assert counts[:, 0].tolist() == [2 <= k <= 11 for k in range(15)]
    assert not counts[:, 1].any()


def test_perfect_results_score_one(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    sequence = read_sequence(tmp_path / "s")
    assert sequence.truth is not None
    tracks = {t.index: (t.person_id + 100, t.feet) for t in sequence.truth}
    poses: dict[str, list[Pose | None]] = {r: [t.T_world_robot[r] for t in sequence.truth] for r in ("robot_0", "robot_1")}
    results = Results(3, tracks, poses, {r: [np.eye(6)] * 3 for r in poses}, {})
    scores = evaluate(sequence, results)
    assert scores["targets"]["mota"] == scores["everybody"]["mota"] == 1
    assert scores["targets"]["truths"] == 3  # the second person is never seen: 0.125 is below 0.2
    assert scores["everybody"]["truths"] == 6
    assert scores["robots"]["ate_m"] == pytest.approx(0, abs=1e-9)
    assert scores["dead_reckoning"]["ate_m"] > 0.01
    assert "MOTA" in table(scores)
    assert efficiency(sequence, results) == {"bound_m": None, "efficiency": None}
    # One landmark that both robots see in all frames: the bound is below what the start and dead reckoning leave, and the truth is perfect.
    seen = {robot: np.array([3]) for robot in poses}
    survey = LandmarkHistory({3: np.array([5.0, 5.0, 1.0])}, np.array([3]), (seen,) * 3)
    found = efficiency(sequence, replace(results, landmark_history=survey))
    assert found["efficiency"] == pytest.approx(0, abs=1e-9)
    assert 0 < (found["bound_m"] or 0) < np.sqrt(0.04)
    scores["robots"] |= {"bound_m": 0.01, "efficiency": 1.25}
    assert "(efficiency) 1.25" in table(scores)


def test_fixed_cameras_are_not_scored_as_robots(tmp_path: Path) -> None:
    """robot_1 is known exactly: there are no results of it, and none are asked for."""
    sequences.write(tmp_path / "s")
    sequence = read_sequence(tmp_path / "s")
    assert sequence.truth is not None
    start = sequence.setup.starts["robot_1"]
    assert start is not None
    starts = sequence.setup.starts | {"robot_1": Start(start.T_world_robot, np.zeros((6, 6)))}
    fixed = replace(sequence, setup=replace(sequence.setup, starts=starts))
    poses: dict[str, list[Pose | None]] = {"robot_0": [t.T_world_robot["robot_0"] for t in sequence.truth]}
    results = Results(3, {}, poses, {"robot_0": [np.eye(6)] * 3}, {})
    assert evaluate(fixed, results)["robots"]["ate_m"] == pytest.approx(0, abs=1e-9)
    with pytest.raises(ValueError, match="robot robot_1 is in the truth, needs estimates too"):
        evaluate(sequence, results)


def test_dead_reckoning_composes_odometry(tmp_path: Path) -> None:
    ticks = sequences.write(tmp_path / "s")
    poses = dead_reckoning(read_sequence(tmp_path / "s"))["robot_1"]
    expected = Pose.planar(1, 2, 0.3)
    for k, tick in enumerate(ticks):
        odometry = tick.views[1].odometry
        expected = expected @ odometry.T_before_now if odometry else expected
        got = poses[k]
        assert got is not None
        np.testing.assert_allclose(got.log(), expected.log(), atol=1e-7)


def test_published_score_of_s2l1(data: Callable[..., Path]) -> None:
    """FORMATS and the data's README: MOTA 85.0, FP 247, FN 420, 31 switches at IoU 0.5."""
    folder = data("pets2009", "S2.L1", "mot15")
    targets = evaluate_files(folder / "gt.txt", folder / "cem_result.txt", 0.5)["targets"]
    assert round(targets["mota"], 3) == 0.850
    assert [targets[k] for k in ("false_positives", "misses", "switches")] == [247, 420, 31]


def test_positions_are_needed_to_compare_positions(data: Callable[..., Path]) -> None:
    folder = data("pets2009", "S2.L1", "mot15")
    with pytest.raises(ValueError, match=r"cem_result.txt: row 1 has no x, y, z; give --iou"):
        evaluate_files(folder / "gt.txt", folder / "cem_result.txt", None)


def test_too_few_frames_are_an_error(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    with pytest.raises(ValueError, match="results have 2 frames, the truth has 3"):
        evaluate(read_sequence(tmp_path / "s"), Results(2, {}, {}, {}, {}))
