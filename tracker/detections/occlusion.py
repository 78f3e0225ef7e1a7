"""How much of somebody things and other people lie over, as a camera sees it, by drawing bodies as upright rectangles.

What a view could have seen of a person: inside the image, not behind what stands there, not behind somebody else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from tracker.geometry import Array, Ints, Mask, Pose, angles_from_bearing, wrap
from tracker.geometry.cameras import Camera
from tracker.types import Setup

HALF, TALL = 0.3, 1.75
"""m: half the width of the box that a body fills, and its height ..."""

SLIM = 0.22
"""... and half the width over which a body hides what is behind it."""

ACROSS, UP = 9, 15
"""Points of a box that are looked at."""

BEFORE = 0.15
"""m, by which what hides somebody is nearer."""


@njit(cache=True)
def occluded_share(origin: Array, place: Array, tree: Ints, front: Ints, pillars: Array) -> Array:
    """Share (n, 2) of the boxes of people who stand at `place` (n, 3) m, seen from `origin` (3,) m, that `pillars` (p, 5; as in Setup) lie over, and
    that the people in the rows `front` do who are of another tree (n,)."""
    n, p = len(place), len(pillars)
    out, hidden = np.zeros((n, 2)), np.empty((UP, ACROSS), np.bool_)
    things = np.empty((p + len(front), 5))
    for j in range(p):
        things[j] = _seen(origin, pillars[j, 0], pillars[j, 1], pillars[j, 2], pillars[j, 3], pillars[j, 4])
    for j in range(len(front)):
        x, y, z = place[front[j]]
        things[p + j] = _seen(origin, x, y, SLIM, z, z + TALL)
    for i in range(n):
        x, y, z = place[i]
        body = _seen(origin, x, y, HALF, z, z + TALL)
        hidden[:] = False
        some = False
        for j in range(len(things)):
            if j == p and some:
                out[i, 0] = hidden.mean()
                hidden[:] = False
                some = False
            if j < p or tree[front[j - p]] != tree[i]:
                some |= _draw(things[j], body, hidden)
        if some:
            out[i, 0 if len(things) == p else 1] = hidden.mean()
    return out


@njit(cache=True)
def _seen(origin: Array, x: float, y: float, half: float, low: float, high: float) -> Array:
    """(5,): distance m, azimuth and half the width in rad, and tangents of the elevations of the lower and the upper edge."""
    dx, dy = x - origin[0], y - origin[1]
    far = max(math.hypot(dx, dy), 0.1)
    return np.array([far, math.atan2(dy, dx), math.atan2(half, far), (low - origin[2]) / far, (high - origin[2]) / far])


@njit(cache=True)
def _draw(thing: Array, body: Array, hidden: Mask) -> bool:
    """Mark the points of `body` that `thing` lies over, in place; whether it may lie over any."""
    apart = thing[1] - body[1]
    apart -= 2 * math.pi * math.floor(apart / (2 * math.pi) + 0.5)
    if thing[0] > body[0] - BEFORE or abs(apart) >= body[2] + thing[2]:
        return False
    for row in range(UP):
        if thing[3] < body[3] + (body[4] - body[3]) * (row + 0.5) / UP < thing[4]:
            for column in range(ACROSS):
                hidden[row, column] |= abs(body[2] * (2 * (column + 0.5) / ACROSS - 1) - apart) < thing[2]
    return True


HEIGHTS = (0.4, 1.0, 1.5)
"""Metres over the ground of the points of a body that are looked for."""

BEHIND = 0.2
"""How often a person is seen who walks behind another, where that is not learned."""

SHOWN = np.array([0.09, 0.6, 1.0, 1.0])
"""Where things that hide people are known: how often people get a box of whom none, one, two or all of those points are free, of those who are in
full view: walls have holes of which a map of tops does not know, and heads are enough ..."""

BESIDE = 0.6
"""... and how often one who walks behind another does: who stands a little beside shows (ruins, ten people, seeds 20 to 35)."""

MARGIN = 0.3
"""m, an obstacle nearer than this before a point does not hide it: places and maps have errors."""


class Viewpoint(NamedTuple):
    """From where a view looks: the name of its camera, the camera's model, and T_world_camera."""

    name: str
    camera: Camera
    pose: Pose


