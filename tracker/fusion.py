"""From boxes to feet on the ground, and from views to places.

A box says where the feet are only if the feet are in it. `stand` marks those whose lower edge may be an occluder's edge: nearer boxes
over it, a wall or a table just under the line of sight, or ground that falls away there, and says how likely that is: most such boxes
end at the feet all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array, Pose, angles_from_bearing, bearing_from_angles, skew, tangent_basis, wrap
from tracker.measurements import Detections, Mount, Setup

Mask = NDArray[np.bool_]

EDGE = np.linspace(-0.9, 0.9, 9)
"""Places along a box's lower edge, from its middle in half widths, at which is looked for what lies over it."""
ALONG = np.linspace(0.0, 1.0, 12)
"""Places along a line of sight, between where it may meet the ground at the nearest and at the farthest."""


@dataclass(frozen=True)
class FusionParameters:
    """What is assumed of boxes and feet."""

    foot_spread: float = 0.25  # m, the lowest point of a walking body strays this far from the ground under its middle
    reach: float = 60.0  # m, feet farther away are not believed
    edge: float = 0.012  # rad, an occluder this near under the lower edge may hide the feet
    fall: float = 0.2  # m, ground that falls away by more than this within `edge` of the lower edge may hide the feet
    covered: float = 0.3  # share of a lower edge that nearer boxes lie over, from which these may hide the feet
    lying: tuple[float, float, float, float] = (0.03, 0.6, 0.2, 0.6)  # how often boxes end above the feet: nothing, people, things, more before them
    doubtful: float = 0.3  # boxes that end above the feet more often start nobody ...
    near: float = 0.5  # m, and those with something before them only where the place is so sure (standard deviation)
    gate: float = 3.5  # standard deviations between two feet of one person


@dataclass(frozen=True, eq=False)
class Feet:
    """The boxes of one view in the world.

    origin (3,) m and direction (n, 3): line of sight to the feet; covariance (n, 2, 2) rad² in its tangent plane, pose included.
    point (n, 3) m and spread (n, 2, 2) m²: where it meets the ground, and how surely. height (n,) m of the box standing there.
    head_elevation (n,) rad above the horizon of the box's upper edge. grounded (n,): there is a point and it is near enough.
    hidden (n,): the feet may be out of sight, walled (n,): behind things, the ground or the image's edge; lying (n,): how often such a box ends
    above the feet. confidence (n,).
    links: what images say of the boxes of the last frames and these (tracklets.Tracklets.step); None where they are not looked at.
    """

    camera: str
    origin: Array
    direction: Array
    covariance: Array
    point: Array
    spread: Array
    height: Array
    head_elevation: Array
    grounded: Mask
    hidden: Mask
    walled: Mask
    lying: Array
    confidence: Array
    links: tuple[Array, ...] | None = None

    def __len__(self) -> int:
        return len(self.direction)


def stand(setup: Setup, camera: str, detections: Detections, pose: tuple[Pose, Array], parameters: FusionParameters) -> Feet:
    """Bring the boxes of `camera` on a robot at `pose` (T_world_robot, covariance (6, 6) of its right tangent) to the ground."""
    mount = setup.mounts[camera]
    T_world_camera = pose[0] @ mount.T_body_camera
    middle = detections.bearing @ T_world_camera.rotation.T
    azimuth, elevation = angles_from_bearing(middle)
    half = detections.extent[:, 1] / 2
    foot, head = bearing_from_angles(azimuth, elevation - half), bearing_from_angles(azimuth, elevation + half)
    origin = T_world_camera.translation
    origins = np.broadcast_to(origin, foot.shape)
    point, grounded = setup.ground.intersect(origins, foot, parameters.reach)
    distance = np.hypot(*(point - origin)[:, :2].T)
    height = origin[2] - point[:, 2] + distance * np.tan(angles_from_bearing(head)[1])
    covariance = detections.covariance + _pose_in_sight(foot, np.where(grounded, np.linalg.norm(point - origin, axis=1), 10.0), mount, pose)
    spread = _spread_on_ground(foot, point - origin, covariance) + parameters.foot_spread**2 * np.eye(2)
    lowered = bearing_from_angles(azimuth, elevation - half - parameters.edge)
    people, covered = _behind_people(elevation - half, azimuth, detections, parameters)
    things = _behind_things(setup, origin, lowered, point, parameters)
    cut = ~mount.camera.pixels_from_bearings(lowered @ T_world_camera.rotation)[1]
    cut |= _beyond_a_lip(setup, origin, azimuth, elevation - half, parameters)
    lying, walled = np.array(parameters.lying)[np.where(cut, 3, covered + 2 * things)], things | cut
    hidden, head = people | walled, elevation + half
    return Feet(camera, origin, foot, covariance, point, spread, height, head, grounded, hidden, walled, lying, detections.confidence)


