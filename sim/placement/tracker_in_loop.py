"""What a team remembers of the people whom its tracker tells of: how they moved, and for a while where those must be who are told of no more.

The real tracker in the loop: SLAM and people from simulated detections and sightings of landmarks, frame by frame, without a picture.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.placement import visibility
from sim.placement.config import PlacementConfig
from sim.placement.map import PlacementMap
from sim.placement.movers import Mover
from sim.placement.visibility import BODY, clear
from sim.recording.tracker_setup import START_SIGMA
from sim.robots import odometry, rover
from sim.sensors.person_detector import Detector
from sim.sensors.raycast_camera import LandmarkSensor
from tracker.geometry import Array, Ints, Pose, angles_from_bearing, perturbed_bearings, wrap
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Grid
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, Tracker
from tracker.slam.parameters import SlamParameters
from tracker.types import Boxes, Detections, Estimate, Keypoints, Mount, Odometry, Setup, Sightings, Start, Tick, View, ViewTruth

LASTING = 8.0
"""s for which somebody is remembered who is told of no more."""

BLEND = 0.5
"""s over which velocities are averaged: a tracker's places tremble."""

UNSTEADY = 0.6
"""m²/s³: how fast the velocity of somebody who is out of sight becomes uncertain, an axis."""

SAME = 1.0
"""m: somebody who is told of so near to where another must be is that other, under a new number."""


@dataclass(eq=False)
class TrackMemory:
    """number (k,) of the tracker; position (k, 2) m, velocity (k, 2) m/s, covariance (k, 2, 2) m², unseen (k,) s since they were told of."""

    number: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    position: Array = field(default_factory=lambda: np.zeros((0, 2)))
    velocity: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    unseen: Array = field(default_factory=lambda: np.zeros(0))

    def take(self, number: Ints, position: Array, covariance: Array, dt: float) -> None:
        """The tracker tells of these people, dt s after it did last."""
        ahead = self.position + self.velocity * dt
        then = {int(n): k for k, n in enumerate(self.number)}
        old = np.array([then.get(int(n), -1) for n in number], dtype=np.int64)
        velocity = np.zeros_like(position)
        known = old >= 0
        moved = (position[known] - self.position[old[known]]) / dt
        velocity[known] = self.velocity[old[known]] + min(dt / BLEND, 1.0) * (moved - self.velocity[old[known]])
        unseen = self.unseen + dt
        near = (np.linalg.norm(ahead[:, None] - position[None], axis=2) < SAME).any(axis=1)
        kept = ~np.isin(self.number, number) & (unseen <= LASTING) & ~near
        # White noise on the acceleration: the place's variance grows with the third power of the time.
        growth = UNSTEADY * (unseen**3 - self.unseen**3) / 3
        spread = self.covariance + growth[:, None, None] * np.eye(2)
        self.number = np.concatenate([number, self.number[kept]])
        self.position, self.velocity = np.concatenate([position, ahead[kept]]), np.concatenate([velocity, self.velocity[kept]])
        self.covariance = np.concatenate([covariance, spread[kept]])
        self.unseen = np.concatenate([np.zeros(len(number)), unseen[kept]])


CAMERA = Panorama(1024, 512)

BODY_RADIUS = 0.22
"""m: half the width of people's boxes."""

NOISE = 0.0026
"""rad: one sigma of a box's edge, as in Scenario."""

LANDMARKS, NEAREST, FARTHEST = 140, 0.6, 20.0
"""How many there are, and m at which rays find them."""

SLAM = SlamParameters(seen=16, growth=4, capacity=72, clones=2)
"""A smaller map than recorded sequences are tracked with: the joint filter's work grows with its square."""

BEFORE = 0.4
"""m before a landmark in which a column of its own surface hides nothing."""

SAMPLES = 25
"""Rates of the gyroscope in a frame."""


