"""SLAM and people tracker in the loop of an episode, on simulated detections, landmark sightings and odometry, without rendering.

`TrackMemory` predicts people whose tracks have ended, for some seconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.placement import visibility
from sim.placement.config import PlacementConfig
from sim.placement.information import ACCELERATION_DENSITY
from sim.placement.map import LANDMARKS, SURFACE_MARGIN, PlacementMap
from sim.placement.movers import Mover
from sim.placement.visibility import BODY_POINTS, line_of_sight
from sim.recording.frames import Measurements, tick_of
from sim.recording.tracker_setup import START_SIGMA
from sim.robots import odometry, rover
from sim.sensors.raycast_camera import Landmarks
from sim.sensors.view_detectors import ViewDetector
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import INDEPENDENT, model_of
from tracker.geometry import Array, Ints, Pose, angles_from_bearing, wrap
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Grid
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.metrics.trajectory import score_robots
from tracker.parameter_file import with_fields
from tracker.pipeline import Parameters, Tracker
from tracker.types import Boxes, Detections, Estimate, Keypoints, Mount, Odometry, Setup, Sightings, Start, ViewTruth

CAMERA = Panorama(1024, 512)
"""The camera of a robot. Nothing is rendered: it defines the pixels of detections."""

BODY_RADIUS = 0.22
"""Half the width of a person's box, m."""

NOISE = 0.0026
"""Standard deviation of a box's edge, rad, as in Scenario."""

SAMPLES = 25
"""Gyroscope samples per frame."""

MEMORY_DURATION = 8.0
"""Time for which a person is predicted after the last report of the track, s."""

MATCH_DISTANCE = 1.0
"""Distance within which a track is taken for a predicted person under a new id and replaces it, m."""


@dataclass(eq=False)
class TrackMemory:
    """Tracked and predicted people.

    track_id (k,); position (k, 2) m; velocity (k, 2) m/s; covariance (k, 2, 2) m²; time_unseen (k,): time since the last report, s.
    """

    track_id: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    position: Array = field(default_factory=lambda: np.zeros((0, 2)))
    velocity: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    time_unseen: Array = field(default_factory=lambda: np.zeros(0))

    def update(self, reported: TrackMemory, dt: float) -> None:
        """Add the tracker's report, dt s after the previous one."""
        predicted = self.position + self.velocity * dt
        time_unseen = self.time_unseen + dt
        near = (np.linalg.norm(predicted[:, None] - reported.position[None], axis=2) < MATCH_DISTANCE).any(axis=1)
        kept = ~np.isin(self.track_id, reported.track_id) & (time_unseen <= MEMORY_DURATION) & ~near
        # White acceleration noise: the variance of the position grows with the third power of the time.
        growth = ACCELERATION_DENSITY * (time_unseen**3 - self.time_unseen**3) / 3
        spread = self.covariance + growth[:, None, None] * np.eye(2)
        self.track_id = np.concatenate([reported.track_id, self.track_id[kept]])
        self.position = np.concatenate([reported.position, predicted[kept]])
        self.velocity = np.concatenate([reported.velocity, self.velocity[kept]])
        self.covariance = np.concatenate([reported.covariance, spread[kept]])
        self.time_unseen = np.concatenate([reported.time_unseen, time_unseen[kept]])


