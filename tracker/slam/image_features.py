"""Features of the images of a tick, found before the filter processes the tick, so that other threads can do it.

A panorama is levelled by the robot's own "up": its gyroscope, corrected by its accelerometer (a complementary filter with constant gain;
Mahony, Hamel & Pflimlin 2008). The pose of the SLAM filter is not needed.

The rows of a rolling shutter and of an exposure have times of their own. The odometry moves their bearings to the time of the frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from tracker.geometry import Array, Image, Pose
from tracker.geometry.cameras import Panorama
from tracker.slam.features import FeatureParameters, extract
from tracker.types import Mount, Odometry, Setup, Sightings, Tick, View

GAIN = 0.1
"""Share of the accelerometer's "up" in a tick. Its noise and shaking are averaged over about ten ticks."""
LARGEST_ERROR = 0.15
"""rad: beyond this angle between the two, the gyroscope has missed a motion, and only the accelerometer is used."""


@dataclass(frozen=True, eq=False)
class _Job:
    """An image to search. up (3,): the direction "up" in the camera's frame."""

    view: View
    image: Image
    camera: Panorama
    mount: Mount
    up: Array


class ImageFeatures:
    """Finds features in the panoramas of moving robots. Ticks must come in their order. threads: search the images of a tick side by side."""

    def __init__(self, setup: Setup, parameters: FeatureParameters, threads: ThreadPoolExecutor | None = None) -> None:
        self._setup, self._parameters, self._threads = setup, parameters, threads
        # "Up" (3,) in the body frame of each robot at its last odometry, and the tick of that.
        self._up: dict[str, Array] = {}
        self._seen: dict[str, int] = {}

    def find(self, tick: Tick) -> Tick:
        """The tick with `features` in each view that has an image, neither sightings nor features, and the camera of a moving robot.

        Raises ValueError as `extract` does.
        """
        mounts = self._setup.mounts
        # For a camera that the setup does not have, the filter raises the error when it processes this tick.
        if any(view.camera not in mounts for view in tick.views):
            return tick
        odometry = {mounts[view.camera].robot: view.odometry for view in tick.views if view.odometry is not None}
        for robot, measured in odometry.items():
            self._turn(robot, measured, tick.index)
        jobs = list(self._jobs(tick))
        if not jobs:
            return tick
        found = map(self._search, jobs) if self._threads is None else self._threads.map(self._search, jobs)
        features = {job.view: sightings for job, sightings in zip(jobs, found, strict=True)}
        return replace(tick, views=tuple(replace(view, features=features.get(view, view.features)) for view in tick.views))

    def _search(self, job: _Job) -> Sightings:
        found = extract(job.image, job.camera, job.up, job.view.detections, self._parameters)
        own = job.mount.sees_itself(found.bearing)
        return (found.select(~own) if own.any() else found).sightings()

    def _jobs(self, tick: Tick) -> Iterator[_Job]:
        for view in tick.views:
            mount = self._setup.mounts[view.camera]
            if view.image is None or view.sightings is not None or view.features is not None or self._setup.is_fixed(mount.robot):
                continue
            if isinstance(mount.camera, Panorama):
                yield _Job(view, view.image, mount.camera, mount, mount.T_body_camera.rotation.T @ self._up_of(mount.robot))

    def _up_of(self, robot: str) -> Array:
        """The direction "up" (3,) in the body frame: that of the start without odometry, and upright where the start is unknown."""
        start = self._setup.starts[robot]
        return self._up.get(robot, np.array([0.0, 0.0, 1.0]) if start is None else start.T_world_robot.rotation[2])

    def _turn(self, robot: str, odometry: Odometry, tick: int) -> None:
        """Turn a robot's "up" by its odometry, and correct it by the measured one."""
        up = odometry.T_before_now.rotation.T @ self._up_of(robot)
        if odometry.gravity is not None:
            measured = odometry.gravity / np.linalg.norm(odometry.gravity)
            # After a gap, the turn since the last odometry is unknown.
            gap = tick != self._seen.get(robot, tick - 1) + 1
            gain = 1.0 if gap or measured @ up < np.cos(LARGEST_ERROR) else GAIN
            up = up + gain * (measured - up)
        self._up[robot], self._seen[robot] = up / np.linalg.norm(up), tick


def row_delays(bearings: Array, mount: Mount) -> Array:
    """Times (n,) s from the middle of the exposure of the rows in which bearings (n, 3) are seen to the time of the frame.

    The time of the frame is the end of the exposure of the last row. A row in the share s of the height is read out (1 − s) · readout before that.
    """
    pixels, _ = mount.camera.pixels_from_bearings(bearings)
    return np.asarray(mount.exposure / 2 + mount.readout * np.clip(1 - pixels[:, 1] / mount.camera.height, 0, 1))


def turned_to_frame(bearings: Array, mount: Mount, T_before_now: Pose, period: float) -> Array:
    """Unit bearings (n, 3) of far points as the camera would see them at the time of the frame.

    The robot turns evenly within a period of `period` s.
    """
    if not (mount.readout or mount.exposure) or not len(bearings):
        return bearings
    turn = mount.T_body_camera.rotation.T @ T_before_now.log()[3:]
    # A static point turns against the camera, here from the row's time to the frame's. The series is exact to the third order.
    w = -(row_delays(bearings, mount) / period)[:, None] * turn
    once = np.cross(w, bearings)
    out = bearings + once + np.cross(w, once) / 2
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def moved_to_frame(bearings: Array, ranges: Array, mount: Mount, T_before_now: Pose, period: float) -> Array:
    """Bearings (n, 3) of `turned_to_frame` of points that are `ranges` (n,) m away, without the parallax of the camera's motion.

    The camera moves evenly: by (v + ω × t) · delay / period in the body, with [v, ω] the logarithm of T_before_now and t its position there.
    """
    if not (mount.readout or mount.exposure) or not len(bearings):
        return bearings
    motion, T = T_before_now.log(), mount.T_body_camera
    way = T.rotation.T @ (motion[:3] + np.cross(motion[3:], T.translation))
    out = ranges[:, None] * bearings - (row_delays(bearings, mount) / period)[:, None] * way
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
