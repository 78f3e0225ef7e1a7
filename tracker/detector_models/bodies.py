"""True bodies in a view: the whole box of each, its visible part, and the features on which misses of a detector depend."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tracker.geometry import Array, Ints, Pose, set_array, set_ints
from tracker.geometry.cameras import Camera
from tracker.geometry.image_boxes import body_outlines, clipped

BODY = (1.75, 0.5)
"""m: height and width of the upright cylinder that stands for a body whose place alone is known."""
CELLS = (7, 14)
"""Sample points of a box, across and up, of which the hidden ones are counted."""
SILHOUETTE = 0.7
"""Share of the width of a box over which its body hides what is behind it."""
NEARER = 0.15
"""m by which a body must be nearer to hide another one."""
LEAST_IN_IMAGE = 0.25
"""Bodies of which a smaller share lies in the image are left out."""
MATCH = 0.3
"""Least IoU of a box with the true box, or with its visible part, of the person whom it shows."""
LEAST_VISIBLE = 0.02
"""A smaller visible share counts as none: misses of such bodies are not fitted to the features."""
OVERLAPS = (0.3, 0.5, 0.7)
"""Lower ends of the bins of overlap, the intersection of two true boxes over the smaller one, in which merges are counted."""
FEATURES = ("constant", "hidden", "mostly hidden", "size", "cut")
"""Features on which the probability of a miss depends: see `features_of`."""


@dataclass(frozen=True, eq=False)
class TrueBodies:
    """The bodies of n people of whom at least LEAST_IN_IMAGE is in one image.

    person (n,) ids. whole, seen (n, 4): left, top, right, bottom px of the whole body, also beyond the image, and of its visible part.
    visible (n,): share of the part in the image that nothing hides. cut (n,): share of the whole box beyond the image. distance (n,) m.
    """

    person: Ints
    whole: Array
    seen: Array
    visible: Array
    cut: Array
    distance: Array

    def __post_init__(self) -> None:
        n = len(self.person)
        set_ints(self, "person", (n,))
        for name, shape in (("whole", (n, 4)), ("seen", (n, 4)), ("visible", (n,)), ("cut", (n,)), ("distance", (n,))):
            set_array(self, name, shape)

    @property
    def height(self) -> Array:
        """Height (n,) px of the whole bodies: the unit of errors of edges."""
        return np.asarray(np.maximum(self.whole[:, 3] - self.whole[:, 1], 1.0))

    def features(self, image_height: int, sizes: tuple[float, float]) -> Array:
        """Features (n, 5), as features_of; image_height px."""
        return features_of(self.visible, np.log2(self.height / image_height), self.cut, sizes)

    def parts(self, camera: Camera) -> tuple[Array, Array]:
        """Edges (n, 4) px of the parts in the image, and of the visible parts; where nothing is visible, those in the image stand for them."""
        part = clipped(self.whole[:, :2], self.whole[:, 2:], camera)
        return part, np.where((self.seen[:, 2] > self.seen[:, 0])[:, None], self.seen, part)

    def placed(self, camera: Camera) -> tuple[Array, Array]:
        """Middles (n, 2) of the parts in the image, over its size, and log2 (n,) of body over image height."""
        part = self.parts(camera)[0]
        place = np.column_stack([part[:, [0, 2]].mean(axis=1) / camera.width, part[:, [1, 3]].mean(axis=1) / camera.height])
        return place, np.log2(self.height / camera.height)


def features_of(visible: Array, size: Array, cut: Array, sizes: tuple[float, float]) -> Array:
    """Features (n, 5) in the order of FEATURES. size (n,): log2 of body over image height, within the lowest and highest of `sizes`."""
    hidden = 1.0 - visible
    return np.column_stack([np.ones(len(hidden)), hidden, np.maximum(hidden - 0.5, 0.0), np.clip(size, *sizes), cut])


class Place(NamedTuple):
    """The pose T_world_camera of a camera, and the height of the ground below it, m."""

    pose: Pose
    ground: float


@dataclass(frozen=True, eq=False)
class SimulatedBoxes:
    """Boxes (n, 4) left, top, width, height px, confidences (n,), and the person (n,) of each; 0 for false boxes."""

    boxes: Array
    confidence: Array
    person: Ints


def outlined(camera: Camera, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Corners low and high (n, 2) px → edges (n, 4) px of the whole, edges of the part in the image, and share (n,) beyond the image."""
    whole, part = np.concatenate([low, high], axis=1), clipped(low, high, camera)
    area = np.maximum(np.prod(high - low, axis=1), 1e-9)
    cut = 1.0 - np.prod(np.maximum(part[:, 2:] - part[:, :2], 0.0), axis=1) / area
    return whole, part, np.clip(cut, 0.0, 1.0)


