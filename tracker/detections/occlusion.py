"""Occlusion of people: which share of a body objects and other people cover, and how often a view detects it.

`Bodies` predicts for each view how often it detects people at given places. Where occluders are known, lines of sight to three points of a body are
cast. Elsewhere bodies and pillars are drawn as upright rectangles (`occluded_share`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.compilation import njit
from tracker.geometry.ground import Ground
from tracker.types import Setup

BOX_HALF_WIDTH, BODY_HEIGHT = 0.3, 1.75
"""m, half the width of the box around a body, and its height."""

BODY_HALF_WIDTH = 0.22
"""m, half the width over which a body occludes what is behind it."""
FRONT_HALF_WIDTH = 0.25
"""m, half the width over which a person in front may hide another."""

COLUMNS, ROWS = 9, 15
"""Sample points of a box, across and up."""

DEPTH_MARGIN = 0.15
"""m by which an occluding rectangle must be nearer than the body."""

POINT_HEIGHTS = (0.4, 1.0, 1.5)
"""m over the ground of the points of a body to which lines of sight are cast."""

DETECTED_BY_POINTS = np.array([0.09, 0.6, 1.0, 1.0])
"""Relative detection rate of a person of whom 0 to 3 of those points are visible, where occluders are known.

It is not 0 for none, since walls have holes that a map of tops lacks, and a visible head is often enough.
"""

DETECTED_BEHIND_PERSON = 0.6
"""Relative detection rate of a person behind another one where occluders are known (ruins, 10 people, seeds 20 to 35)."""

RAY_MARGIN = 0.3
"""m, an obstacle less than this in front of a point does not occlude it: places and maps have errors."""

SURE_MARGIN, NEAR = 0.5, 2.0
"""m. An obstacle that is nearer than the highest point by over SURE_MARGIN hides the lower points, too, where all are farther than NEAR."""

RelativeDetection = Callable[[str, Array], Array]
"""Name of a view, shares (n, 2) covered by objects and by people → detection rate (n,), relative to people in full view."""


class Viewpoint(NamedTuple):
    """A view at a tick: the name of its camera, the camera's model, and its pose T_world_camera."""

    name: str
    camera: Camera
    pose: Pose


class Bodies:
    """People at places (n, 2) m on the ground.

    tree (n,): ids; a person does not occlude itself. front (m,): the rows that may occlude others.
    relative_detection: learned rates of partly visible people, where occluders are not known.
    """

    def __init__(self, place: Array, tree: Ints, front: Ints, setup: Setup, relative_detection: RelativeDetection) -> None:
        self.feet = np.column_stack([place, setup.ground.height_at(place)])
        self.points = np.repeat(self.feet[:, None, :], len(POINT_HEIGHTS), axis=1)
        self.points[:, :, 2] += np.array(POINT_HEIGHTS)
        self.tree, self.front, self.setup, self.relative_detection = tree, front, setup, relative_detection

    def occluded(self, view: Viewpoint) -> Array:
        """Share (n, 2) of each body that pillars cover, and that other people cover."""
        return np.asarray(occluded_share(view.pose.translation, self.feet, self.tree, self.front, self.setup.pillars))

    def expected_detection(self, view: Viewpoint, reach: float, rows: Ints | None = None) -> Array:
        """Detection rate (r,) of bodies in a view, relative to people in full view; nobody is detected beyond `reach` m.

        rows (r,): of the bodies, by default all.
        """
        pose, occluders = view.pose, self.setup.occluders
        chosen: Any = slice(None) if rows is None else rows
        points, origin = self.points[chosen], pose.translation
        n = len(points)
        if not n:
            return np.zeros(0)
        rays = points.reshape(-1, 3) - origin
        distance = np.maximum(np.linalg.norm(rays, axis=1), 1e-6)
        direction = rays / distance[:, None]
        # Feet beyond the reach have no ground point, so that no box is taken there.
        inside = self._in_image(view, direction).reshape(n, -1) & (distance.reshape(n, -1)[:, :1] <= reach)
        if occluders is None:
            share = inside.mean(axis=1)
            return np.asarray(share * self.relative_detection(view.name, self.occluded(view)[chosen]) * (share > 0.5))
        behind = self._behind_people(origin)[chosen]
        visible = inside & ~_hidden(occluders, origin, direction.reshape(n, -1, 3), distance.reshape(n, -1), reach)
        return np.asarray(DETECTED_BY_POINTS[visible.sum(axis=1)] * inside.any(axis=1) * np.where(behind, DETECTED_BEHIND_PERSON, 1.0))

    def expected_by_view(self, views: list[Viewpoint], reach: float) -> Array:
        """`expected_detection` of all views, (n, v)."""
        return np.array([self.expected_detection(view, reach) for view in views]).reshape(len(views), len(self.points)).T.copy()

    def occluded_by_view(self, views: list[Viewpoint]) -> Array:
        """`occluded` of all views, (n, v, 2)."""
        return np.array([self.occluded(view) for view in views]).reshape(len(views), len(self.points), 2).transpose(1, 0, 2)

    def in_any_view(self, views: list[Viewpoint], rows: Ints) -> Mask:
        """Whether a part of each of the bodies `rows` (r,) is within the image of any view, occluded or not."""
        points, out = self.points[rows].reshape(-1, 3), np.zeros(len(rows), dtype=bool)
        for view in views if len(rows) else ():
            rays = points - view.pose.translation
            direction = rays / np.maximum(np.linalg.norm(rays, axis=1), 1e-6)[:, None]
            out |= self._in_image(view, direction).reshape(len(rows), len(POINT_HEIGHTS)).any(axis=1)
        return out

    def _in_image(self, view: Viewpoint, direction: Array) -> Mask:
        """Whether directions (n, 3) of the world are within the image, and the robot that carries the camera is not there."""
        bearings = direction @ view.pose.rotation
        inside = view.camera.pixels_from_bearings(bearings)[1]
        mount = self.setup.mounts.get(view.name)
        return inside if mount is None or mount.own_body is None else inside & ~mount.sees_itself(bearings)

    def _behind_people(self, origin: Array) -> Mask:
        """Which bodies (n,) have another person's body in front of them, seen from `origin` (3,) m."""
        chest = self.points[:, 1] - origin
        distance = np.maximum(np.linalg.norm(chest, axis=1), 1e-6)
        azimuth = np.arctan2(chest[:, 1], chest[:, 0])
        return np.asarray(_behind(azimuth, distance, self.tree, self.front, np.arctan(FRONT_HALF_WIDTH / distance[self.front])))


