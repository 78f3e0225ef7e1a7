"""Where fixed cameras stand to see the ground of a place: high at the rim of where people walk, looking in.

Candidates are the outermost free places in evenly spaced directions. One after the other is chosen which adds most to what is seen: a place seen
for the first time counts one, for the n-th time 1/n². Nothing is drawn at random, so that a place has the same cameras every time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.recording.tracker_setup import FixedCamera
from tracker.geometry import Array, Pose, rotation_z
from tracker.geometry.cameras import Tsai, pinhole
from worlds.world import World

FIELD = math.radians(75.0)
"""Of view, from the left to the right edge."""
HEIGHTS = (4.5, 3.0, 2.4)
"""m over the ground: the highest of these that has nothing above or around it."""
DIRECTIONS = 36
OVER_THE_AXIS = math.radians(16.0)
"""How far above the middle of the picture the farthest people are: little of it is sky."""
CHEST = 1.2
"""m over the ground: what of people is to be seen."""
NEAREST, FARTHEST = 1.5, 35.0
"""m: people who are nearer fill the picture, who are farther are specks."""
SAMPLES = 300
APART = 0.4
"""Of the extent of the place: cameras that are nearer to each other than this count less."""
_MARGIN, _HEADROOM = 0.9, 0.3


@dataclass(frozen=True, eq=False)
class _Place:
    """A compiled world, to cast rays in; chests (n, 3) m, spread evenly over where people walk."""

    model: mujoco.MjModel
    data: mujoco.MjData
    chests: Array

    @staticmethod
    def of(world: World) -> _Place:
        model = world.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        i, j = np.nonzero(world.feet.free)
        chosen = np.unique(np.linspace(0, len(i) - 1, SAMPLES).round().astype(np.int64))
        # Along a curve that fills the grid in strips, so that equal steps are spread over it evenly.
        strips = np.lexsort((np.where((i // 8) % 2 == 0, j, -j), i // 8))
        points = world.feet.origin + world.feet.spacing * np.stack([j, i], axis=1)[strips][chosen]
        return _Place(model, data, np.column_stack([points, world.terrain.height_at(points) + CHEST]))

    def hit(self, start: Array, direction: Array) -> float:
        """m to what a ray meets first, inf where there is nothing."""
        distance = mujoco.mj_ray(self.model, self.data, start, direction, None, 1, -1, np.zeros(1, np.int32), None)
        return float(distance) if distance >= 0 else math.inf

    def clear(self, start: Array, end: Array) -> bool:
        """Whether nothing is between two points (3,) m."""
        way = end - start
        length = float(np.linalg.norm(way))
        return self.hit(start, way / length) > length


def place_cameras(world: World, count: int, width: int) -> dict[str, FixedCamera]:
    """Name → camera, for `count` cameras; pictures are `width` px wide and three quarters as high.

    Raises ValueError where there are fewer places from which people can be seen.
    """
    if not count:
        return {}
    place, camera = _Place.of(world), pinhole(width, round(width * 0.75), FIELD)
    seats = [seat for seat in (_seat(world, place, k) for k in range(DIRECTIONS)) if seat is not None]
    poses = [pose for seat in seats if (pose := _aimed(place, seat)) is not None]
    shown = np.array([_shown(place, camera, pose) for pose in poses]).reshape(len(poses), len(place.chests))
    at = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    apart = APART * max(float(np.ptp(at, axis=0).max(initial=0.0)), 1e-9) if len(at) else 1.0
    chosen: list[int] = []
    times = np.zeros(len(place.chests))
    while len(chosen) < count:
        gain = (shown / (1.0 + times) ** 2).sum(axis=1)
        for k in chosen:
            gain *= np.clip(np.linalg.norm(at - at[k], axis=1) / apart, 0.0, 1.0)
        if not gain.any():
            raise ValueError(f"views is {count}, more than the {len(chosen)} places from which {world.name} can be overlooked")
        chosen.append(int(np.argmax(gain)))
        times += shown[chosen[-1]]
    return {f"View_{n:03d}": FixedCamera(camera, poses[k]) for n, k in enumerate(sorted(chosen), 1)}


def _seat(world: World, place: _Place, k: int) -> Array | None:
    """(3,) m: where a camera can hang at the rim in the k-th direction, or None."""
    angle = 2 * np.pi * (k + 0.5) / DIRECTIONS
    i, j = np.nonzero(world.feet.clearance >= min(_MARGIN - 0.5, float(world.feet.clearance.max())))
    points = world.feet.origin + world.feet.spacing * np.stack([j, i], axis=1)
    ahead = (points - points.mean(axis=0)) @ rotation_z(angle)[:2, :2]
    at = points[int(np.argmax(ahead[:, 0] - np.abs(ahead[:, 1])))]
    ground = float(world.terrain.height_at(at[None])[0])
    room = place.hit(np.array([*at, ground + 0.1]), np.array([0.0, 0.0, 1.0])) + 0.1 - _HEADROOM
    return next((np.array([*at, ground + height]) for height in HEIGHTS if height <= room), None)


def _aimed(place: _Place, seat: Array) -> Pose | None:
    """The camera at a seat that looks to where most people can be seen, or None where it sees nobody."""
    way = place.chests - seat
    distance = np.linalg.norm(way, axis=1)
    near = np.flatnonzero((distance > NEAREST) & (distance < FARTHEST))
    seen = way[[k for k in near if place.clear(seat, place.chests[k])]]
    if not len(seen):
        return None
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    yaws = 2 * np.pi * np.arange(72) / 72
    inside = np.abs(np.mod(azimuth - yaws[:, None] + np.pi, 2 * np.pi) - np.pi) < FIELD / 2
    best = int(np.argmax(inside.sum(axis=1)))
    yaw, ahead = float(yaws[best]), seen[inside[best]]
    below = np.arctan2(-ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))
    down = float(np.quantile(below, 0.05)) + OVER_THE_AXIS
    pitch = Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, down, 0.0]))
    return Pose(rotation_z(yaw), seat) @ pitch


def _shown(place: _Place, camera: Tsai, pose: Pose) -> Array:
    """(n,) 1.0 where a chest is in the picture and nothing is before it."""
    way = place.chests - pose.translation
    distance = np.linalg.norm(way, axis=1)
    _, inside = camera.pixels_from_bearings(pose.inverse().apply(place.chests))
    out = np.zeros(len(way))
    for k in np.flatnonzero(inside & (distance > NEAREST) & (distance < FARTHEST)):
        out[k] = place.clear(pose.translation, place.chests[k])
    return out
