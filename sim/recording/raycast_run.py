"""A scenario run without rendering: the views of all cameras by ray casting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from sim.recording.frame_loop import simulated_frames, truth_of
from sim.scenario import Scenario
from sim.sensors.raycast_camera import RaycastCamera
from sim.sensors.robot_detector import RobotDetector, is_rover_panorama
from sim.sensors.view_detectors import ViewDetectors
from sim.simulation.simulation import Simulation
from tracker.types import SensorSamples, Setup, Tick, Truth, View, ViewTruth


@dataclass(frozen=True, eq=False)
class RaycastFrame:
    """One frame without images: the tick for the tracker, the truth, and the truth of the view by camera.

    samples: of the robots' own sensors since the frame before.
    """

    tick: Tick
    truth: Truth
    views: dict[str, ViewTruth]
    samples: SensorSamples = field(default_factory=SensorSamples)


def run_raycast(scenario: Scenario, simulation: Simulation, setup: Setup, raycast_camera: RaycastCamera | None = None) -> Iterator[RaycastFrame]:
    """The frames of a scenario, by ray casting: detections of people and robots, sightings of landmarks for rovers, odometry and truth."""
    raycast_camera = raycast_camera or RaycastCamera(simulation)
    robot_detector = RobotDetector(scenario, setup, simulation, raycast_camera.raycaster)
    detectors = ViewDetectors(scenario, setup.mounts, simulation.all_persons)
    landmark_streams = {name: scenario.stream(f"sightings/{name}") for name in setup.mounts}
    for state in simulated_frames(scenario, simulation, setup):
        views, true, feet = [], {}, simulation.feet()
        for name, mount in setup.mounts.items():
            pose = state.robots[mount.robot] @ mount.T_body_camera
            true[name] = raycast_camera.view(mount.camera, pose, state.people)
            found = detectors.detect(name, true[name], state.people.person, feet)
            seen = raycast_camera.sightings(pose, landmark_streams[name]) if is_rover_panorama(simulation, mount) else None
            views.append(View(name, found, seen, state.odometry.get(mount.robot), robot_detections=robot_detector.detect(name)))
        yield RaycastFrame(Tick(state.index, state.index * scenario.period, tuple(views)), truth_of(state, simulation, true), true, state.samples)
