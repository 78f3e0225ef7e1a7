"""Random cameras that look at people: panoramas at the height of rovers, and pinhole cameras at eye level and on masts.

Distances follow from the desired height of a body in the image. All draws come from a generator of the caller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Pose, rotation_z
from tracker.geometry.cameras import Camera, Panorama, pinhole
from worlds.engine import mujoco

PANORAMA_SIZE, PINHOLE_SIZE = (1024, 512), (768, 576)
"""Width and height of the images, px."""
FIELDS = (math.radians(20.0), math.radians(85.0))
"""Horizontal fields of view of pinhole cameras, rad, log-uniform."""
BODY = 1.7
"""m: the height of a body by which distances are chosen."""
FARTHEST = 70.0
"""m: the largest distance of the chosen body from a pinhole camera."""
ATTEMPTS = 40


@dataclass(frozen=True)
class CameraBounds:
    """Where cameras are. body: height of the chosen body in a pinhole image, px, log-uniform. nearest: its least distance, m.

    panorama: distance of the chosen body from a panorama, m, log-uniform. rovers, eye_level, masts: heights above the ground, m, of panoramas
    and of pinhole cameras. masted: share of pinhole cameras on masts. clear: free space around a camera, m.
    hidden: distance of the first hit from the chosen body that still counts as seen, m. between: share of panoramas between two people.
    """

    body: tuple[float, float] = (24.0, 430.0)
    nearest: float = 1.5
    panorama: tuple[float, float] = (1.2, 14.0)
    rovers: tuple[float, float] = (0.5, 2.5)
    eye_level: tuple[float, float] = (0.4, 2.3)
    masts: tuple[float, float] = (2.3, 9.0)
    masted: float = 0.6
    clear: float = 0.35
    hidden: float = 0.7
    between: float = 0.0


OUTDOORS = CameraBounds()
INDOORS = CameraBounds((80.0, 800.0), 0.6, (0.5, 5.0), (0.85, 1.5), (0.8, 1.8), (1.8, 2.9), 0.4, 0.15, between=0.7)
"""On tables, on tripods and in corners of rooms."""


@dataclass(frozen=True, eq=False)
class CameraSampler:
    """Draws poses of cameras in the current state of a simulation."""

    simulation: Simulation
    rng: np.random.Generator
    bounds: CameraBounds = OUTDOORS

    def pose(self, camera: Camera) -> Pose | None:
        """A pose T_world_camera from which a person is seen, or None where none was found in ATTEMPTS draws or nobody is there."""
        feet = self.simulation.feet()
        if not len(feet):
            return None
        draw = self._beside if isinstance(camera, Panorama) else self._towards
        for _ in range(ATTEMPTS):
            pose = draw(camera, feet[self.rng.integers(len(feet))])
            if pose is not None:
                return pose
        return None

    def _beside(self, _: Camera, feet: Array) -> Pose | None:
        """The pose of a panorama near a person, tilted as a rover on uneven ground is."""
        rng = self.rng
        distance, azimuth = _log_uniform(rng, self.bounds.panorama), rng.uniform(-np.pi, np.pi)
        place = feet[:2] + distance * np.array([np.cos(azimuth), np.sin(azimuth)])
        if self.bounds.between and rng.random() < self.bounds.between:
            other = self.simulation.feet()[rng.integers(len(self.simulation.feet())), :2]
            place = feet[:2] + rng.uniform(0.3, 0.7) * (other - feet[:2]) + rng.normal(0.0, 0.2, 2)
        at = self._above(place, rng.uniform(*self.bounds.rovers))
        yaw, tilt = rng.uniform(-np.pi, np.pi), rng.normal(0.0, math.radians(3.0), 2)
        if not self._sees(at, feet):
            return None
        return Pose(rotation_z(yaw), at) @ Pose.exp(np.array([0.0, 0.0, 0.0, *tilt, 0.0]))

    def _towards(self, camera: Camera, feet: Array) -> Pose | None:
        """The pose of a pinhole camera that has the person somewhere in its image."""
        rng, bounds = self.rng, self.bounds
        bearings = camera.bearings_from_pixels(np.array([[0.0, camera.height / 2], [camera.width - 1.0, camera.height / 2]]))
        field = float(np.arccos(np.clip(bearings[0] @ bearings[1], -1, 1)))
        focal = camera.width / 2 / math.tan(field / 2)
        distance = float(np.clip(focal * BODY / _log_uniform(rng, bounds.body), bounds.nearest, FARTHEST))
        height = rng.uniform(*(bounds.masts if rng.random() < bounds.masted else bounds.eye_level))
        height = min(height, max(0.4, 0.75 * distance))
        azimuth, across = rng.uniform(-np.pi, np.pi), math.sqrt(distance**2 - min(height, 0.9 * distance) ** 2)
        at = self._above(feet[:2] + across * np.array([np.cos(azimuth), np.sin(azimuth)]), height)
        if not self._sees(at, feet):
            return None
        offset = feet + np.array([0.0, 0.0, BODY / 2]) - at
        yaw = math.atan2(offset[1], offset[0]) + rng.uniform(-0.4, 0.4) * field
        down = math.atan2(-offset[2], math.hypot(offset[0], offset[1])) + rng.uniform(-0.25, 0.25) * field * camera.height / camera.width
        turn = Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, down, 0.0])) @ Pose.exp(np.array([0.0, 0.0, 0.0, rng.normal(0.0, math.radians(1.5)), 0.0, 0.0]))
        return Pose(rotation_z(yaw), at) @ turn

    def _above(self, place: Array, height: float) -> Array:
        """The point (3,) m at a height above the ground at a place (2,) m."""
        return np.array([*place, float(self.simulation.world.terrain.height_at(place[None])[0]) + height])

    def _sees(self, at: Array, feet: Array) -> bool:
        """Whether a camera at `at` is over the ground, in free space, and sees the chest of the person at `feet`.

        A hit less than `hidden` m before the chest counts as the person.
        """
        ground = self.simulation.world.ground
        size = ground.spacing * (np.array(ground.heights.shape[::-1]) - 1)
        if ((at[:2] < ground.origin) | (at[:2] > ground.origin + size)).any():
            return False
        around = [np.array([math.cos(a), math.sin(a), 0.0]) for a in 2 * np.pi * np.arange(6) / 6] + [np.array([0.0, 0.0, s]) for s in (-1.0, 1.0)]
        if min(self._hit(at, direction) for direction in around) < self.bounds.clear:
            return False
        offset = feet + np.array([0.0, 0.0, 1.2]) - at
        length = float(np.linalg.norm(offset))
        return self._hit(at, offset / length) > length - self.bounds.hidden

    def _hit(self, start: Array, direction: Array) -> float:
        """Distance to the first hit of a ray, m; inf without a hit."""
        model, data = self.simulation.model, self.simulation.data
        groups = np.array([1, 1, 1, 1, 0, 0], dtype=np.uint8)
        distance = mujoco.mj_ray(model, data, start, direction, groups, 1, -1, np.zeros(1, np.int32), None)
        return float(distance) if distance >= 0 else math.inf


def draw_cameras(rng: np.random.Generator, pinholes: int) -> list[Camera]:
    """A panorama and pinhole cameras with random fields of view."""
    return [Panorama(*PANORAMA_SIZE), *(pinhole(*PINHOLE_SIZE, _log_uniform(rng, FIELDS)) for _ in range(pinholes))]


def _log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))
