"""The sensors on the rovers beside the cameras: IMU and wheel encoders, sampled at the physics steps, and the clocks that stamp their samples.

All random numbers come from separate streams, so that these sensors change nothing else in a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from sim.robots.clock import Clock, ClockSpecification, parse_clocks
from sim.robots.imu import PARTS, ImuErrors, parse_imu
from sim.robots.odometry import ENCODER_COUNTS
from sim.robots.rover import WHEEL_RADIUS, WHEELS, wheel_positions
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Pose
from tracker.sequence.calibration import pose_row
from tracker.types import ImuSamples, SensorSamples, SensorSetup, Setup, WheelSamples

COUNT = 2 * np.pi / ENCODER_COUNTS
"""rad: resolution of the wheel encoders."""


class RobotSensors:
    """The sensors of all rovers of a scenario; `sample` is called once a frame, after the step to it.

    It makes the simulation keep the states of its physics steps. Raises ValueError where a clock has a name that is neither a robot's nor a
    camera's of the setup.
    """

    def __init__(self, simulation: Simulation, setup: Setup) -> None:
        scenario = simulation.scenario
        self.scenario, self._simulation = scenario, simulation
        simulation.keep_steps = simulation.keep_steps or bool(scenario.imu or scenario.wheels)
        self.clocks = _draw_clocks(scenario, [*simulation.robots, *setup.mounts])
        self._stamp_streams = {name: scenario.stream(f"clock/{name}/frames") for name in self.clocks}
        self._step = 0
        timestep = 1 / scenario.physics_rate
        robots = simulation.robots
        if scenario.imu:
            part, streams = PARTS[parse_imu(scenario.imu)[0]], [scenario.stream(f"{robot}/imu") for robot in robots]
            self._imus = [ImuErrors(part, scenario.imu_steps * timestep, rng) for rng in streams]
            self._imu_mounts = [simulation.imu_mount(robot) for robot in robots]
            self._imu_clocks = [scenario.stream(f"{robot}/imu/stamps") for robot in robots]
            # True angular velocities and forces (n, robots, 6) of steps that no sample holds yet.
            self._pending: Array = np.zeros((0, len(robots), 6))
        self._wheel_clocks = [scenario.stream(f"{robot}/wheels/stamps") for robot in robots]

    @staticmethod
    def of(simulation: Simulation, setup: Setup) -> RobotSensors | None:
        """The sensors, or None where the scenario has none of them."""
        scenario = simulation.scenario
        return RobotSensors(simulation, setup) if scenario.imu or scenario.wheels or scenario.clock else None

    def setup(self) -> SensorSetup:
        """The description of the sensors for users of the samples, and the true errors of the clocks."""
        clocks = {name: (clock.offset, clock.drift, clock.jitter) for name, clock in self.clocks.items()}
        return SensorSetup(self._description(), clocks)

    def _description(self) -> dict[str, Any]:
        out: dict[str, Any] = {}
        if self.scenario.imu:
            name = parse_imu(self.scenario.imu)[0]
            mount: dict[str, Any] = {"T_body_imu": pose_row(Pose.identity()), "gravity": [0.0, 0.0, float(self._simulation.model.opt.gravity[2])]}
            told = {name: pose_row(T) for name, T in zip(self._simulation.robots, self._imu_mounts, strict=True)}
            if any(row != mount["T_body_imu"] for row in told.values()):
                mount["T_body_imu_of_robots"] = told
            out["imu"] = {"name": name, "rate": self.scenario.physics_rate / self.scenario.imu_steps} | asdict(PARTS[name]) | mount
        if self.scenario.wheels:
            rate, positions = self.scenario.physics_rate / self.scenario.wheel_steps, wheel_positions().tolist()
            out["wheels"] = {"rate": rate, "names": list(WHEELS), "radius": WHEEL_RADIUS, "positions": positions, "counts": ENCODER_COUNTS}
        return out

    def sample(self, frame: int) -> SensorSamples:
        """Samples since the frame before, in the order of time. Frame 0 has the wheel angles at the time 0 alone."""
        imu: Mapping[str, ImuSamples] = {}
        wheels: Mapping[str, WheelSamples] = {}
        if self.scenario.wheels:
            wheels = self._sample_wheels(frame)
        if self.scenario.imu and frame:
            imu = self._sample_imu()
        if frame:
            self._step += self.scenario.crowd_steps * self.scenario.substeps
        return SensorSamples(imu, wheels, self._frame_stamps(frame * self.scenario.period))

    def _sample_imu(self) -> dict[str, ImuSamples]:
        states, n = self._simulation.step_states().at_sensors(self._imu_mounts), self.scenario.imu_steps
        steps = np.concatenate([self._pending, np.concatenate([states.angular_velocity(), states.specific_force()], axis=2)])
        count = len(steps) // n
        first = self._step - len(self._pending)
        self._pending = steps[count * n :]
        true = steps[: count * n].reshape(count, n, len(self._imus), 6).mean(axis=1)
        time = (first + n * np.arange(1, count + 1)) / self.scenario.physics_rate
        out = {}
        for i, robot in enumerate(self._simulation.robots):
            bias, noise = self._imus[i].draw(count)
            stamp = self._stamps(robot, time, self._imu_clocks[i])
            measured = true[:, i] + bias + noise
            parts = (each[:, axes] for each in (measured, true[:, i], bias) for axes in (slice(3), slice(3, 6)))
            out[robot] = ImuSamples(time, stamp, *parts)
        return out

    def _sample_wheels(self, frame: int) -> dict[str, WheelSamples]:
        n = self.scenario.wheel_steps
        if frame:
            angles = self._simulation.step_states().wheels[1:]
            at = np.arange(self._step + 1, self._step + 1 + len(angles))
        else:
            angles, at = self._simulation.wheel_angles()[None], np.zeros(1, dtype=np.int64)
        sampled = at % n == 0
        time = at[sampled] / self.scenario.physics_rate
        whole = np.floor(angles[sampled] / COUNT) * COUNT
        return {
            robot: WheelSamples(time, self._stamps(robot, time, self._wheel_clocks[i]), whole[:, i])
            for i, robot in enumerate(self._simulation.robots)
        }

    def _stamps(self, name: str, time: Array, rng: np.random.Generator) -> Array:
        return self.clocks[name].stamps(time, rng) if self.clocks else time

    def _frame_stamps(self, time: float) -> dict[str, tuple[float, float]]:
        return {name: (time, float(clock.stamps(np.array([time]), self._stamp_streams[name])[0])) for name, clock in self.clocks.items()}


def _draw_clocks(scenario: Scenario, names: list[str]) -> dict[str, Clock]:
    """Name of a robot or camera → its clock; empty where the scenario has no errors of clocks."""
    if not scenario.clock:
        return {}
    wanted = parse_clocks(scenario.clock)
    unknown = next((name for name in wanted if name and name not in names), None)
    if unknown is not None:
        raise ValueError(f"clock names {unknown[:60]!r}, needs one of {', '.join(names)}")
    none = ClockSpecification(Clock(), frozenset())
    return {name: wanted.get(name, wanted.get("", none)).draw(scenario.stream(f"clock/{name}")) for name in names}
