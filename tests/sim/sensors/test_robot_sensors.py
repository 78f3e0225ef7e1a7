"""The rovers' own sensors against the truth of the physics: integrated IMU, wheels, clocks, and independence of everything else."""

from __future__ import annotations

import dataclasses
import itertools
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.recording.frames import raycast_frames, simulated_frames
from sim.recording.tracker_setup import make_setup
from sim.robots.rover import WHEEL_RADIUS
from sim.scenario import Scenario
from sim.sensors.robot_sensors import COUNT, RobotSensors
from sim.simulation import wheel_slip
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.geometry import Pose
from tracker.types import ImuSamples, SensorSamples, WheelSamples

QUARRY = Scenario(world="quarry", robots=2, people=0, frames=31, imu="ideal", wheels=198, seed=3)
"""Five seconds."""


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """A scenario driven to its end: samples of every frame, and poses by frame and robot."""

    samples: list[SensorSamples]
    poses: list[dict[str, Pose]]

    @staticmethod
    def of(simulation: Simulation) -> Drive:
        states = list(simulated_frames(simulation, make_setup(simulation)))
        return Drive([state.samples for state in states], [state.truth.T_world_robot for state in states])

    def imu(self, robot: str) -> ImuSamples:
        found = [samples.imu[robot] for samples in self.samples if samples.imu]
        return ImuSamples(*(np.concatenate([getattr(one, field.name) for one in found]) for field in dataclasses.fields(ImuSamples)))

    def wheels(self, robot: str) -> WheelSamples:
        found = [samples.wheels[robot] for samples in self.samples]
        return WheelSamples(*(np.concatenate([getattr(one, field.name) for one in found]) for field in dataclasses.fields(WheelSamples)))


@pytest.fixture(scope="module")
def quarry() -> Drive:
    return Drive.of(Simulation(QUARRY))


