"""The truth of a view: boxes of the visible and of the whole bodies from instance images, and key points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.rendering.coverage import UnoccludedExtent, bounding_box
from sim.sensors.keypoints import InstanceImage, true_keypoints
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.compilation import njit
from tracker.types import KEYPOINT_NAMES, Boxes, Keypoints, ViewTruth
from worlds.world import World

HIPS = [KEYPOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]
"""Indices of the hips among the key points."""


@dataclass(frozen=True, eq=False)
class People:
    """The people who are present: person (m,) ids; joints (m, 17, 3) m, world, in the order of KEYPOINT_NAMES."""

    person: Ints
    joints: Array


def seen_people(image: InstanceImage, people: People, unoccluded: Sequence[UnoccludedExtent]) -> tuple[Boxes, Keypoints]:
    """True boxes and key points of the people in a view. unoccluded (m,): extent of each person without occlusion."""
    boxes = true_boxes(image, people, unoccluded)
    shown = np.flatnonzero([body.pixels > 0 for body in unoccluded])
    return boxes, true_keypoints(image, people.person[shown], people.joints[shown]) if len(shown) else Keypoints.none()


def truth_above(world: World, T_world_camera: Pose, boxes: Boxes, keypoints: Keypoints) -> ViewTruth:
    """Truth of a view with these people, with the ground below the camera."""
    below = T_world_camera.translation[None]
    ground, normal = world.terrain.height_at(below), world.terrain.normal_at(below)
    return ViewTruth(T_world_camera, float(ground[0]), normal[0], boxes, keypoints)


def true_boxes(image: InstanceImage, people: People, unoccluded: Sequence[UnoccludedExtent]) -> Boxes:
    """True boxes of all people who are in the image or would be without occlusion.

    unoccluded (m,): extent of each person without occlusion. In a panorama a box across the seam has left in [0, W) and right > W.
    visible: visible pixels over unoccluded pixels. People without an unoccluded pixel are left out.
    """
    present = people.person.tolist()
    pixels, rows, used = _extents(image.instances, _slots(present), len(present))
    kept, seen, visible = [], [], []
    for k, (_, body) in enumerate(zip(present, unoccluded, strict=True)):
        if not body.pixels:
            continue
        kept.append(k)
        seen.append(bounding_box(rows[k], used[k], image.camera.wraps) if pixels[k] else np.zeros(4))
        visible.append(pixels[k] / body.pixels)
    return boxes_of(people, kept, image.T_world_camera.translation, (seen, [unoccluded[k].box for k in kept], visible))


def boxes_of(people: People, kept: list[int], eye: Array, found: tuple[list[Array], list[Array], list[float]]) -> Boxes:
    """The boxes of the people at the places `kept`. eye (3,) m: the camera. found: the seen and the full box, and the visible share, of each."""
    if not kept:
        return Boxes.none()
    seen, full, visible = map(np.array, found)
    middle = people.joints[kept][:, HIPS].mean(axis=1)
    return Boxes(people.person[kept], seen, full, visible, np.linalg.norm(middle - eye, axis=1))


def _slots(persons: list[int]) -> NDArray[np.int64]:
    """Table (65536,) from an instance to its place among `persons`, −1 for others."""
    slots = np.full(1 << 16, -1)
    slots[persons] = np.arange(len(persons))
    return slots


@njit(cache=True)
def _extents(instances, slots, count):  # type: ignore[no-untyped-def]
    """Pixels (count,), first and last row (count, 2), and used columns (count, W) of the instances (H, W)."""
    height, width = instances.shape
    pixels, rows, columns = np.zeros(count, np.int64), np.zeros((count, 2), np.int64), np.zeros((count, width), np.bool_)
    for i in range(height):
        for j in range(width):
            instance = instances[i, j]
            if instance == 0:
                continue
            k = slots[instance]
            if k < 0:
                continue
            if pixels[k] == 0:
                rows[k, 0] = i
            rows[k, 1] = i
            pixels[k] += 1
            columns[k, j] = True
    return pixels, rows, columns