@dataclass(eq=False)
class TrackerInLoop:
    """The tracker of a team, its simulated sensors, and the last estimate: position (k, 2) m and covariance (k, 2, 2) m² of people.

    landmarks: of the scene. last_translation (r, 3) m: motion of each robot in the last frame.
    wheel_angles (r, 4) rad: total rotation of the wheels. index: of the next frame. detectors: of each robot's camera.
    truth: people (p, 4) and poses of each frame. reported: estimates, `delay` frames late; `position` has no delay.
    """

    config: PlacementConfig
    place: PlacementMap
    rng: np.random.Generator
    tracker: Tracker
    landmarks: Landmarks
    systematic_errors: list[odometry.SystematicErrors]
    position: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    index: int = 0
    previous_poses: list[Pose] = field(default_factory=list)
    last_translation: Array = field(default_factory=lambda: np.zeros((0, 3)))
    wheel_angles: Array = field(default_factory=lambda: np.zeros((0, 4)))
    detected: list[Detections] = field(default_factory=list)
    truth: list[tuple[Array, list[Pose]]] = field(default_factory=list)
    reported: list[Estimate] = field(default_factory=list)
    memory: TrackMemory = field(default_factory=TrackMemory)
    detectors: list[ViewDetector] = field(default_factory=list)

    @staticmethod
    def begin(config: PlacementConfig, place: PlacementMap, mover: Mover, rng: np.random.Generator) -> TrackerInLoop:
        """The tracker before the first frame. Start poses are the true ones with noise of START_SIGMA."""
        mount, count = rover.camera_mount(config.camera_height), config.robots
        starts: dict[str, Start | None] = {}
        for k, pose in enumerate(mover.poses()):
            starts[f"robot_{k}"] = Start(pose @ Pose.exp(rng.normal(0.0, START_SIGMA)), np.diag(START_SIGMA**2))
        mounts = {f"robot_{k}_camera": Mount(CAMERA, mount, f"robot_{k}") for k in range(count)}
        floor, tops = (Grid(heights, place.floor.origin, place.floor.spacing) for heights in (place.floor.heights, place.elevation.top))
        # Without the reach, the tracker would take a person whom one robot sees, but farther robots do not, for a false detection.
        targets = with_fields(Parameters().targets, {"fusion.reach": config.reach} | dict(config.parameters))
        parameters = Parameters(targets=targets, delay=config.delay)
        tracker = Tracker(Setup(mounts, floor, starts, config.frame_period, occluders=tops), parameters)
        landmarks = Landmarks.described(place.surface_points(LANDMARKS, rng), LANDMARKS, rng)
        systematic_errors = [odometry.SystematicErrors.draw(rng) for _ in range(count)]
        out = TrackerInLoop(config, place, rng, tracker, landmarks, systematic_errors)
        model = model_of(config.detector_model, IndependentErrors(config.misses, config.clutter, NOISE, config.visibility_limits.share))
        # Independent errors are drawn from the stream of the episode.
        streams = [rng] * count if config.detector_model == INDEPENDENT else rng.spawn(count)
        run = config.frame_period, range(1, config.people + 1)
        out.detectors = [ViewDetector(model, CAMERA, run, stream) for stream in streams]
        out.last_translation, out.wheel_angles = np.zeros((count, 3)), np.zeros((count, 4))
        return out

    def update(self, mover: Mover, people: Array) -> None:
        """Simulate the measurements of a frame among people (p, 4), and update the tracker."""
        poses = mover.poses()
        odometry_of = {f"robot_{k}": one for k, one in enumerate(self._odometry(mover, poses) if self.index else ())}
        cameras = [pose @ rover.camera_mount(self.config.camera_height) for pose in poses]
        self.detected = [self._detect(k, camera, people, tipped) for k, (camera, tipped) in enumerate(zip(cameras, mover.tipped(), strict=True))]
        mounts = self.tracker.setup.mounts
        seen = dict(zip(mounts, map(self._sightings, cameras), strict=True))
        measured = Measurements(dict(zip(mounts, self.detected, strict=True)), odometry_of, seen)
        self.truth.append((people, poses))
        if estimate := self.tracker.step(tick_of(self.index, self.config.frame_period, mounts, measured)):
            self.reported.append(estimate)
        tracks = self.tracker.current()
        position, covariance = tracks.state[:, :2], tracks.covariance[:, :2, :2]
        self.memory.update(TrackMemory(tracks.tree, position, tracks.state[:, 2:4], covariance, np.zeros(len(position))), self.config.frame_period)
        self.position, self.covariance = position, covariance
        self.index, self.previous_poses = self.index + 1, poses

    def planar_poses(self) -> Array:
        """Robot poses estimated by SLAM, (r, 3): x, y m and yaw rad."""
        poses = [self.tracker.slam.pose(f"robot_{k}") for k in range(self.config.robots)]
        return np.array([[*pose.translation[:2], np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])] for pose in poses])

    def detection_rows(self) -> Array:
        """Detections (r, slots, 5), ordered by azimuth, as in observations.space_of.

        The distance is that at which a person of 1.75 m has the same apparent height. The last number is the detector's confidence.
        """
        out = np.zeros((self.config.robots, self.config.max_tracks, 5))
        for k, found in enumerate(self.detected):
            azimuth, _ = angles_from_bearing(found.bearing)
            order = np.argsort(azimuth)[: self.config.max_tracks]
            distance = 1.75 / np.maximum(found.extent[order, 1], 0.05) / self.config.reach
            rows = np.stack([np.ones(len(order)), np.cos(azimuth[order]), np.sin(azimuth[order]), distance, found.confidence[order]], axis=1)
            out[k, : len(order)] = rows
        return out

    def scores(self) -> dict[str, float]:
        """HOTA, IDF1 and MOTA over all people (matches within 1 m), and the robots' ATE (m), over all frames. It ends the tracking."""
        while estimate := self.tracker.finish():
            self.reported.append(estimate)
        frames = [
            MatchingFrame(np.arange(len(people)), people[:, :2], estimate.target_id, estimate.position[:, :2])
            for (people, _), estimate in zip(self.truth, self.reported, strict=True)
        ]
        found, names = score(frames), [f"robot_{k}" for k in range(self.config.robots)]
        truth = {name: [poses[k] for _, poses in self.truth] for k, name in enumerate(names)}
        estimated = {name: [estimate.T_world_robot.get(name) for estimate in self.reported] for name in names}
        return {"hota": found.hota, "idf1": found.idf1, "mota": found.mota, "ate_m": score_robots(truth, estimated).ate_m}

    def _detect(self, robot: int, camera: Pose, people: Array, tipped: bool) -> Detections:
        boxes = Boxes.none() if tipped or not len(people) else _true_boxes(self.place, camera, people, self.config.visibility_limits)
        below = camera.translation[None, :2]
        view = ViewTruth(camera, float(self.place.floor_at(below)[0]), np.array([0.0, 0.0, 1.0]), boxes, Keypoints.none())
        return self.detectors[robot].detect(view, np.arange(1, len(people) + 1), people[:, :3])

    def _sightings(self, camera: Pose) -> Sightings:
        """Sightings of landmarks by a camera, by lines of sight over the height map instead of exact ray casts."""
        elevation, eye = self.place.elevation, camera.translation
        return self.landmarks.sightings(camera, lambda points: line_of_sight(elevation, eye, points, SURFACE_MARGIN) > 0, self.rng)

    def _odometry(self, mover: Mover, poses: list[Pose]) -> list[Odometry]:
        """Odometry of the last frame: from the physics, or else simulated for wheels without slip and a gyroscope."""
        found = mover.odometry()
        if found is not None:
            return found
        out, period = [], self.config.frame_period
        for k, (before, now) in enumerate(zip(self.previous_poses, poses, strict=True)):
            move = before.inverse() @ now
            turn = move.log()[3:]
            left, right = move.translation[0] - rover.TRACK / 2 * turn[2], move.translation[0] + rover.TRACK / 2 * turn[2]
            wheels = self.wheel_angles[k] + np.array([left, right, left, right]) / rover.WHEEL_RADIUS
            acceleration = (move.translation - self.last_translation[k]) / period**2
            rates, angles = np.tile(turn / period, (SAMPLES, 1)), np.stack([self.wheel_angles[k], wheels])
            motion = odometry.FrameMotion(rates, period / SAMPLES, angles, acceleration, now.rotation[2])
            out.append(odometry.measure(motion, self.systematic_errors[k], self.rng))
            self.wheel_angles[k], self.last_translation[k] = wheels, move.translation
        return out


def _true_boxes(place: PlacementMap, camera: Pose, people: Array, limits: visibility.VisibilityLimits) -> Boxes:
    """The true boxes of all people in a panorama. A box is as wide as the person's cylinder.

    Its visible part ends at the lowest visible body point.
    """
    points = visibility.visible_points(place.elevation, camera.translation, people)
    share = points.mean(axis=1)
    local = camera.inverse()
    away = people[:, :2] - camera.translation[:2]
    distance = np.maximum(np.hypot(*away.T), 0.3)
    share = share * ((distance < limits.reach) & (np.arctan(people[:, 3] / distance) > limits.size))
    lowest = np.where(points, BODY_POINTS[:, 1], 1.0).min(axis=1)
    bottom = np.where(lowest < BODY_POINTS[:, 1].min() + 0.01, 0.0, lowest)
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
    """Azimuth and elevation (p,) rad, in the camera's frame, of points `height` (p,) m above the feet."""
    points = local.apply(people[:, :3] + np.outer(height, [0.0, 0.0, 1.0]))
    return angles_from_bearing(points / np.linalg.norm(points, axis=1, keepdims=True))