@dataclass(eq=False)
class Tracking:
    """The tracker's state and its sensors'. position (k, 2) m and covariance (k, 2, 2) m² of people, poses of robots: what it said last."""

    config: PlacementConfig
    place: PlacementMap
    rng: np.random.Generator
    tracker: Tracker
    landmarks: Array
    looks: Array
    wear: list[odometry.SystematicErrors]
    position: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    index: int = 0
    before: list[Pose] = field(default_factory=list)
    moved: Array = field(default_factory=lambda: np.zeros((0, 3)))
    wheels: Array = field(default_factory=lambda: np.zeros((0, 4)))
    estimate: Estimate | None = None
    detected: list[Detections] = field(default_factory=list)
    frames: list[MatchingFrame] = field(default_factory=list)
    recall: TrackMemory = field(default_factory=TrackMemory)

    @staticmethod
    def begin(config: PlacementConfig, place: PlacementMap, mover: Mover, rng: np.random.Generator) -> Tracking:
        mount, count = rover.camera_mount(config.camera_height), config.robots
        starts: dict[str, Start | None] = {}
        for k, pose in enumerate(mover.poses()):
            starts[f"robot_{k}"] = Start(pose @ Pose.exp(rng.normal(0.0, START_SIGMA)), np.diag(START_SIGMA**2))
        mounts = {f"robot_{k}_camera": Mount(CAMERA, mount, f"robot_{k}") for k in range(count)}
        floor, tops = (Grid(heights, place.floor.origin, place.floor.spacing) for heights in (place.floor.heights, place.heights.top))
        tracker = Tracker(Setup(mounts, floor, starts, config.frame, occluders=tops), Parameters(slam=SLAM))
        landmarks, look = surfaces(place, LANDMARKS, rng), rng.normal(size=(LANDMARKS, LandmarkSensor.descriptor_size))
        looks = (look / np.linalg.norm(look, axis=1, keepdims=True))[: len(landmarks)]
        wear = [odometry.SystematicErrors.draw(rng) for _ in range(count)]
        out = Tracking(config, place, rng, tracker, landmarks, looks, wear)
        out.moved, out.wheels = np.zeros((count, 3)), np.zeros((count, 4))
        return out

    def take(self, mover: Mover, people: Array) -> None:
        """A frame: what robots measure now of people (p, 4), and what the tracker makes of it."""
        poses = mover.poses()
        measured = self._odometry(mover, poses) if self.index else [None] * len(poses)
        cameras = [pose @ rover.camera_mount(self.config.camera_height) for pose in poses]
        self.detected = [self._detect(camera, people, over) for camera, over in zip(cameras, mover.over(), strict=True)]
        views = [
            View(f"robot_{k}_camera", found, self._sightings(camera), measured[k])
            for k, (camera, found) in enumerate(zip(cameras, self.detected, strict=True))
        ]
        said = self.tracker.step(Tick(self.index, self.index * self.config.frame, tuple(views)))
        assert said is not None
        self.estimate, self.position, self.covariance = said, said.position[:, :2], said.covariance[:, :2, :2]
        self.recall.take(said.target_id, self.position, self.covariance, self.config.frame)
        self.frames.append(MatchingFrame(np.arange(len(people)), people[:, :2], said.target_id, said.position[:, :2]))
        self.index, self.before = self.index + 1, poses

    def planar_poses(self) -> Array:
        """(r, 3) x, y m and yaw rad of the robots, as SLAM has them."""
        assert self.estimate is not None
        poses = [self.estimate.T_world_robot[f"robot_{k}"] for k in range(self.config.robots)]
        return np.array([[*pose.translation[:2], np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])] for pose in poses])

    def seen(self) -> Array:
        """(r, slots, 5): detections in the order of their directions, as placement_observation.space_of has them; the distance is that at which
        somebody of 1.75 m looks as tall, the last number is the detector's confidence."""
        out = np.zeros((self.config.robots, self.config.tracks, 5))
        for k, found in enumerate(self.detected):
            azimuth, _ = angles_from_bearing(found.bearing)
            order = np.argsort(azimuth)[: self.config.tracks]
            distance = 1.75 / np.maximum(found.extent[order, 1], 0.05) / self.config.reach
            rows = np.stack([np.ones(len(order)), np.cos(azimuth[order]), np.sin(azimuth[order]), distance, found.confidence[order]], axis=1)
            out[k, : len(order)] = rows
        return out

    def scores(self) -> dict[str, float]:
        """MOTA and IDF1 of all frames so far, within 1 m, and how far SLAM had the robots off in the last, m."""
        found = score(self.frames)
        off = np.hypot(*(self.planar_poses()[:, :2] - np.array([pose.translation[:2] for pose in self.before])).T)
        return {"mota": found.mota, "idf1": found.idf1, "robots_off": float(off.mean())}

    def _detect(self, camera: Pose, people: Array, over: bool) -> Detections:
        config = self.config
        detector = Detector(config.misses, config.clutter, NOISE, config.eyesight.share)
        boxes = Boxes.none() if over or not len(people) else _boxes(self.place, camera, people, config.eyesight)
        below = camera.translation[None, :2]
        view = ViewTruth(camera, float(self.place.floor_at(below)[0]), np.array([0.0, 0.0, 1.0]), boxes, Keypoints.none())
        return detector.detect(CAMERA, view, self.rng)

    def _sightings(self, camera: Pose) -> Sightings:
        """The landmarks that a camera finds, errors and looks as in sightlines.Landmarking."""
        rule, n, rng = LandmarkSensor(), len(self.landmarks), self.rng
        found, order = rng.random(n) >= rule.miss_rate, rng.permutation(n)
        sigma = np.where(rng.random(n) < rule.outlier_rate, rule.outlier_noise, rule.noise)[:, None]
        error, blur = rng.normal(size=(n, 2)) * sigma, rng.normal(size=self.looks.shape) * rule.descriptor_noise / np.sqrt(rule.descriptor_size)
        away = self.landmarks - camera.translation
        distance = np.linalg.norm(away, axis=1)
        found &= (distance < rule.reach) & (distance > 0.3)
        found[found] = clear(self.place.heights, camera.translation, self.landmarks[found], BEFORE) > 0
        rows = order[found[order]]
        sight = away[rows] @ camera.rotation / distance[rows, None]
        bearing = perturbed_bearings(sight, error[rows])
        look, covariance = (self.looks[rows] + blur[rows]).astype(np.float32), np.tile(np.eye(2) * rule.noise**2, (len(rows), 1, 1))
        return Sightings(bearing, np.full(len(rows), np.nan), np.full(len(rows), -1), look, covariance)

    def _odometry(self, mover: Mover, poses: list[Pose]) -> list[Odometry]:
        """Of the last frame: the simulation's, or what wheels that do not slip and gyroscopes would say."""
        found = mover.odometry()
        if found is not None:
            return found
        out, period = [], self.config.frame
        for k, (before, now) in enumerate(zip(self.before, poses, strict=True)):
            move = before.inverse() @ now
            turn = move.log()[3:]
            left, right = move.translation[0] - rover.TRACK / 2 * turn[2], move.translation[0] + rover.TRACK / 2 * turn[2]
            wheels = self.wheels[k] + np.array([left, right, left, right]) / rover.WHEEL_RADIUS
            acceleration = (move.translation - self.moved[k]) / period**2
            rates, angles = np.tile(turn / period, (SAMPLES, 1)), np.stack([self.wheels[k], wheels])
            ride = odometry.FrameMotion(rates, period / SAMPLES, angles, acceleration, now.rotation[2])
            out.append(odometry.measure(ride, self.wear[k], self.rng))
            self.wheels[k], self.moved[k] = wheels, move.translation
        return out


