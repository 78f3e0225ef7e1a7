"""The tree of coordinate frames from transforms (tf and tf_static), and its static parts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tracker.geometry import Pose, rotation_from_quaternion

STILL = 1e-3
"""m and rad: a transform that changes by less is static. Static joints are often published repeatedly."""


def pose_from_message(position: Any, orientation: Any) -> Pose:
    """The pose of a Point or Vector3 and a Quaternion. Raises ValueError for a quaternion of zeros and for numbers that are not finite."""
    place = np.array([position.x, position.y, position.z])
    turn = np.array([orientation.w, orientation.x, orientation.y, orientation.z])
    if not (np.isfinite(place).all() and np.isfinite(turn).all()):
        raise ValueError(f"pose has {place.tolist()} m and {turn.tolist()}, needs finite numbers")
    return Pose(rotation_from_quaternion(turn), place)


@dataclass(eq=False)
class FrameTree:
    """Frames and their parents. parent: child → parent and the first T_parent_child. moving: children whose transform changes."""

    parent: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    moving: set[str] = field(default_factory=set)

    def add(self, message: Any) -> None:
        """Add the transforms of a TFMessage."""
        for transform in message.transforms:
            child, above = bare(transform.child_frame_id), bare(transform.header.frame_id)
            if child in self.moving:
                continue
            pose = pose_from_message(transform.transform.translation, transform.transform.rotation)
            known = self.parent.setdefault(child, (above, pose))
            if known[0] != above or np.abs((known[1].inverse() @ pose).log()).max() > STILL:
                self.moving.add(child)

    def chain(self, frame: str) -> dict[str, Pose]:
        """The frame and its ancestors up to the first moving transform, from near to far: name → T_name_frame."""
        out, pose = {frame: Pose.identity()}, Pose.identity()
        while frame in self.parent and frame not in self.moving:
            frame, step = self.parent[frame]
            if frame in out:
                raise ValueError(f"transforms of frame {frame!r} go in a circle, needs a tree")
            pose = step @ pose
            out[frame] = pose
        return out

    def between(self, target: str, frame: str, world: str = "") -> Pose | None:
        """T_target_frame; None where a transform between the frames moves, or where the path passes the frame `world`."""
        down = {name: pose for name, pose in self.chain(target).items() if name != world}
        return next((down[name].inverse() @ pose for name, pose in self.chain(frame).items() if name in down), None)


def bare(frame: str) -> str:
    """The name of a frame without the leading slash of early versions of ROS 1."""
    return frame.lstrip("/")
