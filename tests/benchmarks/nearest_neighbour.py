"""A plain nearest-neighbour tracker of people: feet on the ground, constant velocity, one pass over the views, and no memory of appearance.

It stands beside pilsim's own tracker where predictions are compared: `pilsim stress --tracker tests.benchmarks.nearest_neighbour:nearest_neighbour`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, angles_from_bearing, bearing_from_angles
from tracker.types import Estimate, Setup, Tick, View

GATE = 1.0
"""m: greatest distance of feet from the predicted place of a track."""
LEAST_CONFIDENCE = 0.5
CONFIRMED, LOST = 3, 1.0
"""Frames with a box after which a track is reported, and s without one after which it ends."""
GAIN, RATE_GAIN = 0.5, 0.2
"""Gains of place and velocity (alpha-beta filter)."""
FARTHEST = 60.0


@dataclass(eq=False)
class Track:
    """Place (3,) m, velocity (3,) m/s, number of frames with a box, and the time of the last one, s."""

    number: int
    place: Array
    velocity: Array
    hits: int
    seen: float


def nearest_neighbour(
    setup: Setup, ticks: Iterable[Tick], gate: float = GATE, least_confidence: float = LEAST_CONFIDENCE, lost: float = LOST
) -> Iterator[Estimate]:
    """An estimate for each tick, with the assignment of the least sum of distances.

    Cameras stand still: robots that move are not followed. Raises ValueError where a camera's pose is unknown.
    """
    return _followed(setup, ticks, Settings(gate, least_confidence, lost, assigned))


def greedy(
    setup: Setup, ticks: Iterable[Tick], gate: float = GATE, least_confidence: float = LEAST_CONFIDENCE, lost: float = LOST
) -> Iterator[Estimate]:
    """The same with the nearest pair first."""
    return _followed(setup, ticks, Settings(gate, least_confidence, lost, nearest_first))


@dataclass(frozen=True)
class Settings:
    """Gate m, least confidence, time until a track without boxes ends s, and the assignment of boxes to tracks."""

    gate: float
    least_confidence: float
    lost: float
    assign: Callable[[Array, Array, float], list[tuple[int, int]]]


def _followed(setup: Setup, ticks: Iterable[Tick], chosen: Settings) -> Iterator[Estimate]:
    tracks, count = list[Track](), 0
    for tick in ticks:
        for track in tracks:
            track.place = track.place + track.velocity * setup.period
        new = list[list[Array]]()
        found: dict[int, list[Array]] = {track.number: [] for track in tracks}
        for view in tick.views:
            feet = feet_of(setup, view, chosen.least_confidence)
            taken = chosen.assign(np.array([track.place for track in tracks]).reshape(-1, 3), feet, chosen.gate)
            for row, box in taken:
                found[tracks[row].number].append(feet[box])
            for box in sorted(set(range(len(feet))) - {box for _, box in taken}):
                near = [group for group in new if np.linalg.norm(np.mean(group, axis=0) - feet[box]) < chosen.gate]
                if near:
                    near[0].append(feet[box])
                else:
                    new.append([feet[box]])
        for track in tracks:
            if points := found[track.number]:
                error = np.mean(points, axis=0) - track.place
                track.place = track.place + GAIN * error
                track.velocity = track.velocity + RATE_GAIN * error / setup.period
                track.hits, track.seen = track.hits + 1, tick.time
        tracks = [track for track in tracks if tick.time - track.seen <= chosen.lost]
        for group in new:
            count += 1
            tracks.append(Track(count, np.mean(group, axis=0), np.zeros(3), 1, tick.time))
        yield estimate_of(setup, tick.index, [track for track in tracks if track.hits >= CONFIRMED])


def feet_of(setup: Setup, view: View, least_confidence: float = LEAST_CONFIDENCE) -> Array:
    """Where the lower edges of the boxes (n, 3) m of a view meet the ground."""
    mount = setup.mounts[view.camera]
    start = setup.starts[mount.robot]
    if start is None:
        raise ValueError(f"the pose of {mount.robot} is unknown, needs cameras whose poses are known")
    pose, boxes = start.T_world_robot @ mount.T_body_camera, view.detections
    across, up = angles_from_bearing(boxes.bearing)
    rays = bearing_from_angles(across, up - boxes.extent[:, 1] / 2) @ pose.rotation.T
    feet, hit = setup.ground.intersect(np.broadcast_to(pose.translation, rays.shape), rays, FARTHEST)
    return np.asarray(feet[hit & (boxes.confidence >= least_confidence)])


def assigned(places: Array, feet: Array, gate: float = GATE) -> list[tuple[int, int]]:
    """Pairs of rows of places (m, 3) and feet (n, 3) with the least sum of distances, each within the gate."""
    distance = np.linalg.norm(places[:, None] - feet[None], axis=2)
    pairs = zip(*linear_sum_assignment(np.minimum(distance, gate)), strict=True)
    return [(int(row), int(box)) for row, box in pairs if distance[row, box] < gate]


def nearest_first(places: Array, feet: Array, gate: float) -> list[tuple[int, int]]:
    """Pairs of rows within the gate, the nearest first, each row once."""
    distance = np.linalg.norm(places[:, None] - feet[None], axis=2)
    rows, boxes, out = set[int](), set[int](), list[tuple[int, int]]()
    for at in np.argsort(distance, axis=None, kind="stable").tolist():
        row, box = divmod(at, len(feet))
        if distance[row, box] < gate and row not in rows and box not in boxes:
            rows.add(row)
            boxes.add(box)
            out.append((row, box))
    return out


def estimate_of(setup: Setup, index: int, tracks: list[Track]) -> Estimate:
    """Tracks within the area. The covariances have no meaning."""
    places = np.array([track.place for track in tracks]).reshape(-1, 3)
    kept = setup.contains(places)
    number = np.array([track.number for track in tracks], dtype=np.int64)[kept]
    poses = {robot: start.T_world_robot for robot, start in setup.starts.items() if start is not None}
    return Estimate(index, poses, dict.fromkeys(poses, np.zeros((6, 6))), number, places[kept], np.tile(np.eye(3), (len(number), 1, 1)))
