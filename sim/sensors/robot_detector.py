"""Simulated detector of rovers in the images of other rovers. It identifies them.

Like the detector of people, it misses a share Scenario.misses, and its bearings have the noise Scenario.bearing_noise.
A rover is visible if it is in the image and nothing is on the line between the two cameras.
"""

from __future__ import annotations

import numpy as np

from sim.sensors.raycast_camera import Raycaster
from sim.simulation.simulation import Simulation
from tracker.geometry import perturbed_bearings
from tracker.geometry.cameras import Panorama
from tracker.types import Mount, RobotDetections, Setup

LEAST_VARIANCE = 1e-8
"""rad²: smallest variance, because the covariance of a detector without noise must be positive."""


def is_rover_panorama(simulation: Simulation, mount: Mount) -> bool:
    """Whether a camera is a panorama on a simulated rover."""
    return mount.robot in simulation.robots and isinstance(mount.camera, Panorama)


class RobotDetector:
    """Detects rovers in the current state of a simulation. The draws of a camera come from its stream "companions/CAMERA"."""

    def __init__(self, simulation: Simulation, setup: Setup) -> None:
        scenario = simulation.scenario
        self._misses, self._noise = scenario.misses, scenario.bearing_noise
        self._simulation, self._raycaster = simulation, Raycaster(simulation)
        self._mounts = {name: mount for name, mount in setup.mounts.items() if mount.robot in simulation.robots}
        self._streams = {name: scenario.stream(f"companions/{name}") for name in self._mounts}

    def detect(self, camera: str) -> RobotDetections | None:
        """The rovers visible from a camera; None for a camera that is not on a rover. The draws of one do not depend on the others."""
        if camera not in self._mounts:
            return None
        mount, rng, simulation = self._mounts[camera], self._streams[camera], self._simulation
        others = list(dict.fromkeys(other.robot for other in self._mounts.values() if other.robot != mount.robot))
        error, found = rng.normal(0.0, self._noise, (len(others), 2)), rng.random(len(others)) >= self._misses
        pose = simulation.T_world_robot(mount.robot) @ mount.T_body_camera
        targets = np.array([(simulation.T_world_robot(robot) @ simulation.mount(robot)).translation for robot in others]).reshape(-1, 3)
        found &= mount.camera.pixels_from_bearings(pose.inverse().apply(targets))[1]
        found[found] = self._raycaster.first_hit(pose.translation, targets[found])[1]
        sight = pose.inverse().apply(targets[found])
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        bearing = perturbed_bearings(sight, error[found])
        covariance = np.tile(np.eye(2) * max(self._noise**2, LEAST_VARIANCE), (len(bearing), 1, 1))
        return RobotDetections(bearing, tuple(np.array(others)[found].tolist()), covariance)
