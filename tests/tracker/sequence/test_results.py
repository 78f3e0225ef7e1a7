"""Results of tracking on disk: round trips and errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.sequence.results import Results, read_results, write_results
from tracker.types import Estimate, MapSnapshot


def estimates() -> list[Estimate]:
    out = []
    for k in range(3):
        poses = {"robot_0": Pose.planar(k, 1.0, 0.2), "View_001": Pose.identity()}
        P = {"robot_0": 0.01 * np.eye(6) + 0.001, "View_001": np.zeros((6, 6))}
        out.append(Estimate(k, poses, P, np.arange(k), np.arange(3.0 * k).reshape(k, 3) + 0.5, np.zeros((k, 3, 3))))
    return out


def test_round_trip(tmp_path: Path) -> None:
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


def test_landmark_history_round_trip(tmp_path: Path) -> None:
    # Landmark 7 is gone at the end and 9 has moved; robot_0 sees two, then none, then one.
    maps = [([7, 9], [[7.0, 0, 0], [9, 0, 0]]), ([9], [[9, 1, 0]]), ([9, 12], [[9, 2, 0], [12, 0, 0]])]
    seen = [{"robot_0": np.array([9, 7])}, {"robot_0": np.zeros(0, dtype=np.int64)}, {"robot_0": np.array([12])}]
    charts = [MapSnapshot(np.array(ids), np.array(places), sighted) for (ids, places), sighted in zip(maps, seen, strict=True)]
    results = Results.of([replace(e, map_snapshot=chart) for e, chart in zip(estimates(), charts, strict=True)], {})
    write_results(tmp_path / "r", results)
    survey = read_results(tmp_path / "r").landmark_history
    assert survey is not None
    assert {n: place.tolist() for n, place in survey.positions.items()} == {7: [7, 0, 0], 9: [9, 2, 0], 12: [12, 0, 0]}
    np.testing.assert_array_equal(survey.map, [[9, 2, 0], [12, 0, 0]])
    assert [{r: sorted(ids.tolist()) for r, ids in frame.items()} for frame in survey.sighted] == [{"robot_0": [7, 9]}, {}, {"robot_0": [12]}]
    with (tmp_path / "r" / "sightings.csv").open("a") as file:
        file.write("2,robot_0,8\n")
    with pytest.raises(ValueError, match=r"sightings\.csv:5: landmark 8 in frame 2"):
        read_results(tmp_path / "r")


def test_missing_folder_and_wrong_schema(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such folder"):
        read_results(tmp_path / "r")
    write_results(tmp_path / "r", Results.of(estimates(), {}))
    (tmp_path / "r" / "run.json").write_text("{}")
    with pytest.raises(ValueError, match=r"run\.json: schema"):
        read_results(tmp_path / "r")