def integrated(imu: ImuSamples, start: Pose, scheme: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations (n, 3, 3), velocities and positions (n, 3) at the samples, from rest at `start`.

    scheme: `steps` moves by the velocity at the end of each step, as the physics does, `trapezoid` by its mean.
    """
    gravity, before = np.array([0.0, 0.0, -9.81]), np.concatenate([[0.0], imu.time[:-1]])
    R, v, p = Rotation.from_matrix(start.rotation), np.zeros(3), np.array(start.translation)
    out = []
    for dt, rate, force in zip(imu.time - before, imu.gyro, imu.force, strict=True):
        dv = (R * Rotation.from_rotvec(rate * dt / 2)).apply(force.copy()) * dt + gravity * dt
        p = p + (v + dv if scheme == "steps" else v + dv / 2) * dt
        R, v = R * Rotation.from_rotvec(rate * dt), v + dv
        out.append((R.as_matrix(), v, p))
    return tuple(np.array(each) for each in zip(*out, strict=True))  # type: ignore[return-value]


def test_integrated_imu_gives_the_true_poses(quarry: Drive) -> None:
    """A sample of one step holds exactly what the physics did in it: five seconds of quarry come back to rounding."""
    moved = 0.0
    for robot in ("robot_0", "robot_1"):
        imu, dt = quarry.imu(robot), 1 / 198
        assert len(imu.time) == 5 * 198
        np.testing.assert_allclose(imu.time, np.arange(1, 991) * dt, rtol=1e-12)
        R, v, p = integrated(imu, quarry.poses[0][robot], "steps")
        R2, _, trapezoid = integrated(imu, quarry.poses[0][robot], "trapezoid")
        np.testing.assert_array_equal(R, R2)
        for frame in range(1, QUARRY.frames):
            pose, k = quarry.poses[frame][robot], 33 * frame - 1
            assert np.abs(pose.rotation - R[k]).max() < 1e-9
            assert np.abs(pose.translation - p[k]).max() < 1e-9
            # The physics moves by the velocity at the end of a step, not by the mean: the sums differ by dt/2 times the velocity gained.
            assert np.linalg.norm(pose.translation - trapezoid[k]) <= dt / 2 * np.linalg.norm(v[k]) + 1e-9
        moved = max(moved, float(np.linalg.norm(p[-1] - p[0])))
    assert moved > 0.5


def test_samples_of_two_steps_turn_as_their_steps_do_to_second_order() -> None:
    """The mean rate over two steps h misses h²/2 |a × b| of their product of rotations (Baker, Campbell and Hausdorff)."""
    scenario = dataclasses.replace(QUARRY, robots=1, frames=13, timestep=0.0025, imu="ideal@198")
    assert scenario.imu_steps == 2
    simulation = Simulation(scenario, yard(0.15))
    sensors, pose = RobotSensors(simulation, make_setup(simulation)), simulation.T_world_robot("robot_0")
    R, bound, h = Rotation.from_matrix(pose.rotation), 0.0, 1 / 396
    sensors.sample(0)
    for frame in range(1, scenario.frames):
        simulation.step()
        steps = simulation.step_states().angular_velocity()[:, 0].reshape(-1, 2, 3)
        for rate in sensors.sample(frame).imu["robot_0"].gyro:
            R = R * Rotation.from_rotvec(rate * 2 * h)
        bound += 0.5 * h**2 * float(np.linalg.norm(np.cross(steps[:, 0], steps[:, 1]), axis=1).sum())
    error = (R.inv() * Rotation.from_matrix(simulation.T_world_robot("robot_0").rotation)).magnitude()
    assert 0 < error <= bound * 1.01 + 1e-9
    assert bound < 2e-3


@pytest.mark.soak
def test_wheels_roll_the_true_distance_within_the_slip() -> None:
    scenario = Scenario(robots=2, people=0, frames=91, wheels=198, seed=1)
    drive, slip = Drive.of(Simulation(scenario, yard())), wheel_slip.measure(Simulation(scenario, yard()), 15.0)
    assert slip.error > 0
    for robot in ("robot_0", "robot_1"):
        wheels = drive.wheels(robot)
        np.testing.assert_allclose(wheels.time, np.arange(15 * 198 + 1) / 198, rtol=1e-12)
        assert np.abs(wheels.angle / COUNT - np.round(wheels.angle / COUNT)).max() < 1e-6
        rolled = WHEEL_RADIUS * np.diff(wheels.angle[::33].mean(axis=1))
        poses = [poses[robot] for poses in drive.poses]
        ahead = np.array([a.rotation[:, 0] + b.rotation[:, 0] for a, b in itertools.pairwise(poses)])
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        moved = np.diff([pose.translation for pose in poses], axis=0)
        driven = float(np.linalg.norm(moved, axis=1).sum())
        assert driven > 3
        error = np.linalg.norm((rolled[:, None] * ahead - moved).sum(axis=0))
        # The mean slip of segments of 5 m of both rovers, doubled for a single drive, and a count of quantisation.
        assert error <= 2 * slip.error * driven + COUNT * WHEEL_RADIUS


def test_wheels_at_a_rate_that_no_frame_divides() -> None:
    scenario = Scenario(robots=1, people=0, frames=4, wheels=49.5, seed=1)
    fine = dataclasses.replace(scenario, wheels=198)
    coarse, every = (Drive.of(Simulation(each, yard())).wheels("robot_0") for each in (scenario, fine))
    np.testing.assert_allclose(coarse.time, np.arange(25) * 4 / 198, rtol=1e-12)
    np.testing.assert_array_equal(coarse.angle, every.angle[::4])


FULL = Scenario(robots=2, people=1, frames=3, imu="bmi088", wheels=66, clock="offset=±0.05,jitter=0.001;robot_1_camera:drift=50", seed=9)


def test_sensors_change_nothing_else_and_the_same_seed_gives_the_same_samples() -> None:
    bare = dataclasses.replace(FULL, imu="", wheels=0.0, clock="")
    runs = [list(raycast_frames(s := Simulation(each, yard()), make_setup(s))) for each in (FULL, bare, FULL)]
    for full, plain, again in zip(*runs, strict=True):
        for view, other in zip(full.tick.views, plain.tick.views, strict=True):
            np.testing.assert_array_equal(view.detections.bearing, other.detections.bearing)
            if view.odometry is not None:
                assert other.odometry is not None
                np.testing.assert_array_equal(view.odometry.T_before_now.log(), other.odometry.T_before_now.log())
        for robot, pose in full.truth.T_world_robot.items():
            np.testing.assert_array_equal(pose.translation, plain.truth.T_world_robot[robot].translation)
        assert not plain.samples.imu
        assert full.samples.stamps == again.samples.stamps
        for robot, imu in full.samples.imu.items():
            np.testing.assert_array_equal(imu.gyro, again.samples.imu[robot].gyro)
            np.testing.assert_array_equal(imu.stamp, again.samples.imu[robot].stamp)
            np.testing.assert_array_equal(full.samples.wheels[robot].angle, again.samples.wheels[robot].angle)
    assert runs[0][1].samples.imu


def test_every_clock_is_its_own() -> None:
    simulation = Simulation(FULL, yard())
    sensors = RobotSensors(simulation, make_setup(simulation))
    clocks = sensors.setup().clocks
    assert list(clocks) == ["robot_0", "robot_1", "robot_0_camera", "robot_1_camera"]
    assert clocks["robot_1_camera"] == (0.0, 50.0, 0.0)
    assert len({offset for offset, _, _ in clocks.values()}) == 4
    simulation.step()
    sensors.sample(0)
    samples = sensors.sample(1)
    assert samples.stamps["robot_1_camera"][1] == pytest.approx(FULL.period * (1 + 50e-6), rel=1e-12)
    offset = clocks["robot_0"][0]
    error = samples.imu["robot_0"].stamp - samples.imu["robot_0"].time - offset
    assert 0 < np.abs(error).max() < 6e-3


def test_clocks_of_unknown_cameras_and_wrong_sensors_are_refused() -> None:
    scenario = dataclasses.replace(FULL, clock="View_003:offset=1")
    simulation = Simulation(scenario, yard())
    with pytest.raises(ValueError, match=re.escape("clock names 'View_003', needs one of robot_0, robot_1, robot_0_camera")):
        RobotSensors(simulation, make_setup(simulation))
    for field, value, message in (
        ("imu", "mpu", "imu is 'mpu', needs NAME or NAME@HZ"),
        ("imu", "bmi088@50", "imu is 50 Hz, needs 100 to 400 Hz"),
        ("imu", "bmi088@150", "imu is 150 Hz, needs a whole number of physics steps: 198 Hz"),
        ("imu", 3, "imu is 3, needs a text"),
        ("wheels", 50, "wheels is 50 Hz, needs a whole number of physics steps: 198, 99, 66, 49.5, "),
        ("wheels", -1, "wheels is -1 Hz, needs 10 to 400 Hz"),
        ("wheels", "50", "wheels is '50', needs a number of Hz"),
        ("clock", "jitter=-1", "clock has jitter '-1'"),
        ("clock", "robot_7:jitter=1", "clock names 'robot_7', needs a robot or a camera"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            dataclasses.replace(FULL, **{field: value})


def test_states_of_steps_are_kept_only_when_asked_for() -> None:
    simulation = Simulation(dataclasses.replace(FULL, imu="", wheels=0.0), yard())
    simulation.step()
    with pytest.raises(ValueError, match="set keep_steps before the step"):
        simulation.step_states()