def _boxes(place: PlacementMap, camera: Pose, people: Array, eyesight: visibility.Eyesight) -> Boxes:
    """The boxes of all people in a panorama: as wide as their cylinders; of what is seen, down to the lowest point of the body that is."""
    points = visibility.points_seen(place.heights, camera.translation, people)
    share = points.mean(axis=1)
    local = camera.inverse()
    away = people[:, :2] - camera.translation[:2]
    distance = np.maximum(np.hypot(*away.T), 0.3)
    share = share * ((distance < eyesight.reach) & (np.arctan(people[:, 3] / distance) > eyesight.size))
    lowest = np.where(points, BODY[:, 1], 1.0).min(axis=1)
    bottom = np.where(lowest < BODY[:, 1].min() + 0.01, 0.0, lowest)
    azimuth, feet = _angles(local, people, np.zeros(len(people)))
    _, head = _angles(local, people, people[:, 3])
    _, low = _angles(local, people, bottom * people[:, 3])
    half = np.arctan2(BODY_RADIUS, distance)
    scale = CAMERA.width / (2 * np.pi)
    left = np.mod((np.pi - wrap(azimuth + half)) * scale, CAMERA.width)
    right = left + 2 * half * scale
    rows = [(np.pi / 2 - angle) * scale for angle in (head, feet, low)]
    full = np.stack([left, rows[0], right, rows[1]], axis=1)
    seen = np.where(share[:, None] > 0, np.stack([left, rows[0], right, rows[2]], axis=1), 0.0)
    return Boxes(np.arange(1, len(people) + 1), seen, full, share, distance)


def _angles(local: Pose, people: Array, height: Array) -> tuple[Array, Array]:
    """(p,) azimuth and elevation rad, in the camera's frame, of points `height` (p,) m over the feet."""
    points = local.apply(people[:, :3] + np.outer(height, [0.0, 0.0, 1.0]))
    return angles_from_bearing(points / np.linalg.norm(points, axis=1, keepdims=True))


def surfaces(place: PlacementMap, count: int, rng: np.random.Generator) -> Array:
    """(n ≤ count, 3) m: where lines from robots' cameras first meet the ground or what stands on it."""
    along = np.arange(NEAREST, FARTHEST, 0.1)
    eyes = place.lookouts[rng.integers(len(place.lookouts), size=4 * count)]
    azimuth, elevation = rng.uniform(-np.pi, np.pi, len(eyes)), np.radians(rng.uniform(-40.0, 20.0, len(eyes)))
    sight = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
    points = eyes[:, None] + along[:, None] * sight[:, None]
    top, frame = place.heights.top, place.heights.frame
    j, i = (np.floor((points[..., axis] - frame[axis]) / frame[2] + 0.5).astype(int) for axis in (0, 1))
    inside = (i >= 0) & (j >= 0) & (i < top.shape[0]) & (j < top.shape[1])
    met = inside & (points[..., 2] < top[np.clip(i, 0, top.shape[0] - 1), np.clip(j, 0, top.shape[1] - 1)])
    first = met.argmax(axis=1)
    found = np.flatnonzero(met.any(axis=1) & (first > 0))[:count]
    return points[found, first[found]]
