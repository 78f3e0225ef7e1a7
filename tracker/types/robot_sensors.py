"""Samples of the sensors on robots: inertial measurement unit, wheel encoders, and time stamps of robots and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tracker.geometry import Array
from tracker.geometry.arrays import set_array


@dataclass(frozen=True, eq=False)
class ImuSamples:
    """Samples of one robot's IMU, in its body frame (x forward, y left, z up), with their truth.

    time (n,) s: true time of the end of each sample, which is the mean over the interval since the sample before.
    stamp (n,) s: that time on the robot's clock. gyro (n, 3) rad/s. force (n, 3) m/s²: specific force, which is up at rest.
    true_gyro, true_force: the same without errors. gyro_bias, force_bias (n, 3): biases that are in the samples.
    """

    time: Array
    stamp: Array
    gyro: Array
    force: Array
    true_gyro: Array
    true_force: Array
    gyro_bias: Array
    force_bias: Array

    def __post_init__(self) -> None:
        set_array(self, "time", (None,))
        set_array(self, "stamp", (len(self.time),))
        for name in ("gyro", "force", "true_gyro", "true_force", "gyro_bias", "force_bias"):
            set_array(self, name, (len(self.time), 3))


@dataclass(frozen=True, eq=False)
class WheelSamples:
    """Samples of one robot's wheel encoders.

    time (n,) s: true time. stamp (n,) s: that time on the robot's clock. angle (n, wheels) rad: total angle of each wheel, in whole counts.
    """

    time: Array
    stamp: Array
    angle: Array

    def __post_init__(self) -> None:
        set_array(self, "time", (None,))
        set_array(self, "stamp", (len(self.time),))
        set_array(self, "angle", (len(self.time), None))


@dataclass(frozen=True, eq=False)
class SensorSamples:
    """Samples of a frame or of a whole sequence: robot → IMU, robot → wheels.

    stamps: robot or camera → (true time s, time s on its clock) of the frame; empty where clocks have no errors.
    """

    imu: Mapping[str, ImuSamples] = field(default_factory=dict)
    wheels: Mapping[str, WheelSamples] = field(default_factory=dict)
    stamps: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SensorSetup:
    """The sensors of a sequence beside its cameras.

    description: content of sensors.json, with an entry `imu` and `wheels` where robots have them.
    clocks: robot or camera → true offset s, drift ppm and jitter s (one sigma) of its clock; empty where clocks have no errors.
    """

    description: Mapping[str, Any] = field(default_factory=dict)
    clocks: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
