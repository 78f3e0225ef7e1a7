"""The frame loop that rendered and ray-cast runs share: steps of the simulation, and the truth of each frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from sim.scenario import Scenario
from sim.sensors.person_detector import People
from sim.sensors.robot_sensors import RobotSensors
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Ints, Pose
from tracker.types import Odometry, SensorSamples, Setup, Truth, ViewTruth


@dataclass(frozen=True, eq=False)
class FrameState:
    """State of one frame: index, odometry by robot (empty at frame 0), T_world_robot by robot, and the people who are present.

    samples: of the robots' own sensors since the frame before.
    """

    index: int
    odometry: dict[str, Odometry]
    robots: dict[str, Pose]
    people: People
    samples: SensorSamples = field(default_factory=SensorSamples)


def simulated_frames(scenario: Scenario, simulation: Simulation, setup: Setup, sensors: RobotSensors | None = None) -> Iterator[FrameState]:
    """Advance a simulation frame by frame, from its current state as frame 0, and yield the state of every frame.

    sensors: those of the scenario where they are made already.
    """
    sensors = sensors or RobotSensors.of(scenario, simulation, setup)
    for index in range(scenario.frames):
        if index:
            simulation.step()
        odometry = simulation.odometry() if index else {}
        people = People(np.asarray(simulation.persons, dtype=np.int64), simulation.joints())
        samples = sensors.sample(index) if sensors else SensorSamples()
        yield FrameState(index, odometry, robot_poses(simulation, setup), people, samples)


def truth_of(state: FrameState, simulation: Simulation, views: Mapping[str, ViewTruth]) -> Truth:
    """Truth of the current frame of a simulation. views: camera → truth of its view."""
    tipped = frozenset(robot for robot, over in simulation.tipped().items() if over)
    people = state.people
    sitting = None if simulation.sitting is None else frozenset(simulation.sitting.tolist())
    visible = visible_fractions(people.person, views)
    return Truth(state.index, state.robots, people.person, simulation.feet(), visible, people.joints, tipped, sitting)


def robot_poses(simulation: Simulation, setup: Setup) -> dict[str, Pose]:
    """T_world_robot of all robots of a setup. Fixed cameras, which the simulation does not know, stay at their start."""
    out = {}
    for robot, start in setup.starts.items():
        if robot in simulation.robots:
            out[robot] = simulation.T_world_robot(robot)
        else:
            assert start is not None
            out[robot] = start.T_world_robot
    return out


def visible_fractions(persons: Ints, views: Mapping[str, ViewTruth]) -> Array:
    """Visible fraction (m, cameras) of every person; 0 for people outside of a camera's image."""
    out = np.zeros((len(persons), len(views)))
    row = {person: k for k, person in enumerate(persons.tolist())}
    for c, view in enumerate(views.values()):
        for person, visible in zip(view.boxes.person.tolist(), view.boxes.visible, strict=True):
            out[row[person], c] = visible
    return out
