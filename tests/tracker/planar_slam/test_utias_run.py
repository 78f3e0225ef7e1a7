"""Runs on two sets of UTIAS from files to scores, and on a copy with much of the data removed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.planar_slam.mrclam import write_set
from tracker.planar_slam.event_schedule import PlanarParameters
from tracker.planar_slam.utias_run import evaluate_trajectories, track_utias


@pytest.mark.parametrize(
    ("number", "known", "limit"),
    [(1, True, 0.095), (6, False, 0.130)],
)
def test_position_errors_on_utias(data: Callable[..., Path], tmp_path: Path, number: int, known: bool, limit: float) -> None:
    """Parameters are tuned on set 1 alone. The limits are those of a tuned joint filter; a batch solution has 0.065, 0.079, 0.081, 0.109 m."""
    source = data("utias", f"MRCLAM_Dataset{number}")
    paths = track_utias(source, tmp_path / "r", known)
    scores = evaluate_trajectories(source, tmp_path / "r")
    assert scores["robots"]["ate_m"] < 0.75 * limit
    assert scores["robots"]["nees_per_dof"] < 1.5
    assert scores["dead_reckoning"]["ate_m"] > 10 * scores["robots"]["ate_m"]
    assert paths.run["counters"]["outlier"] < 0.01 * paths.run["counters"]["matched"]
    if not known:
        assert scores["robots"]["map_aligned_m"] < 0.15


def test_a_copy_with_sparse_truth_a_robot_missing_and_slow_odometry(data: Callable[..., Path], tmp_path: Path) -> None:
    source, folder = data("utias", "MRCLAM_Dataset1"), tmp_path / "s"
    folder.mkdir()
    for path in source.glob("*.dat"):
        if path.name.startswith("Robot3"):
            continue
        every = 250 if "Groundtruth" in path.name and path.name.startswith("Robot") else 8 if "Odometry" in path.name else 1
        if every == 1:
            shutil.copyfile(path, folder / path.name)
        else:
            lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
            (folder / path.name).write_text("\n".join(lines[::every]) + "\n")
    track_utias(folder, tmp_path / "r", False)
    scores = evaluate_trajectories(folder, tmp_path / "r")["robots"]
    assert scores["ate_m"] < 0.2


def test_the_same_run_is_kept_and_another_is_refused(tmp_path: Path) -> None:
    source, out = write_set(tmp_path / "s"), tmp_path / "r"
    track_utias(source, out, False)
    stamp = (out / "robots.csv").stat().st_mtime_ns
    track_utias(source, out, False)
    assert (out / "robots.csv").stat().st_mtime_ns == stamp
    with pytest.raises(ValueError, match="holds another run"):
        track_utias(source, out, True)
    with pytest.raises(ValueError, match="holds another run"):
        track_utias(source, out, False, PlanarParameters("ekf"))
    (source / "Barcodes.dat").write_text((source / "Barcodes.dat").read_text() + "# more\n")
    with pytest.raises(ValueError, match="made from another source"):
        evaluate_trajectories(source, out)


def test_sets_without_landmarks_or_with_early_truth(tmp_path: Path) -> None:
    source = write_set(tmp_path / "s")
    path = source / "Robot1_Groundtruth.dat"
    path.write_text("5 1 1 0\n" + path.read_text())
    early = track_utias(source, tmp_path / "early", False)
    assert early.run["mended"] == ["Robot1_Groundtruth.dat: 1 row more than 60 s before the odometry left out"]
    clean = track_utias(write_set(tmp_path / "clean"), tmp_path / "r", False)
    np.testing.assert_array_equal(early.poses[1], clean.poses[1])
    (source / "Landmark_Groundtruth.dat").write_text("")
    assert len(track_utias(source, tmp_path / "none", False).landmarks) == 0
    with pytest.raises(ValueError, match=f"{source}: the set has no landmarks, which a known map needs"):
        track_utias(source, tmp_path / "known", True)
