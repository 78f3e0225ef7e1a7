"""Who sees whom: straight lines from cameras to points on people's bodies, past terrain, walls and other people. Compiled, exact on its grid.

What stands still is a grid of heights (worlds.world): a column as wide as a cell at every grid point. People are upright cylinders. MuJoCo's
own rays take a hundred times as long on meshes; they are the oracle of the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array, frozen

BODY = np.array([(0.0, 0.94), (-0.17, 0.80), (0.17, 0.80), (0.0, 0.66), (-0.13, 0.50), (0.13, 0.50), (-0.09, 0.26), (0.09, 0.26)])
"""Points of a body: m aside, seen from the camera, and their height as a share of the stature: head, shoulders, chest, hips, knees."""
RADIUS = 0.2
"""m: that of the cylinder by which somebody hides others."""
BLIND = 0.3
"""m around its own mast that a camera does not see."""


@dataclass(frozen=True, eq=False)
class Heights:
    """Tops of columns: top (rows, columns) m, row 0 at the lowest y; frame (3,): origin x, y and spacing m."""

    top: Array
    frame: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "top", frozen(self.top, (None, None), "top"))
        object.__setattr__(self, "frame", frozen(self.frame, (3,), "frame"))


@dataclass(frozen=True)
class Eyesight:
    """How far and how little of a person counts as seen: reach m; size, the least apparent height rad; share of the body's points."""

    reach: float = 12.0
    size: float = 0.12
    share: float = 0.25


def visible(heights: Heights, eyes: Array, people: Array) -> Array:
    """(r, p) share of the body's points that the cameras at eyes (r, 3) m see of people (p, 4): feet x, y, z m and stature m; whatever the reach."""
    return _visible(heights.top, heights.frame, np.ascontiguousarray(eyes, dtype=np.float64), np.ascontiguousarray(people, dtype=np.float64))


def seen(heights: Heights, eyes: Array, people: Array, eyesight: Eyesight) -> Array:
    """As `visible`, and 0 where it is too far off, looks too small or shows too little."""
    eyes, people = np.ascontiguousarray(eyes, dtype=np.float64), np.ascontiguousarray(people, dtype=np.float64)
    return _seen(heights.top, heights.frame, eyes, people, (eyesight.reach, eyesight.size, eyesight.share))


def points_seen(heights: Heights, eye: Array, people: Array) -> NDArray[np.bool_]:
    """(p, 8) whether each point of BODY of people (p, 4) is seen from eye (3,) m."""
    return _points(heights.top, heights.frame, np.asarray(eye, dtype=np.float64), np.ascontiguousarray(people, dtype=np.float64))


def clear(heights: Heights, eye: Array, points: Array, before: float = 0.0) -> Array:
    """(n,) 1.0 where nothing that stands still lies between eye (3,) m and points (n, 3) m, the last `before` m left out, else 0.0."""
    return _clear_all(heights.top, heights.frame, np.asarray(eye, dtype=np.float64), np.ascontiguousarray(points, dtype=np.float64), before)


@njit(cache=True)
def _clear(top: Array, frame: Array, eye: tuple[float, float, float], goal: tuple[float, float, float], until: float) -> bool:
    """Whether the way from eye to goal (m) is above every column up to the share `until` of it; from column to column (Amanatides and Woo 1987)."""
    rows, columns = top.shape
    x, y = (eye[0] - frame[0]) / frame[2] + 0.5, (eye[1] - frame[1]) / frame[2] + 0.5
    dx, dy, dz = (goal[0] - eye[0]) / frame[2], (goal[1] - eye[1]) / frame[2], goal[2] - eye[2]
    j, i = math.floor(x), math.floor(y)
    step_j, step_i = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    over_x = 1.0 / abs(dx) if abs(dx) > 1e-12 else 1e30
    over_y = 1.0 / abs(dy) if abs(dy) > 1e-12 else 1e30
    next_x = ((j + 1 - x) if dx > 0 else (x - j)) * over_x
    next_y = ((i + 1 - y) if dy > 0 else (y - i)) * over_y
    t = 0.0
    while t < until:
        end = min(next_x, next_y, until)
        if 0 <= i < rows and 0 <= j < columns and eye[2] + 0.5 * (t + end) * dz < top[i, j]:
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
def _clear_all(top: Array, frame: Array, eye: Array, points: Array, before: float) -> Array:
    out = np.zeros(len(points))
    for k in range(len(points)):
        length = math.sqrt((points[k, 0] - eye[0]) ** 2 + (points[k, 1] - eye[1]) ** 2 + (points[k, 2] - eye[2]) ** 2)
        until = max(1.0 - before / max(length, 1e-9), 0.0)
        if _clear(top, frame, (eye[0], eye[1], eye[2]), (points[k, 0], points[k, 1], points[k, 2]), until):
            out[k] = 1.0
    return out


