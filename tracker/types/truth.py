"""The ground truth of a frame: poses of the robots, people, their boxes and their key points."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Ints, Mask, Pose, set_array, set_ints

KEYPOINT_NAMES = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
"""The key points of COCO, in its order (Lin et al. 2014)."""

KEYPOINT_COUNT = len(KEYPOINT_NAMES)

HIDDEN, VISIBLE = 1, 2
"""Visibility flags of key points in COCO; 0 is not in the image."""

VISIBLE_FRACTION = 0.2
"""Least visible fraction at which a person counts as seen."""

VISIBILITY_MEMORY = 9 / 7
"""s: people are evaluated for this time after they were seen (δ_a, 9 frames at 7 frames/s)."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """True boxes of n people in one image: person (n,) ids.

    seen, full (n, 4): left, top, right, bottom px of the visible part and of the whole body. seen is zero for people who are hidden.
    In a panorama right may exceed the width, where a body lies over the seam. In other cameras full ends at the edge of the image.
    visible (n,): visible pixels over the pixels without occlusion, in [0, 1]. range (n,) m from the camera to the middle between the hips.
    """

    person: Ints
    seen: Array
    full: Array
    visible: Array
    range: Array

    def __post_init__(self) -> None:
        n = len(self.person)
        set_ints(self, "person", (n,))
        for name, shape in (("seen", (n, 4)), ("full", (n, 4)), ("visible", (n,)), ("range", (n,))):
            set_array(self, name, shape)

    @staticmethod
    def none() -> Boxes:
        """No people."""
        return Boxes(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Keypoints:
    """True key points of n people in one image: person (n,) ids.

    pixels (n, 17, 2) u, v, zero where not in the image. visibility (n, 17): VISIBLE, HIDDEN (also by the person's own body), or 0.
    """

    person: Ints
    pixels: Array
    visibility: Ints

    def __post_init__(self) -> None:
        n = len(self.person)
        set_ints(self, "person", (n,))
        set_array(self, "pixels", (n, KEYPOINT_COUNT, 2))
        set_ints(self, "visibility", (n, KEYPOINT_COUNT))

    @staticmethod
    def none() -> Keypoints:
        """No people."""
        return Keypoints(np.zeros(0, dtype=np.int64), np.zeros((0, KEYPOINT_COUNT, 2)), np.zeros((0, KEYPOINT_COUNT), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class ViewTruth:
    """The truth of one camera in one frame: T_world_camera, height m and unit normal (3,) of the terrain straight below, and the people."""

    T_world_camera: Pose
    ground: float
    normal: Array
    boxes: Boxes
    keypoints: Keypoints

    def __post_init__(self) -> None:
        set_array(self, "normal", (3,))


@dataclass(frozen=True, eq=False)
class Truth:
    """The ground truth of one tick. Positions are in the world.

    T_world_robot: robot → pose. person_id (m,). feet (m, 3) m: the ground under the middle of the body.
    visible (m, cameras): visible pixels over the pixels without occlusion, in [0, 1], cameras in the order of Setup.mounts.
    joints (m, 17, 3) m: positions of KEYPOINT_NAMES, or None where they were not read (truth_tables.read_joints reads them).
    tipped: the robots that have tipped over. They still have odometry and panoramas.
    sitting: ids of the people who sit; None where the sequence does not say.
    """

    index: int
    T_world_robot: dict[str, Pose]
    person_id: Ints
    feet: Array
    visible: Array
    joints: Array | None = None
    tipped: frozenset[str] = frozenset()
    sitting: frozenset[int] | None = None

    def __post_init__(self) -> None:
        n = len(self.person_id)
        if not self.tipped <= set(self.T_world_robot):
            raise ValueError(f"tipped is {sorted(self.tipped)}, needs robots of {sorted(self.T_world_robot)}")
        if self.sitting and not self.sitting <= set(self.person_id.tolist()):
            raise ValueError(f"sitting is {sorted(self.sitting)[:10]}, needs ids of people of frame {self.index}")
        set_ints(self, "person_id", (n,))
        set_array(self, "feet", (n, 3))
        set_array(self, "visible", (n, None))
        if self.joints is not None:
            set_array(self, "joints", (n, KEYPOINT_COUNT, 3))
        if len(np.unique(self.person_id)) != n:
            raise ValueError(f"truth of frame {self.index} has a person twice")

    def at(self, index: int) -> Truth:
        """The same truth in frame `index`. It shares the arrays."""
        out = copy(self)
        object.__setattr__(out, "index", index)
        return out


def evaluated_people(truth: tuple[Truth, ...], period: float) -> list[Mask]:
    """Masks (m,) of each frame: the people seen by a camera with at least VISIBLE_FRACTION, in this frame or at most VISIBILITY_MEMORY before."""
    memory = round(VISIBILITY_MEMORY / period)
    last: dict[int, int] = {}
    out = []
    for frame in truth:
        for person, visible in zip(frame.person_id.tolist(), frame.visible, strict=True):
            if visible.size and visible.max() >= VISIBLE_FRACTION:
                last[person] = frame.index
        out.append(np.array([frame.index - last.get(p, -memory - 1) <= memory for p in frame.person_id.tolist()], dtype=bool))
    return out
