"""Boxes of upright people as a function of a camera's parameters: the measurement model of the adjustment.

A body stands at a place on the ground. The lower edge of its box is at its nearest point on the ground. The upper edge is at the far side of the
head for a higher camera, else at the near side. The middle column lies between the outermost points of feet and head: bodies lean near the border.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, LensCamera, Pinhole

NAMES = ("focal", "cx", "cy", "k1", "pitch", "roll", "yaw", "x", "y", "height", "offset")
"""Parameters of a camera. focal: logarithm of the focal length over its first value. cx, cy: shift of the principal point over the image's width.
pitch (down), roll, yaw: rad. x, y: m. height: logarithm of the height above the ground in m. offset: s to add to the times of its clock."""
FOCAL, CX, CY, K1, PITCH, ROLL, YAW, X, Y, HEIGHT, OFFSET = range(len(NAMES))
BODY_WIDTH = 0.5
"""m."""
GLOBALS = ("foot", "head", "stature", "side", "top", "bottom")
"""Of all bodies. foot: m from the middle to the nearest point on the ground. head: m to the point that the upper edge touches. Mean stature, m.
side: bias of the middle of boxes to the right. top, bottom: bias of these edges downwards. All three are shares of a box's height."""
EDGES = slice(GLOBALS.index("side"), len(GLOBALS))
MEAN_STATURE = GLOBALS.index("stature")
OF_BOXES = tuple(k for k in range(len(GLOBALS)) if k != MEAN_STATURE)
"""Those of GLOBALS that boxes depend on; the mean stature is in the prior of statures alone."""
MOST_BENT = 0.13
"""Largest shift of the corners of an image inwards by k1, as a share of their distance from the middle; at 4/27 the image folds."""
LEAST_DEPTH = 0.05
"""m: points with less depth have no pixel."""


def pose_of(row: Array) -> Pose:
    """T_world_camera of the parameters (11,) of a camera."""
    return Pose(rotation_of(float(row[PITCH]), float(row[ROLL]), float(row[YAW])), np.array([row[X], row[Y], np.exp(row[HEIGHT])]))


def rotation_of(pitch: float, roll: float, yaw: float = 0.0) -> Array:
    """World from camera (3, 3): turned by `roll` about its axis, then down by `pitch`, then by `yaw` about the vertical."""
    (cp, sp), (cr, sr), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (pitch, roll, yaw))
    turned = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    down = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(turned @ down @ about)


def angles_of(rotation: Array) -> tuple[float, float, float]:
    """Pitch, roll and yaw, rad, with rotation_of(pitch, roll, yaw) = rotation."""
    ahead = rotation[:, 0]
    pitch, yaw = float(-np.arcsin(np.clip(ahead[2], -1, 1))), float(np.arctan2(ahead[1], ahead[0]))
    return pitch, float(np.arctan2(rotation[2, 1], rotation[2, 2])), yaw


def lens_of(camera: Camera, row: Array) -> Camera:
    """The camera with the focal length, principal point and k1 of its parameters (11,)."""
    if not isinstance(camera, LensCamera) or not row[:PITCH].any():
        return camera
    return _lens(camera, *row[:PITCH].tolist())


@lru_cache(maxsize=256)
def _lens(camera: LensCamera, focal: float, cx: float, cy: float, k1: float) -> LensCamera:
    """As lens_of. Cached, because the checks of a lens cost as much as the projection of some hundred points."""
    factor, width = float(np.exp(focal)), camera.width
    moved = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor, cx=camera.cx + cx * width, cy=camera.cy + cy * width)
    if isinstance(camera, Pinhole) and k1:
        k1 = max(k1, -MOST_BENT / corner_of(moved) ** 2)
        moved = replace(moved, distortion=(camera.distortion[0] + k1, *camera.distortion[1:]))  # type: ignore[call-arg]
    return moved


def corner_of(lens: LensCamera) -> float:
    """Distance of the farthest corner of the image from the principal point, over the focal length."""
    return float(np.hypot(max(lens.cx, lens.width - lens.cx) / lens.fx, max(lens.cy, lens.height - lens.cy) / lens.fy))


