"""Where rovers can drive to and how: a sparse net of places over the room in which they can turn, with all shortest ways between them.

How a robot drives to a place of the roads: as far along its way as it can go straight, past others on the right. Compiled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from sim.placement.config import YAW, X, Y
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Mask

MOST = 500
"""Places of a net, about: its spacing is chosen for so many."""

FINEST, COARSEST = 0.45, 2.0
"""m between neighbouring places."""


@dataclass(frozen=True, eq=False)
class Roads:
    """places (n, 2) m; distance (n, n) m along the net; onward (n, n): the place after i on the way to j, or i itself. All hang together."""

    places: Array
    distance: Array
    onward: NDArray[np.int32]
    room: FreeSpace

    @staticmethod
    def of(room: FreeSpace) -> Roads:
        """The net of a room. A cell's place is where it has the most clearance; two are joined where the straight way between them is free."""
        spacing = float(np.clip(np.sqrt(room.area / MOST), FINEST, COARSEST))
        places, cell = _widest(room, spacing)
        links = _links(room, places, cell)
        _, label = csgraph.connected_components(links, directed=False)
        kept = np.flatnonzero(label == np.argmax(np.bincount(label)))
        distance, before = csgraph.shortest_path(links[kept][:, kept], directed=False, return_predecessors=True)
        onward = before.T.astype(np.int32)
        np.fill_diagonal(onward, np.arange(len(kept)))
        for array in (distance, onward):
            array.flags.writeable = False
        return Roads(places[kept], distance, onward, room)

    @property
    def ground(self) -> tuple[Mask, Array, float]:
        """What compiled code needs of the room: free (rows, columns), origin (2,) m and spacing m."""
        return self.room.free, self.room.origin, self.room.spacing

    def nearest(self, points: Array) -> NDArray[np.int64]:
        """(k, 2) m → (k,) the nearest place."""
        return nearest(points, self.places)


def nearest(points: Array, places: Array) -> NDArray[np.int64]:
    """(k, 2) m → (k,) the nearest of places (n, 2) m."""
    return np.asarray(((points[:, None] - places) ** 2).sum(axis=2).argmin(axis=1), dtype=np.int64)


def _widest(room: FreeSpace, spacing: float) -> tuple[Array, NDArray[np.int64]]:
    """(n, 2) m the place of each cell that has free ground, and (n, 2) the cell's column and row."""
    i, j = np.nonzero(room.free)
    points = room.origin + room.spacing * np.stack([j, i], axis=1)
    cell = np.floor((points - room.origin) / spacing).astype(np.int64)
    # As near to the cell's middle as can be, once there is room.
    off = np.abs(points - room.origin - (cell + 0.5) * spacing).max(axis=1)
    worth = np.minimum(room.clearance[i, j], 0.4) - 0.25 * off
    order = np.lexsort((-worth, cell[:, 0], cell[:, 1]))
    _, first = np.unique(cell[order], axis=0, return_index=True)
    chosen = order[np.sort(first)]
    return points[chosen], cell[chosen]


def _links(room: FreeSpace, places: Array, cell: NDArray[np.int64]) -> sparse.csr_matrix:
    """(n, n) m of the straight ways between places of neighbouring cells."""
    number = {(int(c), int(r)): k for k, (c, r) in enumerate(cell)}
    pairs, ground = [], (room.free, room.origin, room.spacing)
    for k, (c, r) in enumerate(cell.tolist()):
        for step in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2)):
            other = number.get((c + step[0], r + step[1]))
            if other is not None and straight(ground, places[k], places[other]):
                pairs.append((k, other))
    a, b = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return sparse.csr_matrix((np.hypot(*(places[a] - places[b]).T), (a, b)), shape=(len(places), len(places)))


