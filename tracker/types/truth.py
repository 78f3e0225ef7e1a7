"""The ground truth of a frame: poses of the robots, people, their boxes and their key points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, Pose, frozen, set_array, set_ints

KEYPOINT_NAMES = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
"""The order of key points (Lin et al. 2014, COCO)."""

HIDDEN, VISIBLE = 1, 2
"""Visibility of a key point as COCO has it (Lin et al. 2014); 0 is not in the image."""

KEYPOINT_COUNT = len(KEYPOINT_NAMES)


@dataclass(frozen=True, eq=False)
class Boxes:
    """True boxes of n people: person (n,) ids; seen, full (n, 4) left, top, right, bottom px of what is seen and of the whole body.

    In a panorama right may pass the width, where a body lies over the seam; in other cameras full ends at the image's edge. seen is zero for
    who is hidden. visible (n,): pixels seen over the pixels that the person would cover alone. range (n,) m from the camera to the middle
    between the hips.
    """

    person: Ints
    seen: Array
    full: Array
    visible: Array
    range: Array

    def __post_init__(self) -> None:
        n = len(self.person)
        object.__setattr__(self, "person", _whole(self.person, (n,)))
        for name, shape in (("seen", (n, 4)), ("full", (n, 4)), ("visible", (n,)), ("range", (n,))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))

    @staticmethod
    def none() -> Boxes:
        return Boxes(np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The 17 key points of COCO of n people in one image: person (n,); pixels (n, 17, 2) u, v, zero where not in the image;
    visibility (n, 17): 2 visible, 1 hidden by something or by the own body, 0 not in the image.
    """

    person: Ints
    pixels: Array
    visibility: Ints

    def __post_init__(self) -> None:
        n = len(self.person)
        object.__setattr__(self, "person", _whole(self.person, (n,)))
        object.__setattr__(self, "pixels", frozen(self.pixels, (n, KEYPOINT_COUNT, 2), "pixels"))
        object.__setattr__(self, "visibility", _whole(self.visibility, (n, KEYPOINT_COUNT)))

    @staticmethod
    def none() -> Keypoints:
        return Keypoints(np.zeros(0, dtype=np.int64), np.zeros((0, KEYPOINT_COUNT, 2)), np.zeros((0, KEYPOINT_COUNT), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class ViewTruth:
    """One camera at one moment: T_world_camera; ground m, the height of the terrain straight below, and its unit normal (3,); the people."""

    T_world_camera: Pose
    ground: float
    normal: Array
    boxes: Boxes
    keypoints: Keypoints

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", frozen(self.normal, (3,), "normal"))


def _whole(value: NDArray[np.int64], shape: tuple[int, ...]) -> Ints:
    array = np.array(value, dtype=np.int64)
    if array.shape != shape:
        raise ValueError(f"whole numbers have shape {array.shape}, need {shape}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Truth:
    """What was so at one tick. T_world_robot a robot; person_id (m,); feet (m, 3) m: the ground under the middle of the body;
    visible (m, cameras): pixels seen over the pixels that the person would cover alone, in [0, 1], cameras in the order of Setup.mounts.
    joints (m, 17, 3) m: the key points of COCO (layout.KEYPOINT_NAMES), or None where they were not read (annotations.read_joints reads them).
    tipped: the robots that have tipped over: their odometry and panoramas are still there, but nobody should expect much of them.
    """

    index: int
    T_world_robot: dict[str, Pose]
    person_id: Ints
    feet: Array
    visible: Array
    joints: Array | None = None
    tipped: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        n = len(self.person_id)
        if not self.tipped <= set(self.T_world_robot):
            raise ValueError(f"tipped is {sorted(self.tipped)}, needs robots of {sorted(self.T_world_robot)}")
        set_ints(self, "person_id", n)
        set_array(self, "feet", (n, 3))
        set_array(self, "visible", (n, None))
        if self.joints is not None:
            set_array(self, "joints", (n, 17, 3))
        if len(np.unique(self.person_id)) != n:
            raise ValueError(f"truth of frame {self.index} has a person twice")