def _pose_in_sight(foot: Array, distance: Array, mount: Mount, pose: tuple[Pose, Array]) -> Array:
    """Covariance (n, 2, 2) rad² in the tangent plane of `foot` that comes from the robot's pose; distance (n,) m to the feet."""
    T_world_robot, P = pose
    if not P.any():
        return np.zeros((len(foot), 2, 2))
    R = T_world_robot.rotation
    lever = R @ mount.T_body_camera.translation
    basis = tangent_basis(foot)
    # A point p seen from o: d(direction) = across · (dp − do)/r; the robot's turn moves o about the body's origin and turns the sight.
    turn = distance[:, None, None] * skew(foot) + skew(np.broadcast_to(lever, foot.shape))
    J = np.concatenate([np.broadcast_to(-np.eye(3), (len(foot), 3, 3)) @ R, turn @ R], axis=2) / distance[:, None, None]
    J = basis @ J
    return J @ P @ J.transpose(0, 2, 1)


def _spread_on_ground(foot: Array, sight: Array, covariance: Array) -> Array:
    """Tangent covariance → covariance (n, 2, 2) m² of x, y where the sight meets a level ground; bounded at grazing angles."""
    distance = np.maximum(np.linalg.norm(sight, axis=1), 0.1)
    sink = np.maximum(-foot[:, 2], 0.01)
    along = foot[:, :2] / np.maximum(np.hypot(foot[:, 0], foot[:, 1]), 1e-9)[:, None]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    J = np.stack([left * distance[:, None], along * (distance / sink)[:, None]], axis=2)
    return J @ covariance @ J.transpose(0, 2, 1)


def _behind_people(low: Array, azimuth: Array, detections: Detections, parameters: FusionParameters) -> tuple[Mask, Mask]:
    """Whether a nearer box (one that reaches lower) lies over a part of the lower edge of each box, and over so much that it may hide the feet."""
    half, high = detections.extent[:, 0] / 2, low + detections.extent[:, 1]
    apart = wrap(azimuth[:, None] - azimuth[None, :])
    nearer = (low[None, :] < low[:, None] - 1e-3) & (high[None, :] > low[:, None] - parameters.edge)
    beside = np.abs(apart) < 0.7 * half[:, None] + half[None, :]
    along = np.array([(nearer & (np.abs(apart + u * half[:, None]) < half[None, :])).any(axis=1) for u in EDGE])
    return (nearer & beside).any(axis=1), np.asarray(along.mean(axis=0) >= parameters.covered)


def _behind_things(setup: Setup, origin: Array, lowered: Array, point: Array, parameters: FusionParameters) -> Mask:
    """Whether something stands just under the lower edge of each box, nearer than where the box meets the ground."""
    if setup.occluders is None or not len(lowered):
        return np.zeros(len(lowered), dtype=bool)
    stop, stopped = setup.occluders.intersect(np.broadcast_to(origin, lowered.shape), lowered, parameters.reach)
    over = stop[:, 2] > setup.ground.height_at(stop) + 0.1
    return np.asarray(stopped & over & (np.hypot(*(stop - origin)[:, :2].T) < np.hypot(*(point - origin)[:, :2].T)))


