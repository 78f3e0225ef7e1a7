"""Detection of rovers: by line of sight, equal in rendered and ray-cast runs, with random streams of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim.recording.frames import Frame, raycast_frames
from sim.recording.record import record
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.sensors.raycast_camera import RobotDetector
from sim.simulation.simulation import Simulation
from sim.stress.sweeps import Faults
from tests.sim.yard import yard
from tracker.datasets.validation import validate
from tracker.sequence.reader import read_sequence

SCENARIO = Scenario(seed=31, robots=4, people=8, frames=6, width=256)


@pytest.fixture(scope="module")
def glimpses() -> list[Frame]:
    simulation = Simulation(SCENARIO, world=yard())
    return list(raycast_frames(simulation, make_setup(simulation)))


def test_a_rover_is_detected_if_nothing_occludes_it() -> None:
    """Against MuJoCo's rays, which test every cell of the ground."""
    scenario = replace(SCENARIO, misses=0.0, bearing_noise=0.0, camera_height=0.8)
    simulation = Simulation(scenario, world=yard())
    robot_detector = RobotDetector(simulation, make_setup(simulation))
    groups, geom = np.array([1, 1, 1, 1, 0, 0], np.uint8), np.zeros(1, np.int32)
    seen = hidden = 0
    for _ in range(12):
        simulation.step()
        poses = {robot: simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots}
        for robot, pose in poses.items():
            found = robot_detector.detect(f"{robot}_camera")
            assert found is not None
            for other in sorted(set(simulation.robots) - {robot}):
                way = poses[other].translation - pose.translation
                length = float(np.linalg.norm(way))
                hit = mujoco.mj_ray(simulation.model, simulation.data, pose.translation.copy(), way / length, groups, 1, -1, geom, None)
                assert (other in found.robot) == (hit < 0 or hit > length)
                if other in found.robot:
                    np.testing.assert_allclose(pose.rotation @ found.bearing[found.robot.index(other)], way / length, atol=1e-9)
                    seen += 1
                else:
                    hidden += 1
    assert seen > 40
    assert hidden > 5


def test_errors_are_as_the_covariance_says(glimpses: list[Frame]) -> None:
    setup = make_setup(Simulation(SCENARIO, world=yard()))
    squares, there = [], 0
    for glimpse in glimpses:
        for view in glimpse.tick.views:
            c, poses, mount = view.robot_detections, glimpse.truth.T_world_robot, setup.mounts[view.camera]
            assert c is not None
            there += len(c)
            for robot, bearing, covariance in zip(c.robot, c.bearing, c.covariance, strict=True):
                sight = (poses[mount.robot] @ mount.T_body_camera).inverse().apply((poses[robot] @ mount.T_body_camera).translation)
                squares.append(np.sum((bearing - sight / np.linalg.norm(sight)) ** 2) / covariance[0, 0] / 2)
    assert there > 40
    assert np.mean(squares) == pytest.approx(1.0, abs=0.4)


def test_more_misses_change_nothing_else(glimpses: list[Frame]) -> None:
    """Misses do not move other detections. Detections of people and sightings are identical without detection of robots."""
    simulation = Simulation(SCENARIO, world=yard())
    setup = make_setup(simulation)
    unoccluded = replace(setup, mounts=dict(list(setup.mounts.items())[:1]))
    for a, b in zip(glimpses, raycast_frames(simulation, unoccluded), strict=True):
        one, other = a.tick.views[0], b.tick.views[0]
        assert one.detections.bearing.tobytes() == other.detections.bearing.tobytes()
        assert one.sightings is not None
        assert other.sightings is not None
        assert one.sightings.bearing.tobytes() == other.sightings.bearing.tobytes()
        assert other.robot_detections is not None
        assert len(other.robot_detections) == 0


def test_a_blinded_camera_sees_no_robots(glimpses: list[Frame]) -> None:
    setup = make_setup(Simulation(SCENARIO, world=yard()))
    ticks = [glimpse.tick for glimpse in glimpses]
    sent = Faults(dropout=0.5).degraded_ticks(setup, ticks, 1)
    blind = [view for tick in sent for view in tick.views if view.sightings is None]
    assert blind
    assert all(view.robot_detections is None for view in blind)
    carried = Faults(kidnapped=SCENARIO.period * 3).degraded_ticks(setup, ticks, 1)
    assert [tick.views[0].robot_detections is None for tick in carried] == [False, False, False, True, True, True]
    assert all(view.robot_detections is not None for tick in carried for view in tick.views[1:]), "others see it where it is carried"


@pytest.mark.render
def test_rendered_runs_detect_the_same_rovers(tmp_path: Path) -> None:
    """A rendered recording has the detections of a ray-cast run, is read back, and is consistent."""
    scenario = Scenario(seed=31, robots=3, people=4, frames=3, width=256)
    record(scenario, tmp_path / "s")
    simulation = Simulation(scenario)
    unrendered = raycast_frames(simulation, make_setup(simulation))
    count = 0
    for tick, glimpse in zip(read_sequence(tmp_path / "s").ticks, unrendered, strict=True):
        for a, b in zip(tick.views, glimpse.tick.views, strict=True):
            assert a.robot_detections is not None
            assert b.robot_detections is not None
            assert a.robot_detections.robot == b.robot_detections.robot
            np.testing.assert_allclose(a.robot_detections.bearing, b.robot_detections.bearing, atol=1e-8)
            np.testing.assert_allclose(a.robot_detections.covariance, b.robot_detections.covariance, rtol=1e-8)
            count += len(a.robot_detections)
    assert count > 3
    assert list(validate(tmp_path / "s")) == []