@njit(cache=True)
def straight(room, a, b):  # type: ignore[no-untyped-def]
    """Whether the straight way from a to b, two coordinates m each, is free; room as in `Roads.ground`."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    steps = max(2, int(math.sqrt(dx * dx + dy * dy) / room[2] * 2) + 1)
    for k in range(steps):
        t = k / (steps - 1)
        if not is_free(room, a[0] + t * dx, a[1] + t * dy):
            return False
    return True


@njit(cache=True)
def is_free(room, x, y):  # type: ignore[no-untyped-def]
    """Whether the middle of a robot may be at (x, y) m."""
    free, origin, spacing = room
    j, i = int(np.rint((x - origin[0]) / spacing)), int(np.rint((y - origin[1]) / spacing))
    return 0 <= i < free.shape[0] and 0 <= j < free.shape[1] and free[i, j]


LANE, HALF_LANE = 1.5, 0.85
"""m ahead and to both sides in which others are driven around."""

AHEAD, CLOSE = 1.5, 0.3
"""m along the roads that are looked ahead; m within which a place has been reached."""

STOP = 0.15
"""m before an aim where a robot stands."""


@njit(cache=True)
def steer(team, goals, people, net, room):  # type: ignore[no-untyped-def]
    """(r, 2) m/s and rad/s: what robots at team (r, 7) are told who are on the way to the places goals (r,) of the roads, among people (p, 2) m.

    net: the roads' places (n, 2) m and onward (n, n). room: Roads.ground.
    """
    out = np.zeros((len(team), 2))
    others = np.empty((len(team) - 1 + len(people), 2))
    others[len(team) - 1 :] = people
    for k in range(len(team)):
        others[:k], others[k : len(team) - 1] = team[:k, :2], team[k + 1 :, :2]
        ax, ay = _aim(team[k, X], team[k, Y], goals[k], net, room)
        ax, ay = _around(team[k], (ax, ay), others, room)
        out[k, 0], out[k, 1] = _towards(team[k], ax, ay)
    return out


@njit(cache=True)
def _aim(x, y, goal, net, room):  # type: ignore[no-untyped-def]
    """Where to head for from (x, y) m on the way to the place `goal`: as far along it as one can go straight, up to AHEAD."""
    places, onward = net
    here, least = 0, 1e30
    for n in range(len(places)):
        square = (x - places[n, 0]) ** 2 + (y - places[n, 1]) ** 2
        if square < least:
            here, least = n, square
    aim, node = here, here
    if here == goal and least < CLOSE * CLOSE:
        return places[here, 0], places[here, 1]
    while node != goal:
        node = onward[node, goal]
        away = math.sqrt((places[node, 0] - x) ** 2 + (places[node, 1] - y) ** 2)
        if away > AHEAD or not straight(room, (x, y), (places[node, 0], places[node, 1])):
            break
        aim = node
    if node != here and (places[aim, 0] - x) ** 2 + (places[aim, 1] - y) ** 2 < CLOSE * CLOSE:
        aim = node
    return places[aim, 0], places[aim, 1]


@njit(cache=True)
def _around(robot, aim, others, room):  # type: ignore[no-untyped-def]
    """Where to head for in place of aim, where others (k, 2) m are in the way: past them on the right, else on the left, where there is room."""
    x, y = robot[X], robot[Y]
    distance = math.sqrt((aim[0] - x) ** 2 + (aim[1] - y) ** 2)
    if distance < STOP:
        return aim
    c, s = (aim[0] - x) / distance, (aim[1] - y) / distance
    if not _blocked(x, y, (c, s), others, (0.0, min(LANE, distance + 0.5))):
        return aim
    for turn in (-0.9, 0.9, -1.6, 1.6):
        wc, ws = math.cos(turn) * c - math.sin(turn) * s, math.sin(turn) * c + math.cos(turn) * s
        roomy = is_free(room, x + 0.4 * wc, y + 0.4 * ws) and is_free(room, x + 0.8 * wc, y + 0.8 * ws)
        if roomy and not _blocked(x, y, (wc, ws), others, (0.2, 1e30)):
            return x + wc, y + ws
    return aim


@njit(cache=True)
def _blocked(x, y, way, others, stretch):  # type: ignore[no-untyped-def]
    """Whether somebody is in the lane from (x, y) along the unit direction `way`, between so many m ahead and within LANE where that has no end."""
    for k in range(len(others)):
        dx, dy = others[k, 0] - x, others[k, 1] - y
        along, aside = dx * way[0] + dy * way[1], dy * way[0] - dx * way[1]
        if stretch[0] < along < stretch[1] and abs(aside) < HALF_LANE and (stretch[1] < 1e29 or dx * dx + dy * dy < LANE * LANE):
            return True
    return False


@njit(cache=True)
def _towards(robot, ax, ay):  # type: ignore[no-untyped-def]
    """m/s and rad/s of a robot (7,) that goes to (ax, ay) m: turns on the spot first where it looks elsewhere, and slows down before it."""
    dx, dy = ax - robot[X], ay - robot[Y]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < STOP:
        return 0.0, 0.0
    error = (math.atan2(dy, dx) - robot[YAW] + math.pi) % (2 * math.pi) - math.pi
    speed = min(TOP_SPEED, 1.2 * distance) * max(math.cos(error), 0.0) ** 2 if abs(error) < 0.7 else 0.0
    return speed, min(max(2.5 * error, -TOP_YAW_RATE), TOP_YAW_RATE)
