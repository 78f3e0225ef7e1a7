"""What a bag of our own export says beyond that of a robot: true people and poses, and the terrain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tracker.formats.ros.bag_times import FrameTimes
from tracker.formats.ros.bag_values import grids_from_map, people_from_markers
from tracker.formats.ros.frame_tree import pose_from_message
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.ground import Grid

PEOPLE, TERRAIN = "/truth/people", "/terrain/map"
BOXES, POSE, START = "/truth/detections", "/truth/pose", "/initialpose"
"""Ends of the topics of a camera and of a robot."""
GROUND, TOPS = "elevation", "obstacles"
"""Layers of the terrain: the ground, and the ground with walls and furniture."""
Taker = Callable[[int, Any], None]
"""Takes time of the log [ns] and message."""


@dataclass(eq=False)
class BagTruth:
    """people: time of the log [ns] → ids (k,) and feet (k, 3) m. visible: time → person → the largest share that a camera sees.

    poses: robot → time → T_world_robot. starts: robot → covariance (6, 6) of its start's right tangent. grids: layer of the terrain → height map.
    """

    people: dict[int, tuple[Ints, Array]] = field(default_factory=dict)
    visible: dict[int, dict[int, float]] = field(default_factory=dict)
    poses: dict[str, dict[int, Pose]] = field(default_factory=dict)
    starts: dict[str, Array] = field(default_factory=dict)
    grids: dict[str, Grid] = field(default_factory=dict)

    def takers(self, kinds: Mapping[str, str]) -> dict[str, Taker]:
        """Topic → what takes its messages, of the topics of a bag."""
        out: dict[str, Taker] = {}
        for topic in kinds:
            name = topic[1:].partition("/")[0]
            if topic == PEOPLE:
                out[topic] = self._add_people
            elif topic == TERRAIN:
                out[topic] = self._add_terrain
            elif topic == f"/{name}{BOXES}":
                out[topic] = self._add_boxes
            elif topic == f"/{name}{POSE}":
                out[topic] = self._of_robot(name, self._add_pose)
            elif topic == f"/{name}{START}":
                out[topic] = self._of_robot(name, self._add_start)
        return out

    def _add_people(self, log: int, message: Any) -> None:
        self.people[log] = people_from_markers(message)

    def _add_terrain(self, _: int, message: Any) -> None:
        self.grids = grids_from_map(message)

    def _add_boxes(self, log: int, message: Any) -> None:
        shares = self.visible.setdefault(log, {})
        for detection in message.detections:
            person, share = int(detection.id), float(detection.results[0].hypothesis.score)
            shares[person] = max(share, shares.get(person, 0.0))

    def _of_robot(self, name: str, add: Callable[[str, int, Any], None]) -> Taker:
        return lambda log, message: add(name, log, message)

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