def _hidden(occluders: Ground, origin: Array, direction: Array, distance: Array, reach: float) -> Mask:
    """Which points (n, 3) of bodies are hidden, those of a body from the lowest up; direction (n, 3, 3) and distance (n, 3) m are of their rays.

    A ray to a higher point is above that to a lower one all the way. Therefore all points are visible where the lowest is, and all are hidden where
    the highest is. So other rays are cast for about half of the bodies only.
    """

    def blocked(rows: Ints, point: int) -> Array:
        """By how much an occluder is nearer than the points (r,) of bodies, m; −inf where there is none in front."""
        way = distance[rows, point]
        stop, stopped = occluders.intersect(np.broadcast_to(origin, (len(rows), 3)), direction[rows, point], reach, until=way)
        return np.where(stopped, way - np.linalg.norm(stop - origin, axis=1), -np.inf)

    margin = np.full(distance.shape, -np.inf)
    margin[:, 0] = blocked(np.arange(len(margin)), 0)
    near = distance.min(axis=1) < NEAR
    rest = np.flatnonzero((margin[:, 0] > 0) | near)
    margin[rest, 2] = blocked(rest, 2)
    surely = (margin[:, 2] > SURE_MARGIN) & ~near
    margin[surely, 1] = np.inf
    rest = rest[~surely[rest]]
    margin[rest, 1] = blocked(rest, 1)
    return margin > RAY_MARGIN


@njit(cache=True)
def _behind(azimuth: Array, distance: Array, tree: Ints, front: Ints, half: Array) -> Mask:
    """Which bodies (n,) have one of the rows `front` (m,), of another tree, in front of them, less than its `half` width (m,) rad apart."""
    out = np.zeros(len(azimuth), np.bool_)
    for i in range(len(azimuth)):
        for k in range(len(front)):
            j = front[k]
            if distance[j] < distance[i] - 0.3 and tree[j] != tree[i]:
                apart = abs(azimuth[i] - azimuth[j])
                if min(apart, 2 * math.pi - apart) < half[k]:
                    out[i] = True
                    break
    return out


@njit(cache=True)
def occluded_share(origin: Array, place: Array, tree: Ints, front: Ints, pillars: Array) -> Array:
    """Share (n, 2) of the boxes of people at `place` (n, 3) m that `pillars` cover, and that other people cover, seen from `origin` (3,) m.

    pillars (p, 5): as in Setup. Of the people only those in the rows `front` occlude, and only people of another tree (n,).
    """
    n, p = len(place), len(pillars)
    out, hidden = np.zeros((n, 2)), np.empty((ROWS, COLUMNS), np.bool_)
    rectangles = np.empty((p + len(front), 5))
    for j in range(p):
        rectangles[j] = _rectangle(origin, pillars[j, 0], pillars[j, 1], pillars[j, 2], pillars[j, 3], pillars[j, 4])
    for j in range(len(front)):
        x, y, z = place[front[j]]
        rectangles[p + j] = _rectangle(origin, x, y, BODY_HALF_WIDTH, z, z + BODY_HEIGHT)
    for i in range(n):
        x, y, z = place[i]
        body = _rectangle(origin, x, y, BOX_HALF_WIDTH, z, z + BODY_HEIGHT)
        hidden[:] = False
        some = False
        for j in range(len(rectangles)):
            if j == p and some:
                out[i, 0] = hidden.mean()
                hidden[:] = False
                some = False
            if j < p or tree[front[j - p]] != tree[i]:
                some |= _mark_hidden(rectangles[j], body, hidden)
        if some:
            out[i, 0 if len(rectangles) == p else 1] = hidden.mean()
    return out


@njit(cache=True)
def _rectangle(origin: Array, x: float, y: float, half: float, low: float, high: float) -> Array:
    """An upright rectangle as seen (5,): distance m, azimuth and half the width in rad, tangents of the elevations of the lower and upper edge."""
    dx, dy = x - origin[0], y - origin[1]
    distance = max(math.hypot(dx, dy), 0.1)
    return np.array([distance, math.atan2(dy, dx), math.atan2(half, distance), (low - origin[2]) / distance, (high - origin[2]) / distance])


@njit(cache=True)
def _mark_hidden(rectangle: Array, body: Array, hidden: Mask) -> bool:
    """Mark the sample points of `body` that `rectangle` covers, in place; returns whether it may cover any."""
    apart = rectangle[1] - body[1]
    apart -= 2 * math.pi * math.floor(apart / (2 * math.pi) + 0.5)
    if rectangle[0] > body[0] - DEPTH_MARGIN or abs(apart) >= body[2] + rectangle[2]:
        return False
    for row in range(ROWS):
        if rectangle[3] < body[3] + (body[4] - body[3]) * (row + 0.5) / ROWS < rectangle[4]:
            for column in range(COLUMNS):
                hidden[row, column] |= abs(body[2] * (2 * (column + 0.5) / COLUMNS - 1) - apart) < rectangle[2]
    return True