def _beyond_a_lip(setup: Setup, origin: Array, azimuth: Array, low: Array, parameters: FusionParameters) -> Mask:
    """Whether the ground falls away under the line of sight just over the lower edge of each box: feet beyond are lower than one sees.

    Over level ground the height of a line of sight only shrinks on its way, from where a line a little lower meets the ground to where it does.
    """
    origins, ray = np.broadcast_to(origin, (len(low), 3)), bearing_from_angles(azimuth, low + parameters.edge)
    near, met = setup.ground.intersect(origins, bearing_from_angles(azimuth, low - parameters.edge), parameters.reach)
    far, ends = setup.ground.intersect(origins, ray, parameters.reach)
    first, last = (np.hypot(*(p - origin)[:, :2].T) for p in (near, far))
    way = first + ALONG[:, None] * (np.where(ends, last, parameters.reach) - first)
    places = origin + way[:, :, None] * (ray / np.hypot(ray[:, 0], ray[:, 1])[:, None])
    height = places[:, :, 2] - setup.ground.height_at(places.reshape(-1, 3)).reshape(way.shape)
    return np.asarray(met & (height.max(axis=0) > height[0] + parameters.fall))


@dataclass(frozen=True, eq=False)
class Combination:
    """Boxes of different views that may be one person: members (view, detection), point x, y m, covariance (2, 2) m²."""

    members: tuple[tuple[int, int], ...]
    point: Array
    covariance: Array


def combine(views: list[Feet], free: list[Mask], height: tuple[float, float], parameters: FusionParameters) -> list[Combination]:
    """Group the boxes that are `free` in each view, at most one a view, by the Mahalanobis distance of their feet.

    The surest foot starts a group and takes from each other view the nearest within the gate; the point is the covariance-weighted mean.
    Feet that are too likely hidden neither start a group nor join one. Greedy: which groups are people is for the hypotheses to say.
    """
    fit = [np.flatnonzero(free[v] & _standing(f, parameters) & (f.height >= height[0]) & (f.height <= height[1])) for v, f in enumerate(views)]
    view = np.repeat(np.arange(len(views)), [len(rows) for rows in fit])
    if not len(view):
        return []
    box = np.concatenate(fit)
    point = np.concatenate([f.point[rows, :2] for f, rows in zip(views, fit, strict=True)])
    spread = np.concatenate([f.spread[rows] for f, rows in zip(views, fit, strict=True)])
    order = np.lexsort((box, view, np.trace(spread, axis1=1, axis2=2)))
    group, mean, covariance = _grouped(view[order], point[order], spread[order], parameters.gate)
    members: list[list[tuple[int, int]]] = [[] for _ in mean]
    for k, g in zip(order.tolist(), group.tolist(), strict=True):
        members[g].append((int(view[k]), int(box[k])))
    return [Combination(tuple(m), x, P) for m, x, P in zip(members, mean, covariance, strict=True)]


def _standing(feet: Feet, parameters: FusionParameters) -> Mask:
    """Whether each box may start somebody: where the place is not sure, one with anything before it, ended above the feet, puts them metres off."""
    sure = np.trace(feet.spread, axis1=1, axis2=2) <= parameters.near**2
    return feet.grounded & np.where(sure, feet.lying <= parameters.doubtful, ~feet.hidden)


@njit(cache=True)
def _grouped(view: NDArray[np.int64], point: Array, spread: Array, gate: float) -> tuple[NDArray[np.int64], Array, Array]:
    """Feet in order, the surest first: view (n,), point (n, 2), spread (n, 2, 2) → group (n,) of each; mean (g, 2), covariance (g, 2, 2)."""
    n, views = len(view), view.max() + 1
    group, mean, covariance, groups = np.full(n, -1), np.empty((n, 2)), np.empty((n, 2, 2)), 0
    for i in range(n):
        if group[i] >= 0:
            continue
        x, P = point[i].copy(), spread[i].copy()
        group[i] = groups
        for v in range(views):
            best, least = -1, gate * gate
            for k in range(i + 1, n):
                if view[k] != v or v == view[i] or group[k] >= 0:
                    continue
                d0, d1 = point[k, 0] - x[0], point[k, 1] - x[1]
                a, b, c = P[0, 0] + spread[k, 0, 0], P[0, 1] + spread[k, 0, 1], P[1, 1] + spread[k, 1, 1]
                distance = (c * d0 * d0 - 2 * b * d0 * d1 + a * d1 * d1) / (a * c - b * b)
                if distance <= least:
                    best, least = k, distance
            if best >= 0:
                K = P @ np.linalg.inv(P + spread[best])
                x += K @ (point[best] - x)
                P = P - K @ P
                group[best] = groups
        mean[groups], covariance[groups], groups = x, P, groups + 1
    return group, mean[:groups], covariance[:groups]
