"""What people in each other's way do: forces, headway, and bodies that do not run through each other. Compiled, one thread, in a fixed order.

Steering is the social force of Moussaïd et al. (2009), Experimental study of the behavioural mechanisms underlying self-organization in human
crowds, Proc. R. Soc. B 276, with their constants. How fast somebody follows another is the headway law of Tordeux, Chraibi and Seyfried (2016),
Collision-free speed model for pedestrian dynamics, eq. 2: speed = (distance − length) / time gap.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array

BODY_RADIUS = 0.23
"""m: bodies closer than twice this overlap; packed, they are 5.5 to the m², Weidmann's densest crowd."""
INTERACTION_RANGE = 3.0
"""m beyond which people do not mind each other."""
TIME_GAP, LENGTH, HALF_LANE = 0.5, 0.4, 0.3
"""s, m, m: the distance to whom one follows, beyond LENGTH, over the speed; and half the width of the lane in which one follows. Fitted to the
fundamental diagram of Weidmann (1993) in a ring corridor of 8 m radius, 2.5 m wide, at 0.5 to 3 people a m²; tested in another one."""
CONTACT_RANGE = 0.14
"""m before bodies touch at which they begin to push."""
X, Y, VX, VY, HEADING, PAUSE, STUCK, VISIT, PRESENT, GOAL = range(10)
"""Columns of a body: place m, velocity m/s, heading rad, s still to stand, s without getting on, goals passed, 1 where present, the goal's number."""
DIRECTION_X, DIRECTION_Y, SPEED, IN_BOTTLENECK, BEFORE_BOTTLENECK, CLEARANCE = range(6)
"""Columns of a wish: unit direction, m/s, 1 where one is in a passage too narrow for two, 1 where one is about to enter it, m off walls."""
FORCE_X, FORCE_Y, HEADWAY_SPEED, YIELDS, ASKED_TO_YIELD = range(5)
"""Columns of what others do to somebody: m/s², m/s that they leave free, 1 where somebody is let through first, 1 where a robot asks for way."""
YIELD_LANE, YIELD_ACCELERATION = 0.75, 2.5
"""m to both sides of the way that a robot asks for in which people make room, and m/s² with which they do."""

Numbers = NDArray[np.int64]
Pairs = NDArray[np.int32]
Number = int | np.signedinteger[Any]


@njit(cache=True)
def interactions(body: Array, desired: Array, obstacle: Array) -> tuple[Array, Pairs]:
    """(m, 5): what all others and obstacles (k, 7) x, y, vx, vy, radius, asked vx, vy do to everybody, who wants to walk as `wish` (m, 6);
    and (p, 2): all pairs of people within a metre of each other."""
    present = np.flatnonzero(body[:, PRESENT] > 0)
    pairs = _neighbours(body, present, INTERACTION_RANGE)
    effect = _pedestrian_interactions(body, desired, pairs)
    _obstacle_interactions(body, present, obstacle, effect)
    close, count = np.empty((4 * len(present), 2), np.int32), 0
    for i, j in pairs:
        if count == len(close):
            close = np.concatenate((close, np.empty_like(close)))
        if (body[i, X] - body[j, X]) ** 2 + (body[i, Y] - body[j, Y]) ** 2 < 1.0:
            close[count, 0], close[count, 1] = i, j
            count += 1
    return effect, close[:count]


@njit(cache=True)
def _neighbours(body: Array, present: Numbers, reach: float) -> Pairs:
    """(p, 2): all pairs of the people `here` (n,) that are nearer than `reach` m, by a list of cells of that size, with an empty frame of cells."""
    n = len(present)
    if n < 2:
        return np.empty((0, 2), np.int32)
    x0, y0 = body[present[0], X], body[present[0], Y]
    x1, y1 = x0, y0
    for i in present:
        x0, y0, x1, y1 = min(x0, body[i, X]), min(y0, body[i, Y]), max(x1, body[i, X]), max(y1, body[i, Y])
    width, rows = int((x1 - x0) / reach) + 3, int((y1 - y0) / reach) + 3
    cell, first = np.empty(n, np.int64), np.zeros(rows * width + 2, np.int64)
    for a in range(n):
        cell[a] = (int((body[present[a], Y] - y0) / reach) + 1) * width + int((body[present[a], X] - x0) / reach) + 1
        first[cell[a] + 2] += 1
    first = np.cumsum(first)
    order = np.empty(n, np.int64)
    for a in range(n):
        # Each cell's start moves on to its end, so that afterwards `first` counts from the cell itself.
        order[first[cell[a] + 1]] = present[a]
        first[cell[a] + 1] += 1
    return _pairs(body, order, first, (width, reach))


