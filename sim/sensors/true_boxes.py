"""The truth of a view: boxes of the visible and of the whole bodies from instance images, and key points with their visibility.

Joints lie inside the body. A joint is visible if the surface in front of it is nearer by no more than the thickness of its limb.
A joint behind the trunk is farther behind the visible surface than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.rendering.coverage import UnoccludedExtent, bounding_box
from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.compilation import njit
from tracker.types import HIDDEN, KEYPOINT_NAMES, VISIBLE, Boxes, Keypoints, ViewTruth
from worlds.world import World

DEPTH_IN_BODY = {"nose": 0.05, "eye": 0.06, "ear": 0.07, "shoulder": 0.12, "elbow": 0.08, "wrist": 0.07, "hip": 0.17, "knee": 0.10, "ankle": 0.10}
"""m: largest depth of a joint behind the surface of the body, clothes included."""
DEPTH_MARGIN = 0.05
"""m: largest distance of the surface in a neighbouring pixel behind a joint."""
_DEPTHS = np.array([DEPTH_IN_BODY[name.split("_")[-1]] for name in KEYPOINT_NAMES])
HIPS = [KEYPOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]
"""Indices of the hips among the key points."""


@dataclass(frozen=True, eq=False)
class InstanceImage:
    """Instances (H, W), 0 for nobody, and range (H, W) m along the ray, of a camera at T_world_camera."""

    camera: Camera
    T_world_camera: Pose
    instances: NDArray[np.uint16]
    range: NDArray[np.float32]


def image_points(camera: Camera, T_world_camera: Pose, points: Array) -> tuple[Array, Mask]:
    """Project points (n, 3) m, world, to pixels (n, 2) from the image's corner, and tell which are in the image. Others may be NaN."""
    pixels, _ = camera.pixels_from_bearings(T_world_camera.inverse().apply(points))
    pixels = pixels + (0.5 - camera.pixel_centre)
    with np.errstate(invalid="ignore"):
        inside = np.asarray((pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1))
    return pixels, inside


def true_keypoints(image: InstanceImage, persons: Ints, joints: Array) -> Keypoints:
    """Key points of people with ids persons (m,) and joints (m, 17, 3) m, world."""
    m, k = joints.shape[:2]
    points = joints.reshape(-1, 3)
    pixels, inside = image_points(image.camera, image.T_world_camera, points)
    pixels[~inside] = 0.0
    distance = np.linalg.norm(points - image.T_world_camera.translation, axis=1)
    depth = np.broadcast_to(_DEPTHS, (m, k)).ravel()
    shown = _unoccluded(image, pixels, np.repeat(persons, k), distance, depth)
    visibility = np.where(inside, np.where(shown, VISIBLE, HIDDEN), 0)
    return Keypoints(persons, pixels.reshape(m, k, 2), visibility.reshape(m, k))


def _unoccluded(image: InstanceImage, pixels: Array, owner: Ints, distance: Array, depth: Array) -> Mask:
    """Mask (n,) of joints without an occluder that lie on their owner's surface, in the pixel itself or a neighbouring one."""
    height, width = image.instances.shape
    column, row = np.floor(pixels).astype(np.int64).T
    beside = np.zeros(len(pixels), dtype=bool)
    for across in (-1, 0, 1):
        for down in (-1, 0, 1):
            u = column + across
            u = u % width if image.camera.wraps else np.clip(u, 0, width - 1)
            v = np.clip(row + down, 0, height - 1)
            surface = image.range[v, u]
            beside |= (image.instances[v, u] == owner) & (surface > distance - depth) & (surface < distance + depth + DEPTH_MARGIN)
    clear = image.range[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] > distance - depth
    return np.asarray(clear & beside)


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
    """The boxes of the people at the indices `kept`. eye (3,) m: the camera. found: the seen and the full box, and the visible share, of each."""
    if not kept:
        return Boxes.none()
    seen, full, visible = map(np.array, found)
    middle = people.joints[kept][:, HIPS].mean(axis=1)
    return Boxes(people.person[kept], seen, full, visible, np.linalg.norm(middle - eye, axis=1))


def _slots(persons: list[int]) -> NDArray[np.int64]:
    """Table (65536,) from an instance to its index in `persons`, −1 for others."""
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