Shown = Callable[[str, Array], Array]
"""How often (n,) the view of a name has a box of people of whom things and others cover so much (n, 2), of those whom it has in full view."""


class Bodies:
    """People at places (n, 2) m: whether somebody sees them. tree (n,) says who is who, front (m,) which rows may hide others; shown: what is known
    of views of who is covered, None where that is not learned."""

    def __init__(self, place: Array, tree: Ints, front: Ints, setup: Setup, shown: Shown | None = None) -> None:
        self.feet = np.column_stack([place, setup.ground.height_at(place)])
        self.points = np.repeat(self.feet[:, None, :], len(HEIGHTS), axis=1)
        self.points[:, :, 2] += np.array(HEIGHTS)
        self.tree, self.front, self.setup, self.shown = tree, front, setup, shown

    def cover(self, view: Viewpoint) -> Array:
        """Share (n, 2) of each body that pillars lie over, and that others do."""
        return np.asarray(occluded_share(view.pose.translation, self.feet, self.tree, self.front, self.setup.pillars))

    def expected(self, view: Viewpoint, reach: float) -> Array:
        """How often the view has a box of each body (n,), of those whom it has in full view; occluders are known up to `reach` m."""
        camera, pose, occluders = view.camera, view.pose, self.setup.occluders
        n, origin = len(self.points), pose.translation
        if not n:
            return np.zeros(0)
        sight = self.points.reshape(-1, 3) - origin
        distance = np.maximum(np.linalg.norm(sight, axis=1), 1e-6)
        direction = sight / distance[:, None]
        inside = camera.pixels_from_bearings(direction @ pose.rotation)[1].reshape(n, -1)
        if occluders is None and self.shown is not None:
            share = inside.mean(axis=1)
            return np.asarray(share * self.shown(view.name, self.cover(view)) * (share > 0.5))
        behind = self._shadowed(origin, distance.reshape(n, -1)[:, 1])
        if occluders is None:
            share = inside.mean(axis=1)
            return np.asarray(share * np.where(behind, BEHIND, 1.0) * (share > 0.5))
        stop, stopped = occluders.intersect(np.broadcast_to(origin, direction.shape), direction, reach)
        free = inside & ~(stopped & (np.linalg.norm(stop - origin, axis=1) < distance - MARGIN)).reshape(n, -1)
        return np.asarray(SHOWN[free.sum(axis=1)] * inside.any(axis=1) * np.where(behind, BESIDE, 1.0))

    def by_view(self, views: list[Viewpoint], reach: float) -> Array:
        """`expected` of all views, (n, v)."""
        return np.array([self.expected(view, reach) for view in views]).reshape(len(views), len(self.points)).T

    def covers(self, views: list[Viewpoint]) -> Array:
        """`cover` of all views, (n, v, 2)."""
        return np.array([self.cover(view) for view in views]).reshape(len(views), len(self.points), 2).transpose(1, 0, 2)

    def watched(self, views: list[Viewpoint]) -> Mask:
        """Whether each body (n,) is `inside` the image of any view."""
        out = np.zeros(len(self.points), dtype=bool)
        for view in views:
            out |= self.inside(view)
        return out

    def inside(self, view: Viewpoint) -> Mask:
        """Whether a part of each body (n,) is in the image of the view, hidden or not."""
        camera, pose = view.camera, view.pose
        sight = self.points.reshape(-1, 3) - pose.translation
        direction = sight / np.maximum(np.linalg.norm(sight, axis=1), 1e-6)[:, None]
        _, visible = camera.pixels_from_bearings(direction @ pose.rotation)
        return np.asarray(visible.reshape(len(self.points), len(HEIGHTS)).any(axis=1))

    def _shadowed(self, origin: Array, distance: Array, half_width: float = 0.25) -> Mask:
        """Which bodies (n,) have another's in front of them, seen from `origin`; distance (n,) m to the chest."""
        azimuth, _ = angles_from_bearing(self.points[:, 1] - origin)
        front = self.front
        apart = np.abs(wrap(azimuth[:, None] - azimuth[None, front]))
        nearer = distance[None, front] < distance[:, None] - 0.3
        other = self.tree[:, None] != self.tree[None, front]
        return np.asarray((nearer & other & (apart < np.arctan(half_width / distance[front])[None, :])).any(axis=1))
