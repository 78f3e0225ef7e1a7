"""Motion of pedestrians: social force, headway, right of way, and steering on the grid of free space. Compiled, single-threaded, in a fixed order.

The social force and its constants are those of Moussaïd et al. (2009), Experimental study of the behavioural mechanisms underlying
self-organization in human crowds, Proc. R. Soc. B 276. The speed behind another person follows the headway law of Tordeux, Chraibi and
Seyfried (2016), Collision-free speed model for pedestrian dynamics, eq. 2: speed = (distance − length) / time gap.
Kernels that call each other are in one file.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

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
RELAXATION = 0.54
"""s: relaxation time towards the desired velocity (Moussaïd et al. 2009)."""
TURN_RATE = 2.5
"""rad/s: speed at which a body turns into its direction of motion."""
BOTTLENECK_AHEAD, BOTTLENECK_HALF_WIDTH = 0.7, 0.4
"""m: distance at which a bottleneck is recognized; half width below which a passage is a bottleneck."""
GROUP_DISTANCE = 0.8
"""m: distance to the centre of the rest of the group beyond which a person waits or hurries."""
CLEARANCE_MAP, AWAY_X_MAP, AWAY_Y_MAP, HEIGHT_MAP = np.arange(4)
"""Numbers of a grid's maps. They are NumPy integers, since numba compiles a function anew for each literal argument."""
_WALL_PUSH, _WALL_RANGE = 3.0, 0.1
_CLEAR = 0.02
_FASTEST = 2.5


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
    # Neighbouring cells in a row are one run of `order`: this cell's rest with the next cell, and three cells of the next row.
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
        # Tobler (1993): the speed is proportional to exp(−3.5 |slope + 0.05|); here with the slope of the next stride, and 1 on level ground.
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