def boxes_of(camera: Camera, row: Array, place: Array, stature: Array, body: Array) -> Array:
    """Middle column, upper and lower edge (n, 3) px of people at places (n, 2) m with statures (n,) m; NaN where there is no box.

    body: distances `foot` and `head` of GLOBALS.
    """
    lens, R, high = lens_of(camera, row), rotation_of(float(row[PITCH]), float(row[ROLL]), float(row[YAW])), float(np.exp(row[HEIGHT]))
    away = place - row[[X, Y]]
    if camera.wraps:
        ahead = away / np.maximum(np.hypot(*away.T), 1e-6)[:, None]
    else:
        # A row of a pinhole image is a line on the ground across the optical axis.
        ahead = np.broadcast_to(R[:2, 0] / max(float(np.hypot(*R[:2, 0])), 1e-6), away.shape)
    left = np.column_stack([-away[:, 1], away[:, 0]]) / np.maximum(np.hypot(*away.T), 1e-6)[:, None] * (BODY_WIDTH / 2)
    foot, head = body[0], body[1] * np.tanh((high - stature) / 0.1)[:, None]
    ground, top = np.full(len(place), -high), stature - high
    at = [(away - foot * ahead, ground), (away + head * ahead, top), *((away + side * left, z) for z in (ground, top) for side in (-1, 1))]
    points = np.concatenate([np.column_stack([xy, z]) for xy, z in at]) @ R
    near = (points[:, 0] < LEAST_DEPTH) if isinstance(camera, LensCamera) else np.zeros(len(points), dtype=bool)
    pixels = lens.pixels_from_bearings(points / np.maximum(np.linalg.norm(points, axis=1), 1e-9)[:, None])[0]
    pixels[near] = np.nan
    pixels = pixels.reshape(6, -1, 2)
    u = pixels[2:, :, 0]
    if camera.wraps:
        u = pixels[0, :, 0] + np.mod(u - pixels[0, :, 0] + camera.width / 2, camera.width) - camera.width / 2
    return np.column_stack([(u.min(axis=0) + u.max(axis=0)) / 2, pixels[1, :, 1], pixels[0, :, 1]])


def ground_places(camera: Camera, row: Array, box: Array, foot: float) -> Array:
    """Places (n, 2) m of the people with boxes (n, 3): middle, top and bottom px, the inverse of boxes_of; NaN above the horizon."""
    middle, top, bottom = box.T
    lens, R, high = lens_of(camera, row), rotation_of(float(row[PITCH]), float(row[ROLL]), float(row[YAW])), float(np.exp(row[HEIGHT]))
    lean = lean_of(lens, R, middle, top, bottom)
    ray = lens.bearings_from_pixels(np.column_stack([middle + lean, bottom])) @ R.T
    below = ray[:, 2] < -1e-3
    away = ray[:, :2] * (high / np.where(below, -ray[:, 2], 1.0))[:, None]
    if camera.wraps:
        away = away * (1 + foot / np.maximum(np.hypot(*away.T), 1e-6))[:, None]
    else:
        away = away + foot * R[:2, 0] / max(float(np.hypot(*R[:2, 0])), 1e-6)
    return np.asarray(np.where(below[:, None], away + row[[X, Y]], np.nan))


def lean_of(lens: Camera, R: Array, middle: Array, top: Array, bottom: Array) -> Array:
    """Offset (n,) px of feet to the right of the middle columns of boxes, because verticals lean in the image. R (3, 3): world from camera."""
    if lens.wraps:
        return np.zeros(len(middle))
    centre = np.column_stack([middle, (top + bottom) / 2])
    down = lens.bearings_from_pixels(centre) - 0.02 * R[2]
    along = lens.pixels_from_bearings(down / np.linalg.norm(down, axis=1, keepdims=True))[0] - centre
    with np.errstate(invalid="ignore", divide="ignore"):
        lean = along[:, 0] / along[:, 1] * (bottom - top) / 2
    return np.where(np.isfinite(lean) & (along[:, 1] > 1e-6), np.clip(lean, -(bottom - top), bottom - top), 0.0)
