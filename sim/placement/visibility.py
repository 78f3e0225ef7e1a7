"""Visibility of people from cameras: lines of sight to points on their bodies, past terrain, walls and other people.

Static objects are an elevation map, with one column per grid point, and the lines of sight are exact on it. People are upright cylinders.
The kernels are compiled. MuJoCo's ray casts take a hundred times as long on meshes; tests use them as the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter

from tracker.geometry import Array, frozen
from tracker.geometry.compilation import njit

BODY_POINTS = np.array([(0.0, 0.94), (-0.17, 0.80), (0.17, 0.80), (0.0, 0.66), (-0.13, 0.50), (0.13, 0.50), (-0.09, 0.26), (0.09, 0.26)])
"""Points of a body: offset to the side as seen from the camera (m), and height over stature. They are head, shoulders, chest, hips and knees."""
OCCLUDER_RADIUS = 0.2
"""Radius of the cylinder that stands for a person who occludes others, m."""
BODY_HALF_WIDTH = 0.17
"""Greatest offset of a body point to the side, m."""
BLOCK = 8
"""Columns along a side of a block. Most lines of sight clear the highest column of each block, and this test is faster."""
BLIND_RADIUS = 0.3
"""Distance from its own mast within which a camera sees nothing, m."""


@dataclass(frozen=True, eq=False)
class ElevationMap:
    """Tops of columns on a grid. top (rows, columns) m, row 0 at the lowest y; frame (3,): origin x, y and spacing, m."""

    top: Array
    frame: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "top", frozen(self.top, (None, None), "top"))
        object.__setattr__(self, "frame", frozen(self.frame, (3,), "frame"))

    @cached_property
    def packed(self) -> tuple[Array, Array, Array]:
        """Kernel arguments: top, frame, and the highest top of each block of BLOCK × BLOCK columns with a margin of half a body width."""
        around = 2 * (math.ceil(BODY_HALF_WIDTH / self.frame[2]) + 1)
        widest = maximum_filter(self.top, size=BLOCK + around, mode="nearest")
        # A window of an even size reaches one column farther below its centre than above it.
        middle = [np.minimum(np.arange(0, count, BLOCK) + BLOCK // 2, count - 1) for count in self.top.shape]
        return self.top, self.frame, np.ascontiguousarray(widest[np.ix_(*middle)])


@dataclass(frozen=True)
class VisibilityLimits:
    """The limits of detection of a person: reach (m), the least apparent height `size` (rad), and the least share of body points."""

    reach: float = 12.0
    size: float = 0.12
    share: float = 0.25


def seen_share(elevation: ElevationMap, cameras: Array, people: Array, limits: VisibilityLimits) -> Array:
    """Share (r, p) of the body points of people (p, 4) that cameras (r, 3) m see. people: feet x, y, z m and stature m.

    It is 0 for people beyond the limits.
    """
    cameras, people = np.ascontiguousarray(cameras, dtype=np.float64), np.ascontiguousarray(people, dtype=np.float64)
    return share_kernel(elevation.packed, cameras, people, (limits.reach, limits.size, limits.share))


def visible_points(elevation: ElevationMap, camera: Array, people: Array) -> Array:
    """Array (p, 8): 1.0 for each point of BODY_POINTS of people (p, 4) that a camera (3,) m sees, else 0.0."""
    return _visible_points(elevation.packed, np.asarray(camera, dtype=np.float64), np.ascontiguousarray(people, dtype=np.float64))


def line_of_sight(elevation: ElevationMap, camera: Array, points: Array, margin: float = 0.0) -> Array:
    """1.0 where no static object lies between camera (3,) m and points (n, 3) m, else 0.0. The last `margin` m are not tested."""
    camera, points = np.asarray(camera, dtype=np.float64), np.ascontiguousarray(points, dtype=np.float64)
    return _lines_of_sight(elevation.top, elevation.frame, camera, points, margin)


@njit(cache=True)
def _passes(top, start, way, until, lowest):  # type: ignore[no-untyped-def]
    """Whether a segment passes above every column of `top` (rows, columns) m, up to the share `until` of its length.

    start, way: its start, and the vector to its end; x and y in columns, z in m. `lowest` tests its lower end in each column, not its middle.
    The columns are visited in order (Amanatides and Woo 1987).
    """
    (x, y, z), (dx, dy, dz) = start, way
    j, i = math.floor(x), math.floor(y)
    step_j, step_i = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    over_x = 1.0 / abs(dx) if abs(dx) > 1e-12 else 1e30
    over_y = 1.0 / abs(dy) if abs(dy) > 1e-12 else 1e30
    next_x = ((j + 1 - x) if dx > 0 else (x - j)) * over_x
    next_y = ((i + 1 - y) if dy > 0 else (y - i)) * over_y
    t = 0.0
    while t < until:
        end = min(next_x, next_y, until)
        along = min(t * dz, end * dz) if lowest else 0.5 * (t + end) * dz
        if 0 <= i < top.shape[0] and 0 <= j < top.shape[1] and z + along < top[i, j]:
            return False
        t = end
        if next_x < next_y:
            next_x += over_x
            j += step_j
        else:
            next_y += over_y
            i += step_i
    return True


@njit(cache=True)
def sees(top: Array, frame: Array, camera: tuple[float, float, float], goal: tuple[float, float, float], until: float) -> bool:
    """Whether the segment from camera to goal (m) passes above every column, up to the share `until` of its length."""
    start = (camera[0] - frame[0]) / frame[2] + 0.5, (camera[1] - frame[1]) / frame[2] + 0.5, camera[2]
    return bool(_passes(top, start, ((goal[0] - camera[0]) / frame[2], (goal[1] - camera[1]) / frame[2], goal[2] - camera[2]), until, False))


@njit(cache=True)
def _lines_of_sight(top: Array, frame: Array, camera: Array, points: Array, margin: float) -> Array:
    out = np.zeros(len(points))
    for k in range(len(points)):
        length = math.sqrt((points[k, 0] - camera[0]) ** 2 + (points[k, 1] - camera[1]) ** 2 + (points[k, 2] - camera[2]) ** 2)
        until = max(1.0 - margin / max(length, 1e-9), 0.0)
        if sees(top, frame, (camera[0], camera[1], camera[2]), (points[k, 0], points[k, 1], points[k, 2]), until):
            out[k] = 1.0
    return out


@njit(cache=True)
def _occluded_by_person(people: Array, person: int, camera: Array, goal: tuple[float, float, float]) -> bool:
    """Whether another person stands between camera and goal."""
    dx, dy, dz = goal[0] - camera[0], goal[1] - camera[1], goal[2] - camera[2]
    square = max(dx * dx + dy * dy, 1e-12)
    for q in range(len(people)):
        if q == person:
            continue
        ox, oy = people[q, 0] - camera[0], people[q, 1] - camera[1]
        t = (ox * dx + oy * dy) / square
        if t <= 0.0 or t >= 1.0:
            continue
        gap = (ox - t * dx) ** 2 + (oy - t * dy) ** 2
        if gap >= OCCLUDER_RADIUS * OCCLUDER_RADIUS:
            continue
        z = camera[2] + t * dz
        if people[q, 2] <= z <= people[q, 2] + people[q, 3]:
            return True
    return False


@njit(cache=True)
def _body_point(camera: Array, person: Array, k: int) -> tuple[float, float, float]:
    """Position, m, of body point k of a person (4,); its side offset is perpendicular to the line of sight of a camera (3,) m."""
    ax, ay = person[0] - camera[0], person[1] - camera[1]
    aside = BODY_POINTS[k, 0] / math.sqrt(ax * ax + ay * ay)
    return person[0] - aside * ay, person[1] + aside * ax, person[2] + BODY_POINTS[k, 1] * person[3]


@njit(cache=True)
def _above_all(elevation, camera: Array, person: Array) -> bool:  # type: ignore[no-untyped-def]
    """Whether all lines of sight to the body of a person (4,) clear every block below. True is certain, False may be wrong."""
    _, frame, greatest = elevation
    side = frame[2] * BLOCK
    start = (camera[0] - frame[0]) / side + 0.5 / BLOCK, (camera[1] - frame[1]) / side + 0.5 / BLOCK, camera[2]
    way = (person[0] - camera[0]) / side, (person[1] - camera[1]) / side, person[2] + BODY_POINTS[-1, 1] * person[3] - camera[2]
    return bool(_passes(greatest, start, way, 1.0, True))


@njit(cache=True)
def _between(people: Array, person: int, camera: Array) -> bool:
    """Whether another person stands close enough to the line of sight to hide a part of this person's body."""
    dx, dy = people[person, 0] - camera[0], people[person, 1] - camera[1]
    square = max(dx * dx + dy * dy, 1e-12)
    for q in range(len(people)):
        ox, oy = people[q, 0] - camera[0], people[q, 1] - camera[1]
        t = min(max((ox * dx + oy * dy) / square, 0.0), 1.0)
        if q != person and (ox - t * dx) ** 2 + (oy - t * dy) ** 2 < (OCCLUDER_RADIUS + BODY_HALF_WIDTH + 0.01) ** 2:
            return True
    return False


