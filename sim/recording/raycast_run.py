"""A scenario run without rendering: cameras see by rays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from sim.recording.record import robot_poses, visible_fractions
from sim.scenario import Scenario
from sim.sensors.person_detector import Detector, People
from sim.sensors.raycast_camera import RaycastCamera
from sim.sensors.robot_detector import RobotDetector, is_rover_panorama
from sim.simulation.simulation import Simulation
from tracker.geometry import Pose
from tracker.types import Setup, Tick, Truth, View, ViewTruth


@dataclass(frozen=True, eq=False)
class RaycastFrame:
    """One frame, as record.Moment has it, without pictures: the tick that the tracker gets, the truth, and by camera what is true of the view."""

    tick: Tick
    truth: Truth
    views: dict[str, ViewTruth]


def run_raycast(scenario: Scenario, simulation: Simulation, setup: Setup, raycast_camera: RaycastCamera | None = None) -> Iterator[RaycastFrame]:
    """As record.run, of rays instead of pictures: detections, sightings of landmarks for rovers, companions, odometry, truth; no images, no
    instances.
    """
    raycast_camera = raycast_camera or RaycastCamera(simulation)
    robot_detector = RobotDetector(scenario, setup, simulation, raycast_camera.raycaster)
    detector, streams = Detector.of(scenario), {name: scenario.stream(f"detector/{name}") for name in setup.mounts}
    landmark_streams = {name: scenario.stream(f"sightings/{name}") for name in setup.mounts}
    for index in range(scenario.frames):
        if index:
            simulation.step()
        odometry = simulation.odometry() if index else {}
        robots = robot_poses(simulation, setup)
        people = People(np.asarray(simulation.persons, dtype=np.int64), simulation.joints())
        views, true = [], {}
        for name, mount in setup.mounts.items():
            pose = robots[mount.robot] @ mount.T_body_camera
            true[name] = raycast_camera.view(mount.camera, pose, people)
            found = detector.detect(mount.camera, true[name], streams[name])
            seen = raycast_camera.sightings(pose, landmark_streams[name]) if is_rover_panorama(simulation, mount) else None
            views.append(View(name, found, seen, odometry.get(mount.robot), robot_detections=robot_detector.detect(name)))
        yield RaycastFrame(Tick(index, index * scenario.period, tuple(views)), _truth(simulation, index, robots, people, true), true)


def _truth(simulation: Simulation, index: int, robots: dict[str, Pose], people: People, true: Mapping[str, ViewTruth]) -> Truth:
    tipped = frozenset(robot for robot, over in simulation.tipped().items() if over)
    return Truth(index, robots, people.person, simulation.feet(), visible_fractions(people.person, true), people.joints, tipped)
