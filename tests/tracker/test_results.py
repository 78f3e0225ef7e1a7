"""Write∘read of what `track` leaves."""

from pathlib import Path

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.measurements import Estimate
from tracker.results import Results, read_results, write_results


def estimates() -> list[Estimate]:
    out = []
    for k in range(3):
        poses = {"robot_0": Pose.planar(k, 1.0, 0.2), "View_001": Pose.identity()}
        P = {"robot_0": 0.01 * np.eye(6) + 0.001, "View_001": np.zeros((6, 6))}
        out.append(Estimate(k, poses, P, np.arange(k), np.arange(3.0 * k).reshape(k, 3) + 0.5, np.zeros((k, 3, 3))))
    return out


def test_what_is_written_is_read(tmp_path: Path) -> None:
    results = Results.of(estimates(), {"source": "here"})
    write_results(tmp_path / "r", results)
    read = read_results(tmp_path / "r")
    assert read.frames == 3
    assert read.run["source"] == "here"
    assert list(read.poses) == ["robot_0"]  # a camera that is known to stand still is no result
    for k in range(3):
        ids, places = read.tracks.get(k, (np.zeros(0), np.zeros((0, 3))))
        np.testing.assert_array_equal(ids, results.tracks[k][0])
        np.testing.assert_allclose(places, results.tracks[k][1])
        pose, P = read.poses["robot_0"][k], read.covariances["robot_0"][k]
        assert pose is not None
        np.testing.assert_allclose(pose.translation, [k, 1, 0])
        np.testing.assert_allclose(P, 0.01 * np.eye(6) + 0.001)


def test_there_is_one_run_a_folder(tmp_path: Path) -> None:
    write_results(tmp_path / "r", Results.of(estimates(), {}))
    with pytest.raises(ValueError, match="is there already"):
        write_results(tmp_path / "r", Results.of(estimates(), {}))
    assert [p.name for p in tmp_path.iterdir()] == ["r"]


def test_missing_folder_and_wrong_schema(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such folder"):
        read_results(tmp_path / "r")
    write_results(tmp_path / "r", Results.of(estimates(), {}))
    (tmp_path / "r" / "run.json").write_text("{}")
    with pytest.raises(ValueError, match=r"run\.json: schema"):
        read_results(tmp_path / "r")