@njit(cache=True)
def _hidden(people: Array, person: int, eye: Array, goal: tuple[float, float, float]) -> bool:
    """Whether somebody else stands between eye and goal."""
    dx, dy, dz = goal[0] - eye[0], goal[1] - eye[1], goal[2] - eye[2]
    square = max(dx * dx + dy * dy, 1e-12)
    for q in range(len(people)):
        if q == person:
            continue
        ox, oy = people[q, 0] - eye[0], people[q, 1] - eye[1]
        t = (ox * dx + oy * dy) / square
        if t <= 0.0 or t >= 1.0:
            continue
        gap = (ox - t * dx) ** 2 + (oy - t * dy) ** 2
        if gap >= RADIUS * RADIUS:
            continue
        z = eye[2] + t * dz
        if people[q, 2] <= z <= people[q, 2] + people[q, 3]:
            return True
    return False


@njit(cache=True)
def _point(top: Array, frame: Array, eye: Array, people: Array, which: tuple[int, int]) -> bool:
    """Whether eye (3,) m sees point k of person p; which: p, k."""
    p, k = which
    x, y, z, stature = people[p]
    ax, ay = x - eye[0], y - eye[1]
    away = math.sqrt(ax * ax + ay * ay)
    if away < BLIND:
        return False
    aside = BODY[k, 0] / away
    goal = (x - aside * ay, y + aside * ax, z + BODY[k, 1] * stature)
    return not _hidden(people, p, eye, goal) and _clear(top, frame, (eye[0], eye[1], eye[2]), goal, 1.0)


@njit(cache=True)
def _share(top: Array, frame: Array, eye: Array, people: Array, p: int) -> float:
    """The share of the points of person p that eye (3,) m sees."""
    count = 0
    for k in range(len(BODY)):
        if _point(top, frame, eye, people, (p, k)):
            count += 1
    return count / len(BODY)


@njit(cache=True)
def _points(top: Array, frame: Array, eye: Array, people: Array) -> NDArray[np.bool_]:
    out = np.zeros((len(people), len(BODY)), np.bool_)
    for p in range(len(people)):
        for k in range(len(BODY)):
            out[p, k] = _point(top, frame, eye, people, (p, k))
    return out


@njit(cache=True)
def _visible(top: Array, frame: Array, eyes: Array, people: Array) -> Array:
    out = np.zeros((len(eyes), len(people)))
    for r in range(len(eyes)):
        for p in range(len(people)):
            out[r, p] = _share(top, frame, eyes[r], people, p)
    return out


@njit(cache=True)
def _seen(top: Array, frame: Array, eyes: Array, people: Array, limits: tuple[float, float, float]) -> Array:
    out = np.zeros((len(eyes), len(people)))
    for r in range(len(eyes)):
        for p in range(len(people)):
            away = math.sqrt((people[p, 0] - eyes[r, 0]) ** 2 + (people[p, 1] - eyes[r, 1]) ** 2 + 1e-12)
            if away > limits[0] or math.atan(people[p, 3] / away) < limits[1]:
                continue
            share = _share(top, frame, eyes[r], people, p)
            out[r, p] = share if share >= limits[2] else 0.0
    return out
