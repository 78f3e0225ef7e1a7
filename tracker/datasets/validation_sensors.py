"""Consistency of the robots' own sensors: rates, times, stamps, noise and the resolution of encoders, against what sensors.json says."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from tracker.geometry import Array
from tracker.sequence.robot_sensors import SENSOR_TABLES, read_imu, read_sensor_setup, read_stamps, read_wheels, sensor_tables
from tracker.types import ImuSamples, SensorSetup, Sequence

Finding = tuple[Path, str]
MAX_DEVIATION = 8.0
"""Largest error of a sample or a stamp, in standard deviations."""
MISSING = "missing, though sensors.json or truth/clocks.csv tells of it"
UNTOLD = "sensors.json and truth/clocks.csv tell of no such table"
_DIGITS = 1e-8
"""Relative rounding of numbers in a table: 9 digits."""


def sensor_faults(folder: Path, sequence: Sequence, files: Collection[str]) -> Iterator[Finding]:
    """Yield inconsistent tables of the robots' own sensors and the reasons. files: names of the undamaged files.

    Raises ValueError with the path for a table that cannot be read.
    """
    sensors = read_sensor_setup(folder)
    robots = [robot for robot in sequence.setup.starts if not sequence.setup.is_fixed(robot)]
    seconds = (len(sequence.truth or ()) - 1) * sequence.setup.period
    wanted = {f"{name}.csv" for name in sensor_tables(sensors)}
    for name in sorted(wanted | {f"{name}.csv" for name in SENSOR_TABLES}):
        if (name in wanted) != (folder / name).exists():
            yield folder / name, MISSING if name in wanted else UNTOLD
    files = wanted & set(files)
    if {"imu.csv", "truth/inertial.csv"} <= files:
        yield from _imu(folder, robots, seconds, sensors.description["imu"], sensors)
    if "wheels.csv" in files:
        yield from _wheels(folder, robots, seconds, sensors.description["wheels"], sensors)
    if "stamps.csv" in files:
        yield from _frames(folder, [*robots, *sequence.setup.mounts], sequence, sensors)


def _imu(folder: Path, robots: list[str], seconds: float, entry: Mapping[str, float], sensors: SensorSetup) -> Iterator[Finding]:
    path, rate, samples = folder / "imu.csv", entry["rate"], read_imu(folder)
    yield from _names(path, robots, samples)
    for robot, found in samples.items():
        wanted = np.arange(1, math.floor(seconds * rate + 1e-6) + 1) / rate
        yield from _times(path, robot, found.time, found.stamp, wanted, sensors)
        yield from _noise(path, robot, found, entry)


def _noise(path: Path, robot: str, found: ImuSamples, entry: Mapping[str, float]) -> Iterator[Finding]:
    """Samples less their truth and biases must be noise of the part."""
    for name, measured, true, bias in (
        ("gyro", found.gyro, found.true_gyro, found.gyro_bias),
        ("force", found.force, found.true_force, found.force_bias),
    ):
        sigma = entry[f"{name}_noise"] * math.sqrt(entry["rate"])
        error = np.abs(measured - true - bias) - _DIGITS * (np.abs(measured) + np.abs(true) + np.abs(bias))
        if (error > MAX_DEVIATION * sigma).any():
            row = int(np.argmax(error.max(axis=1)))
            yield path, f"{name} of {robot} at {found.time[row]:g} s is {error[row].max():.3g} off truth/inertial.csv, one sigma is {sigma:.3g}"


def _wheels(folder: Path, robots: list[str], seconds: float, entry: Mapping[str, float], sensors: SensorSetup) -> Iterator[Finding]:
    path, samples, count = folder / "wheels.csv", read_wheels(folder), 2 * math.pi / entry["counts"]
    yield from _names(path, robots, samples)
    for robot, found in samples.items():
        wanted = np.arange(math.floor(seconds * entry["rate"] + 1e-6) + 1) / entry["rate"]
        yield from _times(path, robot, found.time, found.stamp, wanted, sensors)
        counts = found.angle / count
        if (np.abs(counts - counts.round()) > 1e-3 + _DIGITS * np.abs(counts)).any():
            yield path, f"an angle of {robot} is no whole count of {count:.6g} rad"


def _names(path: Path, robots: Collection[str], there: Collection[str]) -> Iterator[Finding]:
    for name in sorted(set(robots) ^ set(there)):
        yield path, f"{name[:60]} {'has no row' if name in robots else 'is not of the sequence'}"


def _times(path: Path, name: str, time: Array, stamp: Array, wanted: Array, sensors: SensorSetup) -> Iterator[Finding]:
    """True times must be the wanted ones, and stamps those of the clock."""
    if len(time) != len(wanted):
        yield path, f"{name} has {len(time)} samples, needs {len(wanted)}"
        return
    off = np.abs(time - wanted) > 1e-9 + _DIGITS * wanted
    if off.any():
        row = int(np.argmax(off))
        yield path, f"sample {row} of {name} is at {time[row]:g} s, needs {wanted[row]:g} s"
        return
    if sensors.clocks and name not in sensors.clocks:
        yield path.parent / "truth" / "clocks.csv", f"has no clock of {name[:60]}"
        return
    offset, drift, jitter = sensors.clocks.get(name, (0.0, 0.0, 0.0))
    error = np.abs(stamp - (time * (1 + drift * 1e-6) + offset)) - _DIGITS * (np.abs(stamp) + time) - 1e-9
    if (error > MAX_DEVIATION * jitter).any():
        yield path, f"a stamp of {name} is {error.max():.3g} s off its clock, whose jitter is {jitter:g} s"


def _frames(folder: Path, names: list[str], sequence: Sequence, sensors: SensorSetup) -> Iterator[Finding]:
    path, stamps = folder / "stamps.csv", read_stamps(folder)
    yield from _names(path, names, stamps)
    frames = np.arange(len(sequence.truth or ()), dtype=np.float64)
    for name, rows in stamps.items():
        if rows[:, 0].tolist() != frames.tolist():
            yield path, f"{name[:60]} has other frames than 0 to {len(frames) - 1}"
            continue
        yield from _times(path, name, rows[:, 1], rows[:, 2], frames * sequence.setup.period, sensors)