@njit(cache=True)
def _look_at(elevation, camera: Array, people: Array, p: int, seen: Array) -> None:  # type: ignore[no-untyped-def]
    """Set seen (8,) to 1.0 for each point of person p that a camera (3,) m sees, and to 0.0 for the others."""
    seen[:] = 0.0
    if math.sqrt((people[p, 0] - camera[0]) ** 2 + (people[p, 1] - camera[1]) ** 2) < BLIND_RADIUS:
        return
    clear, crowded = _above_all(elevation, camera, people[p]), _between(people, p, camera)
    for k in range(len(seen)):
        goal = _body_point(camera, people[p], k)
        hidden = crowded and _occluded_by_person(people, p, camera, goal)
        if not hidden and (clear or sees(elevation[0], elevation[1], (camera[0], camera[1], camera[2]), goal, 1.0)):
            seen[k] = 1.0


@njit(cache=True)
def _visible_points(elevation, camera: Array, people: Array) -> Array:  # type: ignore[no-untyped-def]
    out = np.empty((len(people), len(BODY_POINTS)))
    for p in range(len(people)):
        _look_at(elevation, camera, people, p, out[p])
    return out


@njit(cache=True)
def share_kernel(elevation, cameras: Array, people: Array, limits: tuple[float, float, float]) -> Array:  # type: ignore[no-untyped-def]
    """`seen_share`. elevation: ElevationMap.packed. limits: reach m, least apparent height rad, least share."""
    out, seen = np.zeros((len(cameras), len(people))), np.empty(len(BODY_POINTS))
    for r in range(len(cameras)):
        for p in range(len(people)):
            distance = math.sqrt((people[p, 0] - cameras[r, 0]) ** 2 + (people[p, 1] - cameras[r, 1]) ** 2 + 1e-12)
            if distance > limits[0] or math.atan(people[p, 3] / distance) < limits[1]:
                continue
            _look_at(elevation, cameras[r], people, p, seen)
            share = seen.sum() / len(seen)
            out[r, p] = share if share >= limits[2] else 0.0
    return out
