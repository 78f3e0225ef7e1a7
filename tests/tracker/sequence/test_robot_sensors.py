"""Tables of the robots' own sensors: write∘read, and what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import disc_sequence
from tracker.sequence.manifest import read_manifest
from tracker.sequence.robot_sensors import read_imu, read_sensor_setup, read_stamps, read_wheels, sensor_tables
from tracker.types import ImuSamples, SensorSetup

TABLES = {"imu.csv", "wheels.csv", "stamps.csv", "truth/inertial.csv", "truth/clocks.csv", "sensors.json"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sensors") / "s"
    disc_sequence.write(path, sensors=disc_sequence.SENSORS)
    return path


def test_samples_come_back(folder: Path) -> None:
    frames = [disc_sequence.samples(k) for k in range(disc_sequence.FRAMES)]
    imu = read_imu(folder)["robot_0"]
    for field in dataclasses.fields(ImuSamples):
        written = np.concatenate([getattr(frame.imu["robot_0"], field.name) for frame in frames[1:]])
        np.testing.assert_allclose(getattr(imu, field.name), written, rtol=1e-8, atol=1e-12)
    wheels = read_wheels(folder)["robot_0"]
    for name in ("time", "stamp", "angle"):
        written = np.concatenate([getattr(frame.wheels["robot_0"], name) for frame in frames])
        np.testing.assert_allclose(getattr(wheels, name), written, rtol=1e-8, atol=1e-12)
    stamps = read_stamps(folder)
    assert list(stamps) == ["robot_0", "robot_0_camera", "View_001"]
    for name, rows in stamps.items():
        np.testing.assert_allclose(rows, [[k, *frame.stamps[name]] for k, frame in enumerate(frames)], rtol=1e-8, atol=1e-12)
    again = read_sensor_setup(folder)
    assert again.clocks == disc_sequence.SENSORS.clocks
    assert again.description == disc_sequence.SENSORS.description


def test_the_manifest_names_the_tables_and_the_readme_describes_them(folder: Path, tmp_path: Path) -> None:
    files = set(read_manifest(folder)["files"])
    assert files >= TABLES
    text = (folder / "README.md").read_text()
    assert all(f"`{name}`" in text for name in TABLES)
    disc_sequence.write(tmp_path / "plain")
    assert set(read_manifest(tmp_path / "plain")["files"]) == files - TABLES
    assert "imu.csv" not in (tmp_path / "plain" / "README.md").read_text()
    assert not read_sensor_setup(tmp_path / "plain").description


def test_a_sequence_has_the_tables_of_its_sensors_alone() -> None:
    assert set(sensor_tables(SensorSetup({"imu": {}}))) == {"imu", "truth/inertial"}
    assert set(sensor_tables(SensorSetup({"wheels": {}}))) == {"wheels"}
    assert set(sensor_tables(SensorSetup(clocks={"robot_0": (0.0, 0.0, 0.0)}))) == {"stamps", "truth/clocks"}
