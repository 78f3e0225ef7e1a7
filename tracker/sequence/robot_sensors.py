"""Tables of the robots' own sensors: IMU, wheel encoders and time stamps; rows for the writer, and readers.

schema.SENSORS_README describes them. They are optional: the files in `read_manifest` show which of them a sequence has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.io.csv_tables import read_table
from tracker.io.json_files import JsonObject, read_json
from tracker.sequence.schema import CLOCKS, IMU, INERTIAL, STAMPS, WHEEL_NAMES, WHEELS
from tracker.types import ImuSamples, SensorSamples, SensorSetup, WheelSamples

SENSOR_TABLES: dict[str, Mapping[str, type]] = {
    "imu": IMU,
    "truth/inertial": INERTIAL,
    "wheels": WHEELS,
    "stamps": STAMPS,
    "truth/clocks": CLOCKS,
}
"""Table → its columns."""

NUMBERS: dict[str, dict[str, tuple[float, float]]] = {
    "imu": {"rate": (1.0, 10_000.0), "gyro_noise": (0.0, 100.0), "force_noise": (0.0, 100.0)},
    "wheels": {"rate": (1.0, 10_000.0), "counts": (1.0, 1e9)},
}
"""Entry of sensors.json → the numbers that it needs, with their lowest and highest values."""


def sensor_tables(sensors: SensorSetup) -> dict[str, list[str]]:
    """Tables that a sequence with these sensors has → their columns."""
    there = {"imu": "imu" in sensors.description, "wheels": "wheels" in sensors.description, "stamps": bool(sensors.clocks)}
    there |= {"truth/inertial": there["imu"], "truth/clocks": there["stamps"]}
    return {name: list(columns) for name, columns in SENSOR_TABLES.items() if there[name]}


def sample_rows(frame: int, samples: SensorSamples) -> Iterator[tuple[str, list[list[object]]]]:
    """Name of a table, and rows of the samples of one frame for it, in the order of time."""
    if samples.imu:
        yield "imu", _rows({robot: _numbers(s, "time", "stamp", "gyro", "force") for robot, s in samples.imu.items()})
        truth = {robot: _numbers(s, "time", "true_gyro", "true_force", "gyro_bias", "force_bias") for robot, s in samples.imu.items()}
        yield "inertial", _rows(truth)
    if samples.wheels:
        yield "wheels", _rows({robot: _numbers(s, "time", "stamp", "angle") for robot, s in samples.wheels.items()})
    if samples.stamps:
        yield "stamps", [[frame, clock, *both] for clock, both in samples.stamps.items()]


def _numbers(samples: ImuSamples | WheelSamples, *names: str) -> Array:
    return np.column_stack([getattr(samples, name) for name in names])


def _rows(numbers: Mapping[str, Array]) -> list[list[object]]:
    """Rows with the robot's name first. All robots have the same times: a time's rows of all robots follow each other."""
    lists = {robot: array.tolist() for robot, array in numbers.items()}
    return [[robot, *row] for rows in zip(*lists.values(), strict=True) for robot, row in zip(lists, rows, strict=True)]


def read_imu(folder: Path) -> dict[str, ImuSamples]:
    """Robot → samples of its IMU with their truth. Raises ValueError with file and line for missing or damaged tables.

    It is also raised where the two tables have other robots or times.
    """
    measured, truth = _by_robot(folder, "imu"), _by_robot(folder, "truth/inertial")
    out = {}
    for robot, rows in measured.items():
        true = truth.get(robot, np.zeros((0, len(INERTIAL) - 1)))
        if len(true) != len(rows) or not np.array_equal(true[:, 0], rows[:, 0]):
            raise ValueError(f"{folder / 'truth' / 'inertial.csv'}: times of {robot} are not those of imu.csv")
        values = [rows[:, 2:5], rows[:, 5:8], true[:, 1:4], true[:, 4:7], true[:, 7:10], true[:, 10:13]]
        out[robot] = ImuSamples(rows[:, 0], rows[:, 1], *values)
    if set(truth) - set(measured):
        raise ValueError(f"{folder / 'truth' / 'inertial.csv'}: has {min(set(truth) - set(measured))[:60]}, which imu.csv has not")
    return out


def read_wheels(folder: Path) -> dict[str, WheelSamples]:
    """Robot → samples of its wheel encoders, wheels in the order of schema.WHEEL_NAMES. Raises ValueError with file and line."""
    return {robot: WheelSamples(rows[:, 0], rows[:, 1], rows[:, 2 : 2 + len(WHEEL_NAMES)]) for robot, rows in _by_robot(folder, "wheels").items()}


def read_stamps(folder: Path) -> dict[str, Array]:
    """Robot or camera → frame, true time s, stamp s (n, 3). Raises ValueError with file and line."""
    table = read_table(folder / "stamps.csv", STAMPS)
    numbers = np.column_stack([table[name] for name in ("frame", "time", "stamp")]).reshape(-1, 3)
    return {str(name): numbers[table["clock"] == name] for name in dict.fromkeys(table["clock"].tolist())}


def read_sensor_setup(folder: Path) -> SensorSetup:
    """Description of the sensors, and true errors of the clocks; empty where the sequence has none.

    Raises ValueError with file and line or field, also for an entry whose NUMBERS are missing or out of their bounds.
    """
    description = _description(folder / "sensors.json") if (folder / "sensors.json").is_file() else {}
    clocks = {}
    if (folder / "truth" / "clocks.csv").is_file():
        table = read_table(folder / "truth" / "clocks.csv", CLOCKS)
        clocks = {str(name): (float(o), float(d), float(j)) for name, o, d, j in zip(*table.values(), strict=True)}
    return SensorSetup(description, clocks)


def _description(path: Path) -> dict[str, Any]:
    content = JsonObject(read_json(path), str(path))
    for name in content.values:
        for number, (low, high) in NUMBERS.get(name, {}).items():
            content.part(name).number(number, low, high)
        content.part(name)
    return content.values


def _by_robot(folder: Path, name: str) -> dict[str, Array]:
    """Robot → numbers of its rows, without the first column."""
    columns = SENSOR_TABLES[name]
    table = read_table(folder / f"{name}.csv", columns)
    numbers = np.column_stack([table[column] for column in list(columns)[1:]]).reshape(-1, len(columns) - 1)
    return {str(robot): numbers[table["robot"] == robot] for robot in dict.fromkeys(table["robot"].tolist())}
