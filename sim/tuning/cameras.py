"""Cameras of synthetic cases: corners of rooms, masts around squares, panoramas on tripods, and rovers."""

from __future__ import annotations

import numpy as np

from sim.tuning.places import Surroundings
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, Panorama, Pinhole
from tracker.recordings import RecordingCamera

WIDTHS = (768, 1280, 1920)
"""px."""
PANORAMAS = (1024, 1280, 2048)
ROVER_HEIGHT = (1.0, 1.5)
"""m: of the panorama on a rover."""


def pinhole_of(rng: np.random.Generator, view: tuple[float, float]) -> Pinhole:
    """A pinhole camera with a horizontal field of view within `view` deg."""
    width = int(rng.choice(WIDTHS))
    height = round(width * (0.75 if rng.random() < 0.4 else 0.5625))
    focal = width / 2 / np.tan(np.radians(rng.uniform(*view)) / 2)
    return Pinhole(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def panorama_of(rng: np.random.Generator) -> Panorama:
    """A panorama of one of the usual widths."""
    width = int(rng.choice(PANORAMAS))
    return Panorama(width, width // 2)


def corner_cameras(size: tuple[float, float], count: int, rng: np.random.Generator) -> list[RecordingCamera]:
    """Cameras in the corners, then on the walls, of a floor from (0, 0) to `size` m, aimed at its middle."""
    length, width = size
    corners = np.array([(0.0, 0.0), (length, width), (length, 0.0), (0.0, width)])
    walls = np.array([(length / 2, 0.0), (length / 2, width), (0.0, width / 2), (length, width / 2)])
    places = np.concatenate([rng.permutation(corners) if count < 4 else corners, walls])[:count]
    high, lens = min(2.0 + 0.06 * (length + width), 4.0), pinhole_of(rng, (72.0, 98.0))
    out = []
    for place in places:
        eye = np.array([*(place + 0.1 * np.sign(np.array(size) / 2 - place)), high + rng.uniform(0.0, 0.6)])
        target = np.array([*(np.array(size) / 2 + rng.normal(0.0, 0.06, 2) * np.array(size)), rng.uniform(0.6, 1.1)])
        out.append(RecordingCamera.looking_at(lens, eye, target))
    return out


def mast_cameras(around: Surroundings, count: int, rng: np.random.Generator) -> list[RecordingCamera]:
    """Cameras on masts around a place, of different lenses, aimed into it."""
    low, high = around.area
    middle, radius = (low + high) / 2, (high - low) / 2
    first, out = rng.uniform(-np.pi, np.pi), []
    for k in range(count):
        angle = first + 2 * np.pi * k / count + rng.normal(0.0, 0.25)
        place = middle + radius * np.array([np.cos(angle), np.sin(angle)]) * rng.uniform(0.9, 1.25)
        place = place if around.occluders is None else _nearest_free(around, place)
        eye = np.array([*place, _ground(around, place) + rng.uniform(2.3, 6.0)])
        aim = middle + rng.normal(0.0, 0.25, 2) * radius
        target = np.array([*aim, _ground(around, aim) + 0.5])
        out.append(RecordingCamera.looking_at(pinhole_of(rng, (40.0, 85.0)), eye, target))
    return out


def standing_panoramas(around: Surroundings, count: int, rng: np.random.Generator) -> list[RecordingCamera]:
    """Panoramas on tripods at spots of a place."""
    spots = around.spots[rng.permutation(len(around.spots))[:count]]
    out = []
    for x, y in spots.tolist():
        high = _ground(around, np.array([x, y])) + float(rng.uniform(1.2, 2.6))
        out.append(RecordingCamera(panorama_of(rng), Pose.planar(x, y, float(rng.uniform(-np.pi, np.pi)), high)))
    return out


def rover_poses(path: Array, around: Surroundings) -> list[Pose]:
    """Level poses of a rover at places (steps, 2) m, that look where it goes; it keeps its heading while it stands."""
    z = around.ground.height_at(path)
    heading, out = 0.0, []
    ahead = np.concatenate([path[4:], np.repeat(path[-1:], 4, axis=0)])[: len(path)]
    for place, then, level in zip(path, ahead, z, strict=True):
        dx, dy = then - place
        if np.hypot(dx, dy) > 0.1:
            turn = np.pi - np.mod(np.pi - np.arctan2(dy, dx) + heading, 2 * np.pi)
            heading += float(np.clip(turn, -0.3, 0.3))
        out.append(Pose.planar(float(place[0]), float(place[1]), heading, float(level)))
    return out


def rover_camera(robot: str, rng: np.random.Generator) -> RecordingCamera:
    """A panorama on a rover."""
    camera: Camera = panorama_of(rng)
    return RecordingCamera(camera, Pose.planar(0.0, 0.0, 0.0, float(rng.uniform(*ROVER_HEIGHT))), robot)


def _ground(around: Surroundings, place: Array) -> float:
    return float(around.ground.height_at(place[None])[0])


def _nearest_free(around: Surroundings, place: Array) -> Array:
    """The nearest place (2,) m with nothing beside it, so that no tree or wall stands before the camera."""
    free = around.free
    points = free.points(free.clearance > min(0.3, 0.5 * float(free.clearance.max())))
    return np.asarray(points[int(np.argmin(np.linalg.norm(points - place, axis=1)))])