@njit(cache=True)
def _pairs(body: Array, order: Numbers, first: Numbers, grid: tuple[int, float]) -> Pairs:
    """The pairs of `_neighbours`: people in the order of their cells, cell c being order[first[c] : first[c + 1]]; grid: cells a row, reach m."""
    width, reach = grid
    # One row of neighbouring cells is one run of `order`: the rest of this cell with the one to the east, and the three to the north.
    # Four bytes each: what a step takes from the system anew grows with the crowd faster than the crowd.
    out, count = np.empty((max(16 * len(order), 64), 2), np.int32), 0
    for c in range(width, len(first) - 2 - width):
        for a in range(first[c], first[c + 1]):
            i = order[a]
            for run in range(2):
                low = a + 1 if run == 0 else first[c + width - 1]
                high = first[c + 2] if run == 0 else first[c + width + 2]
                for b in range(low, high):
                    j = order[b]
                    dx, dy = body[i, X] - body[j, X], body[i, Y] - body[j, Y]
                    if dx * dx + dy * dy < reach * reach:
                        if count == len(out):
                            out = np.concatenate((out, np.empty_like(out)))
                        out[count, 0], out[count, 1] = i, j
                        count += 1
    return out[:count]


@njit(cache=True)
def _pair_force(away_x: float, away_y: float, slip_x: float, slip_y: float, touch: float) -> tuple[float, float]:
    """m/s² on a walker from another body at (away_x, away_y) m, walking with (slip_x, slip_y) m/s relative to it; they touch at `touch` m.

    Moussaïd et al. 2009, eq. 3 to 5 with A = 4.5, γ = 0.35, n = 2, n' = 3, λ = 2, and a stiff push where bodies would touch (Helbing, Farkas,
    Vicsek 2000). The other feels the opposite.
    """
    distance = max(math.sqrt(away_x * away_x + away_y * away_y), 1e-6)
    ex, ey = away_x / distance, away_y / distance
    dx, dy = 2.0 * slip_x + ex, 2.0 * slip_y + ey
    length = math.sqrt(dx * dx + dy * dy)
    fx = fy = 0.0
    B = 0.35 * length
    near = max(distance - touch + 0.4, 0.0)
    tx, ty = dx / max(length, 1e-9), dy / max(length, 1e-9)
    ahead = tx * ex + ty * ey
    # What is left out is below 0.1 m/s²: too far off, or further aside than 1.5 / B rad (1 − cos x < x² / 2).
    if near < 4.0 * B and (1.0 - ahead) * B * B < 1.2:
        theta = math.atan2(tx * ey - ty * ex, ahead)
        gap = 4.5 * math.exp(-near / B)
        slow = gap * math.exp(-((3.0 * B * theta) ** 2))
        turn = gap * math.exp(-((2.0 * B * theta) ** 2)) * (1.0 if theta >= 0 else -1.0)
        fx, fy = -slow * tx + turn * ty, -slow * ty - turn * tx
    push = 25.0 * max(touch + CONTACT_RANGE - distance, 0.0)
    return fx - push * ex, fy - push * ey


