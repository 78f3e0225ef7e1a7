"""UTIAS data sets: reading, rejected measurements, and errors."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.planar_slam.mrclam import BEGIN, LANDMARKS, SECONDS, write_set
from tracker.planar_slam.utias_files import is_utias, read_utias


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
    assert team.repairs[0] == "landmarks 11 and 17 of set 1 exchanged"
    assert team.repairs[1:] == tuple(f"Robot{n}_Odometry.dat: {rows} repeated rows merged" for n, rows in ((2, 8), (3, 18), (4, 14), (5, 12)))
    robot = team.robots[2]
    mine = robot.subject == 11
    t, truth = robot.measurements[mine, 0], robot.truth
    x, y = np.interp(t, truth[:, 0], truth[:, 1]), np.interp(t, truth[:, 0], truth[:, 2])
    reach = np.hypot(team.landmarks[11][0] - x, team.landmarks[11][1] - y)
    assert np.median(np.abs(reach - robot.measurements[mine, 1])) < 0.2
    other = read_utias(data("utias", "MRCLAM_Dataset6"))
    assert "Robot2_Odometry.dat: 1 repeated row merged" in other.repairs
    assert sum(sum(r.rejected.values()) for r in other.robots.values()) == 6


def test_rejected_measurements_are_counted_by_reason(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "s")
    late = BEGIN + SECONDS
    with (folder / "Robot1_Measurement.dat").open("a") as file:
        file.write(f"{late} 99 1.0 0.0\n{late} 5 1.0 0.0\n{late} 72 0.0 0.0\n{late} 72 -1.0 0.0\n")
    (folder / "Barcodes.dat").write_text((folder / "Barcodes.dat").read_text() + " 3 41 \n")
    with (folder / "Robot2_Measurement.dat").open("a") as file:
        file.write(f"{late} 41 1.0 0.0\n")
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
        (
            "Robot1_Odometry.dat",
            7,
            f"{BEGIN - 1} 0.1 0.1",
            r"Robot1_Odometry.dat:7: time is 999.000 after 1000.100 in line 6, needs steps back of less",
        ),
        ("Robot1_Measurement.dat", 60, f"{BEGIN} 5 1 1", r"Robot1_Measurement.dat:60: time is 1000.000 after 1005.500 in line 56, needs steps back"),
        ("Robot1_Odometry.dat", 7, f"{BEGIN} nan 0.1", r"Robot1_Odometry.dat:7: value 2 is nan, needs a finite number"),
        ("Robot1_Odometry.dat", 1, "1e15 0 0", r"Robot1_Odometry.dat:1: time is 1e\+15, needs seconds, at most 1e\+11"),
        ("Robot2_Measurement.dat", 3, f"{BEGIN} 5 1.0", "Robot2_Measurement.dat:3: 3 values, needs 4"),
        ("Robot2_Measurement.dat", 3, f"{BEGIN} 5 1e30 0", r"Robot2_Measurement.dat:3: value 3 is 1e\+30, needs at most 1e\+06 in size"),
        ("Robot2_Groundtruth.dat", 4, f"{BEGIN} 1 2 3", r"Robot2_Groundtruth.dat:4: time is 1000.000 for a second time with another pose"),
        ("Landmark_Groundtruth.dat", 2, "6 what", "Landmark_Groundtruth.dat:2: 2 values, needs 5"),
        ("Landmark_Groundtruth.dat", 3, "6 1 1 0 0", r"Landmark_Groundtruth.dat:3: value 1 is 6 as in line 2"),
        ("Landmark_Groundtruth.dat", 3, "5 1 1 0 0", r"Landmark_Groundtruth.dat:3: subject of a landmark is 5, needs at least 6"),
        ("Barcodes.dat", 2, "1 14", r"Barcodes.dat:3: value 2 is 14 as in line 2"),
        ("Barcodes.dat", 2, "1 14.5", r"Barcodes.dat:2: value 2 is 14.5, needs a whole number from 0 to 1e\+06"),
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


@pytest.mark.parametrize("name", ["Odometry", "Groundtruth", "Measurement"])
def test_rows_that_step_back_a_little_are_sorted_and_repeated_rows_merged(tmp_path: Path, name: str) -> None:
    clean = read_utias(write_set(tmp_path / "clean")).robots[1]
    folder = write_set(tmp_path / "s")
    path = folder / f"Robot1_{name}.dat"
    lines = path.read_text().splitlines()
    if name == "Measurement":
        # Scans are 0.5 s apart, which is a large step; rows of one scan have one time.
        lines.insert(9, lines[6])
        wanted = "1 repeated row merged"
    else:
        # Rows are 0.02 s apart. Five rows come after that of 5 steps later, and two after the copy of that of 2 steps later.
        lines[5], lines[10] = lines[10], lines[5]
        lines.insert(20, lines[22])
        wanted = "7 rows out of order by up to 0.10 s sorted, 1 repeated row merged"
    path.write_text("\n".join(lines) + "\n")
    team = read_utias(folder)
    assert team.repairs == (f"Robot1_{name}.dat: {wanted}",)
    dirty = team.robots[1]
    np.testing.assert_array_equal(dirty.odometry, clean.odometry)
    np.testing.assert_array_equal(dirty.truth, clean.truth)
    assert {tuple(row) for row in dirty.measurements.tolist()} == {tuple(row) for row in clean.measurements.tolist()}
    assert len(dirty.measurements) == len(clean.measurements)


def test_repeated_rows_without_times_are_merged(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "s")
    for name in ("Barcodes.dat", "Landmark_Groundtruth.dat"):
        lines = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join([*lines, lines[-1], ""]))
    team = read_utias(folder)
    assert team.repairs == ("Barcodes.dat: 1 repeated row merged", "Landmark_Groundtruth.dat: 1 repeated row merged")
    assert {s: tuple(p) for s, p in team.landmarks.items()} == LANDMARKS


def test_a_file_without_measurements_gives_no_warning(tmp_path: Path) -> None:
    folder = write_set(tmp_path / "s")
    (folder / "Robot1_Measurement.dat").write_text("# Time Barcode range bearing\n\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_utias(folder).robots[1].measurements) == 0
