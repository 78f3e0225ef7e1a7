"""Checks of the robots' own sensors: valid tables have no faults, and each fault is found in a sequence whose manifest was adapted to it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.tracker import disc_sequence
from tests.tracker.datasets.test_validation import faults, replaced, sealed
from tracker.datasets.croissant import TABLES, croissant_of, describe
from tracker.datasets.dataset_card import card_of
from tracker.formats.summary import summarize, summary_text


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    disc_sequence.write(tmp_path / "s", sensors=disc_sequence.SENSORS)
    return tmp_path / "s"


def test_valid_sensors_have_no_faults(folder: Path) -> None:
    assert faults(folder) == []


def edited(folder: Path, name: str, row: int, column: str, value: str) -> None:
    """Replace one cell of a table."""
    lines = (folder / name).read_text().splitlines()
    cells = lines[row].split(",")
    cells[lines[0].split(",").index(column)] = value
    (folder / name).write_text("\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]]) + "\n")


@pytest.mark.parametrize(
    ("name", "row", "column", "value", "said"),
    [
        ("imu.csv", 5, "gyro_x", "9", "imu.csv: gyro of robot_0 at 0.0252525 s is "),
        ("imu.csv", 5, "force_z", "-90", "imu.csv: force of robot_0 at 0.0252525 s is "),
        ("imu.csv", 3, "stamp", "0.5", "imu.csv: a stamp of robot_0 is 0.23"),
        ("imu.csv", 3, "robot", "robot_1", "inertial.csv: times of robot_0 are not those of imu.csv"),
        ("imu.csv", 3, "gyro_y", "inf", "imu.csv: line 4: gyro_y is inf, needs a finite number"),
        ("wheels.csv", 4, "time", "0.06", "wheels.csv: sample 3 of robot_0 is at 0.06 s, needs 0.0606061 s"),
        ("wheels.csv", 4, "rear_left", "0.003", "wheels.csv: an angle of robot_0 is no whole count of 0.00613592 rad"),
        ("wheels.csv", 1, "robot", "robot_7", "wheels.csv: robot_7 is not of the sequence"),
        ("stamps.csv", 2, "stamp", "0.1", "stamps.csv: a stamp of robot_0_camera is 0.1 s off its clock"),
        ("stamps.csv", 4, "frame", "2", "stamps.csv: robot_0 has other frames than 0 to 2"),
        ("truth/clocks.csv", 1, "offset", "0.2", "imu.csv: a stamp of robot_0 is 0.05"),
        ("truth/clocks.csv", 1, "clock", "robot_1", "truth/clocks.csv: has no clock of robot_0"),
    ],
)
def test_faults_are_found(folder: Path, name: str, row: int, column: str, value: str, said: str) -> None:
    edited(folder, name, row, column, value)
    sealed(folder)
    found = faults(folder)
    assert any(said in line for line in found), found


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"rate": 198.0', '"rate": 200.0', "imu.csv: sample 0 of robot_0 is at 0.00505051 s, needs 0.005 s"),
        ('"rate": 198.0', '"rate": "fast"', "sensors.json: imu: rate is 'fast', needs a number from 1 to 10000"),
        ('"gyro_noise": 0.0001', '"gyro_noise": 1e-6', "imu.csv: gyro of robot_0"),
        ('"wheels"', '"wheel"', "wheels.csv: sensors.json and truth/clocks.csv tell of no such table"),
        ('"rate": 49.5', '"speed": 49.5', "sensors.json: wheels: rate is missing, needs a number from 1 to 10000"),
        ('"counts": 1024', '"counts": 1000', "wheels.csv: an angle of robot_0 is no whole count"),
    ],
)
def test_wrong_descriptions_are_found(folder: Path, old: str, new: str, said: str) -> None:
    replaced(folder, "sensors.json", old, new)
    sealed(folder)
    found = faults(folder)
    assert any(said in line for line in found), found


def test_a_missing_sample_is_found(folder: Path) -> None:
    for name in ("imu.csv", "truth/inertial.csv"):
        lines = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join([*lines[:9], *lines[10:]]) + "\n")
    sealed(folder)
    assert faults(folder) == ["imu.csv: robot_0 has 65 samples, needs 66"]


def test_a_missing_table_is_found(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    for name in ("wheels.csv", "truth/inertial.csv"):
        (folder / name).unlink()
        del manifest["files"][name]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    sealed(folder)
    said = "missing, though sensors.json or truth/clocks.csv tells of it"
    assert faults(folder) == [f"truth/inertial.csv: {said}", f"wheels.csv: {said}"]


def test_the_summary_names_the_sensors(folder: Path, tmp_path: Path) -> None:
    row = summarize(folder)["sequences"][0]
    assert row["imu"] == {"name": "test", "rate": 198.0, "samples": 66}
    assert row["wheels"] == {"rate": 49.5, "samples": 17}
    assert row["clocks"] == 3
    assert "; IMU test at 198 Hz, wheels at 49.5 Hz, 3 clocks with errors; " in summary_text(summarize(folder))
    disc_sequence.write(tmp_path / "plain")
    assert not {"imu", "wheels", "clocks"} & set(summarize(tmp_path / "plain")["sequences"][0])


def test_the_metadata_name_the_tables(folder: Path) -> None:
    names = {"imu", "inertial", "wheels", "stamps", "clocks"}
    assert names <= {record["name"] for record in croissant_of(folder)["recordSet"]}
    for name in names:
        assert all(len(describe(column)) > 5 for column in TABLES[name][1])
    content = {"schema": 1, "preset": "pilsun", "scenario": {}, "views": 0, "form": {}, "sequences": ["s"]}
    (folder.parent / "dataset.json").write_text(json.dumps(content))
    card = card_of(folder.parent)
    for name in ("imu", "wheels", "stamps"):
        assert f"- config_name: {name}\n" in card
        assert f'- "s/{name}.csv"' in card


def test_records_are_read_by_the_formats_own_reader(folder: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    (folder / "croissant.json").write_text(json.dumps(croissant_of(folder)))
    found = list(mlcroissant.Dataset(jsonld=str(folder / "croissant.json")).records("imu"))
    assert len(found) == 66
    assert found[0]["imu/robot"] in (b"robot_0", "robot_0")
