"""Interactions of pedestrians: social force, headway and right of way. Compiled, single-threaded, in a fixed order.

The social force and its constants are those of Moussaïd et al. (2009), Experimental study of the behavioural mechanisms underlying
self-organization in human crowds, Proc. R. Soc. B 276. The speed behind another person follows the headway law of Tordeux, Chraibi and
Seyfried (2016), Collision-free speed model for pedestrian dynamics, eq. 2: speed = (distance − length) / time gap.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from tracker.geometry.compilation import njit

BODY_RADIUS = 0.23
"""m: bodies overlap below twice this distance. Packed bodies are 5.5 a m², Weidmann's highest density."""
INTERACTION_RANGE = 3.0
"""m: range of interactions between people."""
TIME_GAP, LENGTH, HALF_LANE = 0.5, 0.4, 0.3
"""s, m, m: time gap and length of the headway law, half the width of the lane in which a person follows another.
They are fitted to the fundamental diagram of Weidmann (1993), in a ring corridor of 8 m radius and 2.5 m width at 0.5 to 3 people a m²."""
CONTACT_RANGE = 0.14
"""m: gap between bodies below which they repel each other stiffly."""
X, Y, VX, VY, HEADING, PAUSE, STUCK, VISIT, PRESENT, GOAL = range(10)
"""Columns of a body: position m, velocity m/s, heading rad, remaining pause s, s without progress, goals passed, 1 if present, index of the goal."""
DIRECTION_X, DIRECTION_Y, SPEED, IN_BOTTLENECK, BEFORE_BOTTLENECK, CLEARANCE = range(6)
"""Columns of the desired motion: unit direction, speed m/s, 1 inside a bottleneck, 1 just before one, clearance from walls m."""
FORCE_X, FORCE_Y, HEADWAY_SPEED, YIELDS, ASKED_TO_YIELD = range(5)
"""Columns of interactions: force m/s², speed limit by headway m/s, 1 to yield at a bottleneck, 1 to yield to a robot's request."""
YIELD_LANE, YIELD_ACCELERATION = 0.75, 2.5
"""m: half width of the lane that people clear for a robot; m/s²: acceleration with which they do."""

Numbers = NDArray[np.int64]
Pairs = NDArray[np.int32]
Number = int | np.signedinteger[Any]


@njit(cache=True)
def interactions(body: Array, desired: Array, obstacle: Array) -> tuple[Array, Pairs]:
    """Interactions (m, 5) of bodies (m, 10) with desired motion (m, 6), and all pairs (p, 2) of people within one metre.

    obstacle (k, 7): x, y, vx, vy, radius, requested vx, vy.
    """
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
    """All pairs (p, 2) of the people `present` (n,) within `reach` m, by a cell list with an empty frame of cells."""
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
        # The start of each cell advances to its end: afterwards first[c] is the start of cell c.
        order[first[cell[a] + 1]] = present[a]
        first[cell[a] + 1] += 1
    return _pairs(body, order, first, (width, reach))


@njit(cache=True)
def _pairs(body: Array, order: Numbers, first: Numbers, grid: tuple[int, float]) -> Pairs:
    """Pairs of `_neighbours`. Cell c holds the people order[first[c] : first[c + 1]]; grid: cells in a row, reach m."""
    width, reach = grid
    # Neighbouring cells in a row are one run of `order`: the rest of this cell with the next one, and the three cells of the next row.
    # Indices of 4 bytes keep the memory small that each step allocates.
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
    """Force, m/s², on a person from a body at (away_x, away_y) m. (slip_x, slip_y) m/s: velocity relative to it. They touch at `touch` m.

    Moussaïd et al. 2009, eq. 3 to 5 with A = 4.5, γ = 0.35, n = 2, n' = 3, λ = 2, plus a stiff repulsion near contact (Helbing, Farkas,
    Vicsek 2000). The force on the other body is the opposite.
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
    # Forces below 0.1 m/s² are left out: at long range, or beyond 1.5 / B rad aside (1 − cos x < x² / 2).
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
    """Interactions (m, 5) between people with desired motion (m, 6)."""
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
    """Speed limit, m/s, along (ex, ey) behind a person at (ax, ay) m who walks the same way; inf outside of the lane."""
    if ax * ex + ay * ey <= 0.0 or abs(ax * ey - ay * ex) > HALF_LANE:
        return np.inf
    return max(math.sqrt(ax * ax + ay * ay) - LENGTH, 0.0) / TIME_GAP


@njit(cache=True)
def _yield_at_bottleneck(body: Array, desired: Array, pair: tuple[int, int], out: Array) -> None:
    """Right of way at a bottleneck: people inside go first, then those who have waited longer, then the lower index."""
    i, j = pair
    if desired[i, BEFORE_BOTTLENECK] > 0 and (
        desired[j, IN_BOTTLENECK] > 0 or (desired[j, BEFORE_BOTTLENECK] > 0 and body[j, STUCK] > body[i, STUCK])
    ):
        out[i, YIELDS] = 1.0
    elif desired[j, BEFORE_BOTTLENECK] > 0 and (desired[i, IN_BOTTLENECK] > 0 or desired[i, BEFORE_BOTTLENECK] > 0):
        out[j, YIELDS] = 1.0


@njit(cache=True)
def _obstacle_interactions(body: Array, present: Numbers, obstacle: Array, effect: Array) -> None:
    """Add the interactions with obstacles to `effect`."""
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
    """A person at `away` m from a robot with a request steps out of its lane, to the nearer side and ahead."""
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
