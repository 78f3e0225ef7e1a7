"""Steering of pedestrians: desired motion on the grid of free space, and one step of motion. Compiled, single-threaded, in a fixed order.

numba caches compiled code by file. Hence compiled functions here call none of another file, so that no change is missed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.crowd.social_force import (  # fmt: skip
    ASKED_TO_YIELD,
    BEFORE_BOTTLENECK,
    BODY_RADIUS,
    CLEARANCE,
    DIRECTION_X,
    DIRECTION_Y,
    FORCE_X,
    FORCE_Y,
    GOAL,
    HEADING,
    HEADWAY_SPEED,
    IN_BOTTLENECK,
    PAUSE,
    PRESENT,
    SPEED,
    STUCK,
    VISIT,
    VX,
    VY,
    YIELDS,
    Number,
    Numbers,
    Pairs,
    X,
    Y,
)
from tracker.geometry import Array
from tracker.geometry.compilation import njit

RELAXATION = 0.54
"""s: relaxation time towards the desired velocity (Moussaïd et al. 2009)."""
TURN_RATE = 2.5
"""rad/s: speed at which a body turns into its direction of motion."""
BOTTLENECK_AHEAD, BOTTLENECK_HALF_WIDTH = 0.7, 0.4
"""m: distance at which a bottleneck is recognized; half width below which a passage is a bottleneck."""
GROUP_DISTANCE = 0.8
"""m: distance to the centre of the rest of the group beyond which a person waits or hurries."""
CLEARANCE_MAP, AWAY_X_MAP, AWAY_Y_MAP, HEIGHT_MAP = np.arange(4)
"""Numbers of a grid's maps. They are NumPy's, since numba compiles a function anew for each literal that it is called with."""
_WALL_PUSH, _WALL_RANGE = 3.0, 0.1
_CLEAR = 0.02
_FASTEST = 2.5


class SteeringGrid(NamedTuple):
    """Maps on the grid of free space.

    maps (rows, columns, 4): clearance m, unit direction away from walls, height m. directions (g, rows, columns, 2): unit vectors to each goal.
    known (g,): whether the directions to a goal are computed. goals: (g, 2) m. frame: origin x, y and spacing, m.
    """

    maps: NDArray[np.float32]
    directions: NDArray[np.float32]
    known: NDArray[np.bool_]
    goals: Array
    frame: Array


@njit(cache=True)
def advance(body: Array, desired: Array, effect: tuple[Array, Pairs], obstacle: Array, grid: SteeringGrid, dt: float) -> Array:
    """Bodies (m, 10) `dt` s later. desired: (m, 6). effect: interactions (m, 5) and close pairs (p, 2). obstacle: (k, 7)."""
    out = body.copy()
    present = np.flatnonzero(body[:, PRESENT] > 0)
    for i in present:
        _accelerate(out, i, (desired[i], effect[0][i]), grid, dt)
    for _ in range(4):
        _separate_bodies(out, effect[1], obstacle)
        for i in present:
            # Nobody moves half a metre in a step, hence people farther from walls cannot leave free space.
            if desired[i, CLEARANCE] < 0.5 + _CLEAR:
                _stay_in_free_space(out, i, body, grid)
    for i in present:
        _update_motion(out, i, body, dt)
    return out


@njit(cache=True)
def _cell(grid: SteeringGrid, x: float, y: float) -> tuple[int, int, float, float]:
    """Row and column of the cell at (x, y) m, and the position in it, in [0, 1]. Points outside are clamped to the grid."""
    rows, columns = grid.maps.shape[0], grid.maps.shape[1]
    u = min(max((x - grid.frame[0]) / grid.frame[2], 0.0), columns - 1.0)
    v = min(max((y - grid.frame[1]) / grid.frame[2], 0.0), rows - 1.0)
    j, i = min(int(u), columns - 2), min(int(v), rows - 2)
    return i, j, u - j, v - i


@njit(cache=True)
def _map_value(grid: SteeringGrid, x: float, y: float, k: np.integer) -> float:
    """Map k at (x, y) m, bilinear."""
    i, j, u, v = _cell(grid, x, y)
    m = grid.maps
    return (1 - v) * ((1 - u) * m[i, j, k] + u * m[i, j + 1, k]) + v * ((1 - u) * m[i + 1, j, k] + u * m[i + 1, j + 1, k])


@njit(cache=True)
def _goal_direction(grid: SteeringGrid, goal: int, x: float, y: float) -> tuple[float, float]:
    """Unit direction at (x, y) m to a goal; straight for the last half metre."""
    ex, ey = grid.goals[goal, 0] - x, grid.goals[goal, 1] - y
    if ex * ex + ey * ey > 0.25:
        i, j, u, v = _cell(grid, x, y)
        w = grid.directions[goal]
        ex = (1 - v) * ((1 - u) * w[i, j, 0] + u * w[i, j + 1, 0]) + v * ((1 - u) * w[i + 1, j, 0] + u * w[i + 1, j + 1, 0])
        ey = (1 - v) * ((1 - u) * w[i, j, 1] + u * w[i, j + 1, 1]) + v * ((1 - u) * w[i + 1, j, 1] + u * w[i + 1, j + 1, 1])
    length = max(math.hypot(ex, ey), 1e-9)
    return ex / length, ey / length


@njit(cache=True)
def desired_motion(body: Array, grid: SteeringGrid, groups: tuple[Numbers, Array]) -> tuple[Array, bool]:
    """Desired motion (m, 6) of all people, and whether the directions to some goal are unknown. groups: group (m,), speed (m,) m/s.

    The desired motion is 0 during a pause.
    """
    group, speed = groups
    desired = np.zeros((len(body), 6))
    for i in np.flatnonzero(body[:, PRESENT] > 0):
        if not grid.known[int(body[i, GOAL])]:
            return desired, True
        x, y = body[i, X], body[i, Y]
        desired[i, CLEARANCE] = _map_value(grid, x, y, CLEARANCE_MAP)
        if body[i, PAUSE] > 0:
            continue
        ex, ey = _goal_direction(grid, int(body[i, GOAL]), x, y)
        ex, ey, pace = _group_cohesion(body, i, group, (ex, ey))
        # Tobler (1993): the speed is proportional to exp(−3.5 |slope + 0.05|); here with the slope of the next stride, and 1 on the level.
        rise = _map_value(grid, x + 0.5 * ex, y + 0.5 * ey, HEIGHT_MAP) - _map_value(grid, x - 0.2 * ex, y - 0.2 * ey, HEIGHT_MAP)
        slope = max(math.exp(-3.5 * (abs(rise / 0.7 + 0.05) - 0.05)), 0.3)
        desired[i, DIRECTION_X], desired[i, DIRECTION_Y], desired[i, SPEED] = ex, ey, speed[i] * slope * pace
        if desired[i, CLEARANCE] > BOTTLENECK_AHEAD + BOTTLENECK_HALF_WIDTH:
            continue
        if _is_bottleneck(grid, x, y, (ex, ey)):
            desired[i, IN_BOTTLENECK] = 1.0
        elif _is_bottleneck(grid, x + BOTTLENECK_AHEAD * ex, y + BOTTLENECK_AHEAD * ey, (ex, ey)):
            desired[i, BEFORE_BOTTLENECK] = 1.0
    return desired, False


@njit(cache=True)
def _is_bottleneck(grid: SteeringGrid, x: float, y: float, direction: tuple[float, float]) -> bool:
    """Whether (x, y) m is too narrow for two people across `direction`."""
    aside_x, aside_y = -BOTTLENECK_HALF_WIDTH * direction[1], BOTTLENECK_HALF_WIDTH * direction[0]
    return _map_value(grid, x + aside_x, y + aside_y, CLEARANCE_MAP) <= 0 and _map_value(grid, x - aside_x, y - aside_y, CLEARANCE_MAP) <= 0


@njit(cache=True)
def _group_cohesion(body: Array, i: Number, group: Numbers, direction: tuple[float, float]) -> tuple[float, float, float]:
    """Direction and factor of the speed that keep i in the group: towards its centre, slower ahead of it, faster behind it."""
    ex, ey = direction
    x = y = 0.0
    others = 0
    first = group[i]
    for j in range(first, len(body)):
        if group[j] != first:
            break
        if j != i and body[j, PRESENT] > 0 and body[j, GOAL] == body[i, GOAL]:
            x, y, others = x + body[j, X], y + body[j, Y], others + 1
    if not others:
        return ex, ey, 1.0
    dx, dy = x / others - body[i, X], y / others - body[i, Y]
    distance = math.hypot(dx, dy)
    # A person far from the group walks alone to the common goal.
    if distance < GROUP_DISTANCE or distance > 8.0:
        return ex, ey, 1.0
    ahead = dx * ex + dy * ey
    if distance < 3.0:
        pull = 0.5 * min(distance - GROUP_DISTANCE, 1.0) / distance
        ex, ey = ex + pull * (dx - ahead * ex), ey + pull * (dy - ahead * ey)
        length = max(math.hypot(ex, ey), 1e-9)
        ex, ey = ex / length, ey / length
    if ahead > GROUP_DISTANCE:
        return ex, ey, 1.15
    return ex, ey, min(max(1.0 + 0.35 * (ahead + GROUP_DISTANCE), 0.35), 1.0)


@njit(cache=True)
def _accelerate(out: Array, i: Number, inputs: tuple[Array, Array], grid: SteeringGrid, dt: float) -> None:
    """Move body i by the social force. inputs: its desired motion and interactions."""
    desired, effect = inputs
    ex, ey, speed = desired[DIRECTION_X], desired[DIRECTION_Y], min(desired[SPEED], effect[HEADWAY_SPEED])
    if effect[YIELDS] > 0:
        # Step to the right to let others through.
        ex, ey, speed = ey, -ex, 0.4 * (_map_value(grid, out[i, X] + 0.3 * ey, out[i, Y] - 0.3 * ex, CLEARANCE_MAP) > 0.1)
    if effect[ASKED_TO_YIELD] > 0:
        speed = 0.0
    ax = (ex * speed - out[i, VX]) / RELAXATION + effect[FORCE_X]
    ay = (ey * speed - out[i, VY]) / RELAXATION + effect[FORCE_Y]
    # The repulsion of a wall is negligible beyond ten times its range.
    if desired[CLEARANCE] < 10 * _WALL_RANGE:
        wall = _WALL_PUSH * math.exp(-max(desired[CLEARANCE], 0.0) / _WALL_RANGE)
        ax += wall * _map_value(grid, out[i, X], out[i, Y], AWAY_X_MAP)
        ay += wall * _map_value(grid, out[i, X], out[i, Y], AWAY_Y_MAP)
    vx, vy = out[i, VX] + ax * dt, out[i, VY] + ay * dt
    pace = math.hypot(vx, vy)
    along = (vx * math.cos(out[i, HEADING]) + vy * math.sin(out[i, HEADING])) / max(pace, 1e-9)
    # Sideways and backward motion is slow: people turn first. In a queue nobody is pushed beyond its speed.
    top = 1.3 * max(min(desired[SPEED], effect[HEADWAY_SPEED]), 0.3) * min(max(0.3 + 0.7 * along, 0.3), 1.0)
    if out[i, PAUSE] > 0:
        top = 0.5
        # People who pass do not push a standing person away.
        if pace < 0.12 and effect[ASKED_TO_YIELD] <= 0:
            top = 0.0
    share = min(1.0, top / max(pace, 1e-9))
    out[i, X] += vx * share * dt
    out[i, Y] += vy * share * dt


@njit(cache=True)
def _stay_in_free_space(out: Array, i: Number, body: Array, grid: SteeringGrid) -> None:
    """Move body i back into free space if it has left it; to its previous position if that fails."""
    short = _CLEAR - _map_value(grid, out[i, X], out[i, Y], CLEARANCE_MAP)
    tries = 0
    while short > 0 and tries < 3:
        x, y = out[i, X], out[i, Y]
        out[i, X] += (short + 0.01) * _map_value(grid, x, y, AWAY_X_MAP)
        out[i, Y] += (short + 0.01) * _map_value(grid, x, y, AWAY_Y_MAP)
        short = _CLEAR - _map_value(grid, out[i, X], out[i, Y], CLEARANCE_MAP)
        tries += 1
    if short >= _CLEAR:
        out[i, X], out[i, Y] = body[i, X], body[i, Y]


@njit(cache=True)
def _update_motion(out: Array, i: Number, body: Array, dt: float) -> None:
    """Update velocity, heading and pause of body i after its move."""
    vx, vy = (out[i, X] - body[i, X]) / dt, (out[i, Y] - body[i, Y]) / dt
    pace = math.hypot(vx, vy)
    share = min(1.0, _FASTEST / max(pace, 1e-9))
    out[i, VX], out[i, VY] = vx * share, vy * share
    if pace > 0.15:
        turn = math.atan2(vy, vx) - out[i, HEADING]
        turn = math.pi - (math.pi - turn) % (2 * math.pi)
        heading = out[i, HEADING] + min(max(turn, -TURN_RATE * dt), TURN_RATE * dt)
        out[i, HEADING] = math.pi - (math.pi - heading) % (2 * math.pi)
    if body[i, PAUSE] > 0:
        out[i, PAUSE] = max(body[i, PAUSE] - dt, 0.0)
        if out[i, PAUSE] <= 0:
            out[i, VISIT] += 1
        out[i, STUCK] = 0.0
    else:
        out[i, STUCK] += dt


@njit(cache=True)
def _separate_bodies(body: Array, pairs: Pairs, obstacle: Array) -> None:
    """Separate overlapping bodies of `pairs` (p, 2), half of the overlap each, and move bodies out of obstacles (k, 7)."""
    for p in range(len(pairs)):
        i, j = pairs[p]
        dx, dy = body[j, X] - body[i, X], body[j, Y] - body[i, Y]
        square = dx * dx + dy * dy
        if square < 4 * BODY_RADIUS * BODY_RADIUS:
            distance = max(math.sqrt(square), 1e-6)
            share = 0.5 * (2 * BODY_RADIUS - distance) / distance
            body[i, X] -= share * dx
            body[i, Y] -= share * dy
            body[j, X] += share * dx
            body[j, Y] += share * dy
    for o in range(len(obstacle)):
        touch = BODY_RADIUS + obstacle[o, 4]
        for i in range(len(body)):
            dx, dy = body[i, X] - obstacle[o, 0], body[i, Y] - obstacle[o, 1]
            square = dx * dx + dy * dy
            if square < touch * touch and body[i, PRESENT] > 0:
                distance = max(math.sqrt(square), 1e-6)
                body[i, X] += (touch / distance - 1.0) * dx
                body[i, Y] += (touch / distance - 1.0) * dy
