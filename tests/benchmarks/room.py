"""A crowded room as a recording, made by geometry alone: people among random goals and in groups, and four cameras in the corners.

It is like the rooms of CMC: 7.7 x 3.4 m, 15 people, 4 frames/s, and bodies that hide one another. Everybody counts, also who is hidden from all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole
from tracker.geometry.image_boxes import body_boxes
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.degradation import BoxNoise, noisy_boxes

SIZE = (7.7, 3.4)
"""m: the floor from (0, 0)."""
RATE = 4.0
"""Frames per second."""
CAMERA_HEIGHT, TARGET_HEIGHT = 2.5, 1.0
"""m: height of the cameras, and of the place over the middle of the floor at which they look."""
RADIUS, STATURES = 0.25, (1.5, 1.9)
"""m: radius of a body, and the lowest and highest stature."""
SPACING = 0.4
"""m: least distance of two people; in a crowd, bodies that turn their shoulders come nearer than their width."""
SPEEDS, PAUSES, NEAR = (0.4, 1.2), (1.0, 8.0), (0.45, 0.7)
"""Preferred speeds, m/s; times of standing at a goal, s; distances of who joins a group, m."""
JOINING = 0.4
"""Probability that the next goal is a place beside somebody who stands."""
TIME_CONSTANT, REPULSION, REACH = 0.5, 2.0, 0.25
"""The social force: s until the preferred velocity is reached; m/s² where bodies touch; m over which it falls by e (Helbing & Molnár 1995)."""
ARRIVAL, GIVING_UP, STANDING = 0.3, 0.1, 0.1
"""m from a goal at which somebody stops; goals given up, a second; share of the push of others on who stands."""
ROUNDS = 50
"""Most rounds in which people are moved apart."""
STEPS = 5
"""Steps of the motion in a frame."""
MOST_HIDDEN = 0.7
"""A box of which nearer bodies hide more has no detection."""
NOISE = BoxNoise(misses=0.1, edges=0.02)
FALSE_BOXES = 0.05
"""Mean number of false boxes a view and frame."""
SURE, HIDING, SPREAD, FALSE = 0.9, 0.15, 0.04, (0.3, 0.8)
"""Confidence: mean of a box in full view, its loss where all is hidden, standard deviation; range of false boxes."""


def room(seed: int, people: int = 15, frames: int = 260) -> Recording:
    """The recording with truth and detections; the same seed gives the same bytes."""
    streams = [np.random.default_rng([seed, k]) for k in range(4)]
    feet, stature = paths(people, frames, streams[0]), streams[1].uniform(*STATURES, people)
    seen = {name: true_boxes(camera, feet, stature, streams[2]) for name, camera in cameras().items()}
    ids, level = np.arange(1, people + 1), np.zeros((people, 1))
    truth = {k: (ids, np.column_stack([feet[k], level])) for k in range(frames)}
    area = np.array([[0.0, 0.0], SIZE])
    recording = Recording(RATE, cameras(), seen, truth, frames, area, source={"source": "room", "seed": seed})
    return with_false_boxes(noisy_boxes(recording, NOISE, seed), streams[3])


def cameras() -> dict[str, RecordingCamera]:
    """Four pinhole cameras with a horizontal field of view of 90°, in the corners, which look to the middle."""
    lens = Pinhole(1920, 1080, 960.0, 960.0, 959.5, 539.5)
    corners = [(x, y, CAMERA_HEIGHT) for x, y in ((0.0, 0.0), (SIZE[0], 0.0), SIZE, (0.0, SIZE[1]))]
    return {f"C{k}": RecordingCamera.looking_at(lens, corner, (SIZE[0] / 2, SIZE[1] / 2, TARGET_HEIGHT)) for k, corner in enumerate(corners, 1)}


@dataclass(eq=False)
class Crowd:
    """The state of n people: place, velocity and goal (n, 2) m and m/s, preferred speed (n,) m/s, and time left to stand (n,) s, 0 for who walks."""

    place: Array
    velocity: Array
    goal: Array
    speed: Array
    pause: Array

    @staticmethod
    def of(people: int, rng: np.random.Generator) -> Crowd:
        """People at random places, each on the way to a random goal."""
        place, goal = (rng.uniform(RADIUS, np.array(SIZE) - RADIUS, (people, 2)) for _ in range(2))
        return Crowd(apart(place), np.zeros((people, 2)), goal, rng.uniform(*SPEEDS, people), np.zeros(people))

    def step(self, dt: float, rng: np.random.Generator) -> None:
        """One step of the social force, dt s, and new goals of those who have stood long enough."""
        stood, self.pause = self.pause > 0, np.maximum(self.pause - dt, 0.0)
        # Goals that cannot be reached are given up.
        for k in np.flatnonzero(np.where(stood, self.pause == 0, rng.random(len(stood)) < GIVING_UP * dt)).tolist():
            self.goal[k] = self.next_goal(k, rng)
        away = self.goal - self.place
        distance = np.linalg.norm(away, axis=1)
        arrived = (self.pause == 0) & (distance < ARRIVAL)
        self.pause[arrived] = rng.uniform(*PAUSES, int(arrived.sum()))
        stands = self.pause > 0
        wanted = np.where(stands[:, None], 0.0, away / np.maximum(distance, 1e-9)[:, None] * self.speed[:, None])
        between, gap = separation(self.place)
        push = (REPULSION * np.exp((2 * RADIUS - gap) / REACH) / gap)[:, :, None] * between
        # Who stands in a group is not pushed out of it.
        push = np.where(stands, STANDING, 1.0)[:, None] * push.sum(axis=1)
        velocity = self.velocity + dt * ((wanted - self.velocity) / TIME_CONSTANT + push)
        before, self.place = self.place, apart(self.place + dt * velocity)
        self.velocity = (self.place - before) / dt

    def next_goal(self, k: int, rng: np.random.Generator) -> Array:
        """A random place, or one beside somebody who stands."""
        standing = np.flatnonzero((self.pause > 0) & (np.arange(len(self.pause)) != k))
        if not len(standing) or rng.random() >= JOINING:
            return rng.uniform(RADIUS, np.array(SIZE) - RADIUS)
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(*NEAR)
        return inside(self.place[rng.choice(standing)] + away * np.array([np.cos(angle), np.sin(angle)]))


def paths(people: int, frames: int, rng: np.random.Generator) -> Array:
    """Paths (frames, people, 2) m. They begin after 10 s, when some people stand already."""
    crowd, out = Crowd.of(people, rng), []
    for frame in range(frames + round(10 * RATE)):
        for _ in range(STEPS):
            crowd.step(1 / RATE / STEPS, rng)
        if frame >= round(10 * RATE):
            out.append(crowd.place)
    return np.array(out)


def inside(place: Array) -> Array:
    """The nearest places (..., 2) m of bodies within the walls."""
    return np.clip(place, RADIUS, np.array(SIZE) - RADIUS)


def separation(place: Array) -> tuple[Array, Array]:
    """Vectors (n, n, 2) from the second to the first of any two places (n, 2), and their lengths (n, n) m, infinite for a place and itself."""
    between = place[:, None] - place
    return between, np.maximum(np.linalg.norm(between, axis=2), 1e-6) + np.diag(np.full(len(place), np.inf))


def apart(place: Array) -> Array:
    """Places (n, 2) m within the walls, moved until any two are SPACING apart, or until ROUNDS are over."""
    place = inside(place)
    for _ in range(ROUNDS):
        between, gap = separation(place)
        if gap.min(initial=np.inf) >= SPACING:
            break
        short = np.maximum(SPACING + 1e-3 - gap, 0.0) / gap
        place = inside(place + 0.5 * (short[:, :, None] * between).sum(axis=1))
    return place


def true_boxes(camera: RecordingCamera, feet: Array, stature: Array, rng: np.random.Generator) -> dict[int, tuple[Array, Array]]:
    """Exact boxes of a camera by frame with confidence, without those hidden to more than MOST_HIDDEN.

    feet: (frames, people, 2) m. stature: (people,) m.
    """
    out = {}
    for frame, places in enumerate(feet):
        order = np.argsort(np.linalg.norm(places - camera.pose.translation[:2], axis=1))
        nearer, boxes, hidden = np.zeros((0, 4)), [], []
        for k in order.tolist():
            box = body_boxes(camera.camera, camera.pose, np.append(places[k], 0.0), (float(stature[k]), 2 * RADIUS))
            if not len(box):
                continue
            share = hidden_share(box[0], nearer)
            nearer = np.concatenate([nearer, box])
            if share <= MOST_HIDDEN:
                boxes.append(box[0])
                hidden.append(share)
        confidence = SURE - HIDING * np.array(hidden) + rng.normal(0.0, SPREAD, len(hidden))
        shuffled = rng.permutation(len(boxes))
        out[frame] = np.array(boxes).reshape(-1, 4)[shuffled], np.clip(confidence, 0.3, 0.99)[shuffled]
    return out


def hidden_share(box: Array, nearer: Array) -> float:
    """Share of a box (4,) that boxes (n, 4) before it cover, on a grid of 8 x 16 points."""
    u = box[0] + box[2] * (np.arange(8) + 0.5) / 8
    v = box[1] + box[3] * (np.arange(16) + 0.5) / 16
    across = (u >= nearer[:, :1]) & (u <= nearer[:, :1] + nearer[:, 2:3])
    down = (v >= nearer[:, 1:2]) & (v <= nearer[:, 1:2] + nearer[:, 3:])
    return float((across[:, None, :] & down[:, :, None]).any(axis=0).mean()) if len(nearer) else 0.0


def with_false_boxes(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with FALSE_BOXES more boxes a view and frame: bodies at random places of the floor that nobody else sees."""
    detections: dict[str, Mapping[int, tuple[Array, Array]]] = {}
    for name, camera in recording.cameras.items():
        boxes = {}
        for frame, (box, confidence) in sorted(recording.detections[name].items()):
            count = rng.poisson(FALSE_BOXES)
            feet = np.column_stack([rng.uniform(RADIUS, np.array(SIZE) - RADIUS, (count, 2)), np.zeros(count)])
            false = body_boxes(camera.camera, camera.pose, feet, (float(rng.uniform(*STATURES)), 2 * RADIUS))
            boxes[frame] = np.concatenate([box, false]), np.append(confidence, rng.uniform(*FALSE, len(false)))
        detections[name] = boxes
    return replace(recording, detections=detections)
