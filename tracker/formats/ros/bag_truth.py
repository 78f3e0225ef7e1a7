"""Data that only bags of pilsim's export hold: true people and poses, and the terrain."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from tracker.formats.ros.bag_times import FrameTimes
from tracker.formats.ros.bag_values import directions_from_message, grids_from_map, people_from_markers, stamp_of
from tracker.formats.ros.frame_tree import pose_from_message
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.ground import Grid
from tracker.types import RobotDetections

PEOPLE, TERRAIN = "/truth/people", "/terrain/map"
BOXES, SEEN, ROBOTS, POSE, START = "/truth/detections", "/detections", "/robots", "/truth/pose", "/initialpose"
"""Ends of the topics of a camera and of a robot."""
GROUND, TOPS = "elevation", "obstacles"
"""Layers of the terrain: the ground, and the ground with walls and furniture."""
Taker = Callable[[int, Any], None]
"""Takes time of the log [ns] and message."""


@dataclass(eq=False)
class BagTruth:
    """people: time of the log [ns] → ids (k,) and feet (k, 3) m. visible: time → person → the largest share that a camera sees.

    covariances: camera → stamp [ns] → (n, 3) rad²: c00, c01, c11 of its boxes. robots: camera → stamp → other robots that it sees.
    poses: robot → time → T_world_robot. starts: robot → covariance (6, 6) of its start's right tangent. grids: layer of the terrain → height map.
    """

    people: dict[int, tuple[Ints, Array]] = field(default_factory=dict)
    visible: dict[int, dict[int, float]] = field(default_factory=dict)
    covariances: dict[str, dict[int, Array]] = field(default_factory=dict)
    robots: dict[str, dict[int, RobotDetections]] = field(default_factory=dict)
    poses: dict[str, dict[int, Pose]] = field(default_factory=dict)
    starts: dict[str, Array] = field(default_factory=dict)
    grids: dict[str, Grid] = field(default_factory=dict)

    def takers(self, topics: Iterable[str]) -> list[tuple[str, Taker]]:
        """Pairs of a known topic of a bag and the function that takes its messages."""
        whole = {PEOPLE: self._add_people, TERRAIN: self._add_terrain}
        named = {BOXES: self._add_boxes, SEEN: self._add_covariances, ROBOTS: self._add_robots, POSE: self._add_pose, START: self._add_start}
        out: list[tuple[str, Taker]] = []
        for topic in topics:
            name, _, end = topic[1:].partition("/")
            if topic in whole:
                out.append((topic, whole[topic]))
            elif f"/{end}" in named:
                out.append((topic, partial(named[f"/{end}"], name)))
        return out

    def _add_people(self, log: int, message: Any) -> None:
        self.people[log] = people_from_markers(message)

    def _add_terrain(self, _: int, message: Any) -> None:
        self.grids = grids_from_map(message)

    def _add_covariances(self, name: str, _: int, message: Any) -> None:
        covariance = directions_from_message(message)[1]
        self.covariances.setdefault(name, {})[stamp_of(message)] = covariance.reshape(-1, 4)[:, [0, 1, 3]]

    def _add_robots(self, name: str, _: int, message: Any) -> None:
        bearing, covariance = directions_from_message(message)
        names = tuple(detection.id for detection in message.detections)
        self.robots.setdefault(name, {})[stamp_of(message)] = RobotDetections(bearing, names, covariance)

    def _add_boxes(self, _: str, log: int, message: Any) -> None:
        shares = self.visible.setdefault(log, {})
        for detection in message.detections:
            person, share = int(detection.id), float(detection.results[0].hypothesis.score)
            shares[person] = max(share, shares.get(person, 0.0))

    def _add_pose(self, name: str, log: int, message: Any) -> None:
        self.poses.setdefault(name, {})[log] = pose_from_message(message.pose.position, message.pose.orientation)

    def _add_start(self, name: str, _: int, message: Any) -> None:
        pose = pose_from_message(message.pose.pose.position, message.pose.pose.orientation)
        R = np.kron(np.eye(2), pose.rotation)
        self.starts[name] = R.T @ np.reshape(message.pose.covariance, (6, 6)) @ R

    def people_by_frame(self, times: FrameTimes) -> dict[int, tuple[Ints, Array]]:
        """Frame from 0 → ids (k,) and feet (k, 3) m of the true people."""
        return {frame: people for log, people in self.people.items() if (frame := times.nearest(log)) is not None}

    def visible_by_frame(self, times: FrameTimes) -> dict[int, Array]:
        """Frame from 0 → visible share (k,) of the true people in the order of people_by_frame."""
        found = {}
        for log, (ids, _) in self.people.items():
            if (frame := times.nearest(log)) is not None:
                found[frame] = np.array([self.visible.get(log, {}).get(person, 0.0) for person in ids.tolist()])
        return found

    def poses_by_frame(self, robot: str, times: FrameTimes) -> dict[int, Pose] | None:
        """Frame from 0 → T_world_robot, None where the bag does not have them."""
        poses = self.poses.get(robot)
        return None if poses is None else {frame: pose for log, pose in poses.items() if (frame := times.nearest(log)) is not None}
