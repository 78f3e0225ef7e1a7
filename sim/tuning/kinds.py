"""Kinds of synthetic cases: place, people and cameras of each. Cameras are in corners of rooms, on masts, on tripods, and on rovers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.tuning.walks import OUTDOOR_WORLDS, WARM_UP, Habits, Surroundings, floor, furniture, outdoor
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, Panorama, Pinhole
from tracker.recordings import RecordingCamera

WIDTHS = (768, 1280, 1920)
"""px: widths of the images of pinhole cameras."""
PANORAMAS = (1024, 1280, 2048)
ROVER_HEIGHT = (1.0, 1.5)
"""m: of the panorama on a rover."""
BLOCK = ("lab", "lab", "lab", "lab", "lab", "office", "office", "office", "hall", "hall", "hall", "square", "square", "square", "square",
         "outdoor", "outdoor", "outdoor", "rovers", "rovers")  # fmt: skip
"""Kinds of 20 consecutive cases, in random order. Eight are small rooms, full of people or furnished."""
MOST_WORK, MOST_FRAMES, LEAST_FRAMES = 2200, 120, 30
"""Largest product of frames, people and cameras of a case, so that tracking takes seconds; bounds of the number of frames."""
CROSSED = 0.85
"""Length of the way of a person who crosses a place, as a share of its diagonal."""


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
    """Level poses of a rover at positions (steps, 2) m. The heading follows the motion, and is kept while the rover stands."""
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
    """The nearest place (2,) m with free space around it, so that no tree or wall blocks the view of the camera."""
    free = around.free
    points = free.points(free.clearance > min(0.3, 0.5 * float(free.clearance.max())))
    return np.asarray(points[int(np.argmin(np.linalg.norm(points - place, axis=1)))])


@dataclass(frozen=True, eq=False)
class CaseScene:
    """A case before walks are simulated: place, numbers of people at once and in all, habits, fixed cameras, number of rovers, frames/s."""

    around: Surroundings
    at_once: int
    people: int
    habits: Habits
    cameras: list[RecordingCamera]
    rovers: int
    rate: float
    most_frames: int = MOST_FRAMES

    @property
    def frames(self) -> int:
        """Number of frames, small enough that tracking takes seconds."""
        seen = self.at_once * (len(self.cameras) + self.rovers)
        return int(np.clip(round(MOST_WORK / seen), min(LEAST_FRAMES, self.most_frames), self.most_frames))

    def with_crossers(self, rng: np.random.Generator) -> CaseScene:
        """In half of the scenes, some or all people cross the place steadily, as pedestrians in a street do. As many come as leave."""
        if rng.random() < 0.5:
            return self
        share, diagonal = float(rng.uniform(0.3, 1.0)), float(np.linalg.norm(self.around.area[1] - self.around.area[0]))
        seconds = CROSSED * diagonal / self.habits.speed
        people = self.at_once + round(share * self.at_once * (WARM_UP + self.frames / self.rate) / seconds)
        return replace(self, people=people, habits=replace(self.habits, crossing=share))


def scene(kind: str, rng: np.random.Generator) -> CaseScene:
    """A scene of a kind of BLOCK."""
    return SCENES[kind](rng)


def _from_origin(size: tuple[float, float]) -> Array:
    """The area (2, 2) m from (0, 0) to `size`."""
    return np.array([(0.0, 0.0), size])


def _turnover(people: int, rng: np.random.Generator, most: float) -> int:
    """Number of people in all, where some come and go."""
    return people + (int(rng.integers(0, max(1, round(most * people)) + 1)) if rng.random() < 0.6 else 0)


def _lab(rng: np.random.Generator) -> CaseScene:
    """A small room full of people who stand close together or walk, with cameras in its corners."""
    size = float(rng.uniform(5.0, 10.0)), float(rng.uniform(3.0, 6.0))
    people = int(rng.integers(8, 17)) if rng.random() < 0.75 else int(rng.integers(2, 8))
    people = min(people, round(size[0] * size[1] / 1.5))
    around = floor(_from_origin(size), furniture(size, 0.03, rng), int(rng.integers(1, 3)), rng)
    habits = Habits(rng.uniform(0.3, 0.8), 0.0, rng.uniform(0.0, 0.1), rng.uniform(3.0, 15.0), rng.uniform(0.6, 1.1), (0.35, 0.8))
    seen = corner_cameras(size, 4 if rng.random() < 0.75 else int(rng.integers(2, 7)), rng)
    return CaseScene(around, people, _turnover(people, rng, 0.3), habits, seen, 0, float(rng.choice([4.0, 5.0, 7.0])))


def _office(rng: np.random.Generator) -> CaseScene:
    """A room with tables and shelves, where some sit."""
    size = float(rng.uniform(5.0, 14.0)), float(rng.uniform(4.0, 9.0))
    people = int(rng.integers(2, 13))
    around = floor(_from_origin(size), furniture(size, rng.uniform(0.05, 0.14), rng), int(rng.integers(1, 3)), rng)
    sitting = rng.uniform(0.1, 0.5) if rng.random() < 0.6 else 0.0
    habits = Habits(rng.uniform(0.1, 0.4), sitting, rng.uniform(0.0, 0.15), rng.uniform(4.0, 20.0), rng.uniform(0.7, 1.2), (0.4, 1.0))
    seen = corner_cameras(size, int(rng.integers(2, 6)), rng)
    if rng.random() < 0.3:
        seen = seen[:2] + standing_panoramas(around, int(rng.integers(1, 3)), rng)
    return CaseScene(around, people, _turnover(people, rng, 0.6), habits, seen, 0, float(rng.choice([4.0, 5.0, 7.0, 10.0])))


def _hall(rng: np.random.Generator) -> CaseScene:
    """A large hall with columns and many cameras."""
    size = float(rng.uniform(12.0, 30.0)), float(rng.uniform(8.0, 20.0))
    people = int(rng.integers(6, 41))
    around = floor(_from_origin(size), furniture(size, 0.015, rng), int(rng.integers(2, 5)), rng)
    habits = Habits(rng.uniform(0.1, 0.6), 0.0, rng.uniform(0.0, 0.1), rng.uniform(4.0, 15.0), rng.uniform(0.9, 1.4), (0.4, 1.0))
    seen = corner_cameras(size, int(rng.integers(3, 9)), rng)
    return CaseScene(around, people, _turnover(people, rng, 0.6), habits, seen, 0, float(rng.choice([2.0, 4.0, 7.0, 10.0]))).with_crossers(rng)


def _square(rng: np.random.Generator) -> CaseScene:
    """An outdoor square with cameras on masts: few people as in PETS 2009, or as many as in WILDTRACK."""
    size = float(rng.uniform(14.0, 36.0)), float(rng.uniform(10.0, 26.0))
    people = int(rng.integers(1, 13)) if rng.random() < 0.5 else int(rng.integers(13, 61))
    around = floor(_from_origin(size), furniture(size, 0.003, rng), int(rng.integers(3, 8)), rng)
    habits = Habits(rng.uniform(0.0, 0.5), 0.0, 0.0, rng.uniform(4.0, 20.0), rng.uniform(1.0, 1.5), (0.4, 1.0))
    seen = mast_cameras(around, int(rng.integers(2, 9 if people > 4 else 5)), rng)
    return CaseScene(around, people, _turnover(people, rng, 1.0), habits, seen, 0, float(rng.choice([2.0, 7.0, 10.0]))).with_crossers(rng)


def _outdoor(rng: np.random.Generator) -> CaseScene:
    """A world with relief and occluders, with fixed cameras and rovers."""
    around = outdoor(str(rng.choice(OUTDOOR_WORLDS)), float(rng.uniform(0.2, 0.8)), rng)
    people, rovers = int(rng.integers(3, 41)), int(rng.integers(0, 5))
    habits = Habits(rng.uniform(0.0, 0.5), 0.0, 0.0, rng.uniform(3.0, 12.0), rng.uniform(0.9, 1.3), (0.4, 1.2))
    fixed = int(rng.integers(max(0, 3 - rovers), 5)) if rovers < 4 else int(rng.integers(0, 3))
    return CaseScene(around, people, _turnover(people, rng, 0.5), habits, mast_cameras(around, fixed, rng), rovers, 6.0).with_crossers(rng)


def _rovers(rng: np.random.Generator) -> CaseScene:
    """Rovers and panoramas in a room, a hall or a square."""
    size = (float(rng.uniform(6.0, 24.0)), float(rng.uniform(4.0, 18.0)))
    people = int(np.clip(rng.integers(2, 31), 1, size[0] * size[1] / 3))
    around = floor(_from_origin(size), furniture(size, rng.uniform(0.0, 0.05), rng), int(rng.integers(1, 5)), rng)
    habits = Habits(rng.uniform(0.1, 0.6), 0.0, rng.uniform(0.0, 0.1), rng.uniform(3.0, 12.0), rng.uniform(0.8, 1.3), (0.4, 1.0))
    rovers = int(rng.integers(2, 5))
    seen = standing_panoramas(around, int(rng.integers(0, 3)), rng)
    return CaseScene(around, people, _turnover(people, rng, 0.5), habits, seen, rovers, float(rng.choice([4.0, 6.0])))


SCENES: dict[str, Callable[[np.random.Generator], CaseScene]] = {
    "lab": _lab,
    "office": _office,
    "hall": _hall,
    "square": _square,
    "outdoor": _outdoor,
    "rovers": _rovers,
}