@njit(cache=True)
def _pedestrian_interactions(body: Array, desired: Array, pairs: Pairs) -> Array:
    """(m, 5): what all others do to everybody, who wants to walk as `wish` (m, 6)."""
    out = np.zeros((len(body), 5))
    out[:, HEADWAY_SPEED] = np.inf
    for p in range(len(pairs)):
        i, j = pairs[p]
        ax, ay = body[j, X] - body[i, X], body[j, Y] - body[i, Y]
        fx, fy = _pair_force(ax, ay, body[i, VX] - body[j, VX], body[i, VY] - body[j, VY], 2 * BODY_RADIUS)
        out[i, FORCE_X] += fx
        out[i, FORCE_Y] += fy
        out[j, FORCE_X] -= fx
        out[j, FORCE_Y] -= fy
        same = desired[i, DIRECTION_X] * desired[j, DIRECTION_X] + desired[i, DIRECTION_Y] * desired[j, DIRECTION_Y]
        if same > 0.0:
            out[i, HEADWAY_SPEED] = min(out[i, HEADWAY_SPEED], _headway_speed(ax, ay, desired[i, DIRECTION_X], desired[i, DIRECTION_Y]))
            out[j, HEADWAY_SPEED] = min(out[j, HEADWAY_SPEED], _headway_speed(-ax, -ay, desired[j, DIRECTION_X], desired[j, DIRECTION_Y]))
        elif same < -0.3 and ax * ax + ay * ay < 4.0:
            _yield_at_bottleneck(body, desired, (i, j), out)
    return out


@njit(cache=True)
def _headway_speed(ax: float, ay: float, ex: float, ey: float) -> float:
    """m/s at which one walks along (ex, ey) behind somebody at (ax, ay) m who goes the same way."""
    if ax * ex + ay * ey <= 0.0 or abs(ax * ey - ay * ex) > HALF_LANE:
        return np.inf
    return max(math.sqrt(ax * ax + ay * ay) - LENGTH, 0.0) / TIME_GAP


@njit(cache=True)
def _yield_at_bottleneck(body: Array, desired: Array, pair: tuple[int, int], out: Array) -> None:
    """Before a narrow place: who is inside comes first, of two outside who has waited longer, else the first in the list."""
    i, j = pair
    if desired[i, BEFORE_BOTTLENECK] > 0 and (desired[j, IN_BOTTLENECK] > 0 or (desired[j, BEFORE_BOTTLENECK] > 0 and body[j, STUCK] > body[i, STUCK])):
        out[i, YIELDS] = 1.0
    elif desired[j, BEFORE_BOTTLENECK] > 0 and (desired[i, IN_BOTTLENECK] > 0 or desired[i, BEFORE_BOTTLENECK] > 0):
        out[j, YIELDS] = 1.0


@njit(cache=True)
def _obstacle_interactions(body: Array, present: Numbers, obstacle: Array, effect: Array) -> None:
    """Add to `met` what obstacles do."""
    for i in present:
        for o in range(len(obstacle)):
            ax, ay = obstacle[o, 0] - body[i, X], obstacle[o, 1] - body[i, Y]
            if ax * ax + ay * ay < 25.0:
                fx, fy = _pair_force(ax, ay, body[i, VX] - obstacle[o, 2], body[i, VY] - obstacle[o, 3], BODY_RADIUS + obstacle[o, 4])
                effect[i, FORCE_X] += fx
                effect[i, FORCE_Y] += fy
                _yield_to_robot(obstacle[o], (-ax, -ay), effect[i])


@njit(cache=True)
def _yield_to_robot(robot: Array, away: tuple[float, float], effect: Array) -> None:
    """Somebody who is `away` m from a robot that has waited for those before it steps out of its way, to the nearer side and on."""
    pace = math.sqrt(robot[5] ** 2 + robot[6] ** 2)
    if pace <= 0.0:
        return
    ex, ey = robot[5] / pace, robot[6] / pace
    ahead, aside = away[0] * ex + away[1] * ey, away[1] * ex - away[0] * ey
    if 0.0 < ahead < 2.0 and abs(aside) < YIELD_LANE:
        side = 1.0 if aside >= 0 else -1.0
        effect[FORCE_X] += YIELD_ACCELERATION * (0.4 * ex - side * ey)
        effect[FORCE_Y] += YIELD_ACCELERATION * (0.4 * ey + side * ex)
        effect[ASKED_TO_YIELD] = 1.0