def bodies_in_view(
    view: tuple[Camera, Pose], person: Ints, feet: Array, pillars: Array, boxes: Array | None = None, heights: Mapping[int, float] | None = None
) -> TrueBodies:
    """The bodies of people at feet (n, 3) m, world, in a view (camera, T_world_camera).

    pillars (p, 5) as in Setup. boxes (n, 4): left, top, width, height px where true boxes are known; otherwise bodies are projected.
    heights: person → m, of those whose projected bodies are not of BODY.
    Bodies hide what is behind them over SILHOUETTE of the width of their boxes.
    """
    camera, pose = view
    if boxes is None:
        tall = np.array([(heights or {}).get(int(one), BODY[0]) for one in person])
        rows, low, high = body_outlines(camera, pose, feet, (tall, BODY[1]))
    else:
        rows, low, high = np.arange(len(person)), boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    whole, part, cut = outlined(camera, low, high)
    distance = np.linalg.norm(feet[rows] - pose.translation, axis=1)
    front, depth = _silhouettes(whole), distance
    if len(pillars):
        things, far = _pillar_boxes(camera, pose, pillars)
        front, depth = np.concatenate([front, things]), np.concatenate([depth, far])
    kept = np.flatnonzero(cut <= 1.0 - LEAST_IN_IMAGE)
    seen, visible = part[kept].copy(), np.ones(len(kept))
    for k, row in enumerate(kept.tolist()):
        nearer = front[depth < distance[row] - NEARER]
        if len(nearer):
            seen[k], visible[k] = _unhidden(part[row], nearer, camera)
    return TrueBodies(np.asarray(person)[rows[kept]], whole[kept], seen, visible, cut[kept], distance[kept])


def _silhouettes(whole: Array) -> Array:
    inset = (1.0 - SILHOUETTE) / 2 * (whole[:, 2] - whole[:, 0])
    return whole + np.column_stack([inset, 0 * inset, -inset, 0 * inset])


def _pillar_boxes(camera: Camera, pose: Pose, pillars: Array) -> tuple[Array, Array]:
    """Edges (m, 4) px of the pillars that the camera can project, and their distances (m,) m."""
    out, far = [np.zeros((0, 4))], [np.zeros(0)]
    for x, y, radius, bottom, top in pillars:
        foot = np.array([[x, y, bottom]])
        rows, low, high = body_outlines(camera, pose, foot, (top - bottom, 2 * radius))
        out.append(np.concatenate([low, high], axis=1))
        far.append(np.linalg.norm(foot[rows] - pose.translation, axis=1))
    return np.concatenate(out), np.concatenate(far)


def _unhidden(box: Array, nearer: Array, camera: Camera) -> tuple[Array, float]:
    """Edges (4,) px of the sample points of a box that no nearer box (m, 4) covers, and their share."""
    across, up = CELLS
    step = np.array([(box[2] - box[0]) / across, (box[3] - box[1]) / up])
    u, v = box[0] + step[0] * (np.arange(across) + 0.5), box[1] + step[1] * (np.arange(up) + 0.5)
    turn = 0.0
    if camera.wraps:
        turn = np.round(((box[0] + box[2]) / 2 - (nearer[:, 0] + nearer[:, 2]) / 2) / camera.width) * camera.width
    left, right = nearer[:, 0] + turn, nearer[:, 2] + turn
    columns = (u[None] > left[:, None]) & (u[None] < right[:, None])
    lines = (v[None] > nearer[:, 1, None]) & (v[None] < nearer[:, 3, None])
    free = ~(lines[:, :, None] & columns[:, None, :]).any(axis=0)
    if free.all() or not free.any():
        return (box, 1.0) if free.all() else (np.array([*box[:2], *box[:2]]), 0.0)
    rows, cols = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
    half = step / 2
    edges = np.array([u[cols[0]] - half[0], v[rows[0]] - half[1], u[cols[-1]] + half[0], v[rows[-1]] + half[1]])
    return edges, float(free.mean())


def intersections(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Areas px²: of the intersections (n, m) of boxes (n, 4) and (m, 4) px, of the first (n, 1), and of the second (1, m)."""
    low, high = np.maximum(first[:, None, :2], second[None, :, :2]), np.minimum(first[:, None, 2:], second[None, :, 2:])
    one, two = (np.maximum(np.prod(edges[:, 2:] - edges[:, :2], axis=1), 1e-9) for edges in (first, second))
    return np.prod(np.maximum(high - low, 0.0), axis=2), one[:, None], two[None]


def nearest_overlap(bodies: TrueBodies) -> tuple[Ints, Array]:
    """The nearer person (n,) whose box overlaps that of each person most, −1 for none, and the overlap (n,)."""
    if not len(bodies.person):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    common, one, two = intersections(bodies.whole, bodies.whole)
    shared = common / np.minimum(one, two)
    shared[bodies.distance[:, None] <= bodies.distance[None]] = 0.0
    other = np.argmax(shared, axis=1)
    most = shared[np.arange(len(other)), other]
    return np.where(most >= OVERLAPS[0], other, -1), most
