"""UTIAS data sets: reading, rejected measurements, and errors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.formats.mrclam import BEGIN, LANDMARKS, write_set
from tracker.formats.utias import is_utias, read_utias


def test_small_data_set(tmp_path: Path) -> None:
    team = read_utias(write_set(tmp_path / "s"))
    assert is_utias(tmp_path / "s")
    assert not is_utias(tmp_path)
    assert list(team.robots) == [1, 2]
    assert {s: tuple(p) for s, p in team.landmarks.items()} == LANDMARKS
    robot = team.robots[1]
    assert robot.odometry[0].tolist() == [BEGIN, 0.1, 0.1]
    assert sorted(set(robot.subject.tolist())) == [2, 6, 7, 8, 9]
    assert not robot.rejected
    assert team.repairs == ()


def test_swapped_landmarks_of_real_data_are_repaired(data: Callable[..., Path]) -> None:
    """Where the truth says that robot 2 was, landmark 11 is seen where the exchanged table has it."""
    team = read_utias(data("utias", "MRCLAM_Dataset1"))
    assert team.repairs == ("landmarks 11 and 17 of set 1 exchanged",)
    robot = team.robots[2]
    mine = robot.subject == 11
    t, truth = robot.measurements[mine, 0], robot.truth
    x, y = np.interp(t, truth[:, 0], truth[:, 1]), np.interp(t, truth[:, 0], truth[:, 2])
    reach = np.hypot(team.landmarks[11][0] - x, team.landmarks[11][1] - y)
    assert np.median(np.abs(reach - robot.measurements[mine, 1])) < 0.2
    other = read_utias(data("utias", "MRCLAM_Dataset6"))
    assert other.repairs == ()
    assert sum(sum(r.rejected.values()) for r in other.robots.values()) == 6


def test_rejected_measurements_are_counted_by_reason(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "s")
    with (folder / "Robot1_Measurement.dat").open("a") as file:
        file.write(f"{BEGIN + 1} 99 1.0 0.0\n{BEGIN + 1} 5 1.0 0.0\n{BEGIN + 2} 72 0.0 0.0\n{BEGIN + 2} 72 -1.0 0.0\n")
    (folder / "Barcodes.dat").write_text((folder / "Barcodes.dat").read_text() + " 3 41 \n")
    with (folder / "Robot2_Measurement.dat").open("a") as file:
        file.write(f"{BEGIN + 1} 41 1.0 0.0\n")
    team = read_utias(folder)
    assert team.robots[1].rejected == {"barcode not in the table": 1, "robot sees itself": 1, "range not above zero": 2}
    assert team.robots[2].rejected == {"subject not in the set": 1}


def change(path: Path, line: int, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("name", "line", "text", "message"),
    [
        ("Robot1_Odometry.dat", 7, f"{BEGIN - 1} 0.1 0.1", r"Robot1_Odometry.dat: time is 999.000 after 1000.100, needs ascending times"),
        ("Robot1_Odometry.dat", 7, f"{BEGIN} nan 0.1", r"Robot1_Odometry.dat:line 7 is .*needs 3 finite numbers"),
        ("Robot2_Measurement.dat", 3, f"{BEGIN} 5 1.0", r"Robot2_Measurement.dat:line 3 is .*needs 4 finite numbers"),
        ("Robot2_Groundtruth.dat", 4, f"{BEGIN} 1 2 3", r"Robot2_Groundtruth.dat: time is 1000.000 after 1000.020"),
        ("Landmark_Groundtruth.dat", 2, "6 what", r"Landmark_Groundtruth.dat:line 2 is '6 what', needs 5"),
        ("Barcodes.dat", 2, "1 14", r"Barcodes.dat: 6 subjects share 5 barcodes"),
    ],
)
def test_errors_name_the_file(tmp_path: Path, name: str, line: int, text: str, message: str) -> None:
    folder = write_set(tmp_path / "s")
    change(folder / name, line, text)
    with pytest.raises(ValueError, match=message):
        read_utias(folder)


def test_missing_files(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "s")
    (folder / "Robot2_Groundtruth.dat").unlink()
    with pytest.raises(ValueError, match=r"Robot2_Groundtruth.dat: no such file"):
        read_utias(folder)
    for path in folder.glob("Robot*"):
        path.unlink()
    with pytest.raises(ValueError, match="needs at least one robot"):
        read_utias(folder)
