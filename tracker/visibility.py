"""What a view could have seen of a person: inside the image, not behind what stands there, not behind somebody else."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Camera
from tracker.cover import covered
from tracker.geometry import Array, Pose, angles_from_bearing, wrap
from tracker.measurements import Ints, Setup

Mask = NDArray[np.bool_]

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
        return np.asarray(covered(view.pose.translation, self.feet, self.tree, self.front, self.setup.pillars))

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
