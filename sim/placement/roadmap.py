"""The roadmap of a map, with all shortest paths, and the steering of rovers along it (Kavraki et al. 1996).

A rover heads for the farthest node of its path along a free straight segment, and passes people and other rovers on the right.
The compiled kernels are in one file, because numba's cache does not notice a change of a kernel in another file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from sim.placement.config import YAW, X, Y
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Mask

NODES = 500
"""Approximate number of nodes, from which the spacing is chosen."""

MIN_SPACING, MAX_SPACING, MOST_NODES = 0.45, 2.0, 3000
"""Bounds of the spacing of nodes, m, and of their number. A map that would have more than MOST_NODES nodes gets a larger spacing."""

LANE_LENGTH, HALF_LANE_WIDTH = 1.5, 0.85
"""Length, and half the width, of the lane in which a robot avoids others, m."""

LOOKAHEAD, REACHED_DISTANCE = 1.5, 0.3
"""Look-ahead along the path, and distance within which a node is reached, m."""

STOP_DISTANCE = 0.15
"""Distance from the target at which a robot stops, m."""


@dataclass(frozen=True, eq=False)
class Roadmap:
    """A connected graph of nodes in free space, with all shortest paths.

    nodes (n, 2) m; distance (n, n) m along the graph; next_node (n, n): the node after i on the path to j, or i itself where i is j.
    """

    nodes: Array
    distance: Array
    next_node: NDArray[np.int32]
    free_space: FreeSpace

    @staticmethod
    def of(space: FreeSpace) -> Roadmap:
        """The roadmap of a free space. Each cell has a node where its clearance is largest. Free straight segments are edges."""
        spacing = max(float(np.clip(np.sqrt(space.area / NODES), MIN_SPACING, MAX_SPACING)), float(np.sqrt(space.area / MOST_NODES)))
        nodes, cell = _nodes(space, spacing)
        edges = _edges(space, nodes, cell)
        _, label = csgraph.connected_components(edges, directed=False)
        kept = np.flatnonzero(label == np.argmax(np.bincount(label)))
        distance, before = csgraph.shortest_path(edges[kept][:, kept], directed=False, return_predecessors=True)
        next_node = before.T.astype(np.int32)
        np.fill_diagonal(next_node, np.arange(len(kept)))
        for array in (distance, next_node):
            array.flags.writeable = False
        return Roadmap(nodes[kept], distance, next_node, space)

    @property
    def grid(self) -> tuple[Mask, Array, float]:
        """The free space as kernel arguments: free (rows, columns), origin (2,) m and spacing m."""
        return self.free_space.free, self.free_space.origin, self.free_space.spacing

    def nearest(self, points: Array) -> NDArray[np.int64]:
        """The nearest node (k,) to each of points (k, 2) m."""
        return np.asarray(nearest(points, self.nodes))


@njit(cache=True)
def nearest_node(nodes, x, y):  # type: ignore[no-untyped-def]
    """The nearest of nodes (n, 2) m to (x, y) m, and the square of its distance, m²."""
    start, least = 0, np.inf
    for n in range(len(nodes)):
        square = (x - nodes[n, 0]) ** 2 + (y - nodes[n, 1]) ** 2
        if square < least:
            start, least = n, square
    return start, least


@njit(cache=True)
def nearest(points, nodes):  # type: ignore[no-untyped-def]
    """The nearest (k,) of nodes (n, 2) m to each of points (k, 2) m."""
    out = np.empty(len(points), np.int64)
    for k in range(len(points)):
        out[k] = nearest_node(nodes, points[k, 0], points[k, 1])[0]
    return out


def _nodes(space: FreeSpace, spacing: float) -> tuple[Array, NDArray[np.int64]]:
    """The node (n, 2) m of each cell with free ground, and the cell's column and row (n, 2)."""
    points = space.points(space.free)
    cell = np.floor((points - space.origin) / spacing).astype(np.int64)
    # A clearance of 0.4 m is enough: beyond it, nodes near the middle of the cell are better.
    off = np.abs(points - space.origin - (cell + 0.5) * spacing).max(axis=1)
    score = np.minimum(space.clearance[space.free], 0.4) - 0.25 * off
    order = np.lexsort((-score, cell[:, 0], cell[:, 1]))
    _, first = np.unique(cell[order], axis=0, return_index=True)
    chosen = order[np.sort(first)]
    return points[chosen], cell[chosen]


def _edges(space: FreeSpace, nodes: Array, cell: NDArray[np.int64]) -> sparse.csr_matrix:
    """Lengths (n, n) m of the free straight segments between nodes of neighbouring cells."""
    number = {(int(c), int(r)): k for k, (c, r) in enumerate(cell)}
    pairs, grid = [], (space.free, space.origin, space.spacing)
    for k, (c, r) in enumerate(cell.tolist()):
        for step in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2)):
            other = number.get((c + step[0], r + step[1]))
            if other is not None and segment_is_free(grid, tuple(nodes[k]), tuple(nodes[other])):
                pairs.append((k, other))
    a, b = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return sparse.csr_matrix((np.hypot(*(nodes[a] - nodes[b]).T), (a, b)), shape=(len(nodes), len(nodes)))


@njit(cache=True)
def segment_is_free(space, a, b):  # type: ignore[no-untyped-def]
    """Whether the straight segment between points a and b (2,) m is free. space: as `Roadmap.grid`."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    steps = max(2, int(math.sqrt(dx * dx + dy * dy) / space[2] * 2) + 1)
    for k in range(steps):
        t = k / (steps - 1)
        if not is_free(space, a[0] + t * dx, a[1] + t * dy):
            return False
    return True


@njit(cache=True)
def is_free(space, x, y):  # type: ignore[no-untyped-def]
    """Whether the centre of a robot may be at (x, y) m."""
    free, origin, spacing = space
    j, i = int(np.rint((x - origin[0]) / spacing)), int(np.rint((y - origin[1]) / spacing))
    return 0 <= i < free.shape[0] and 0 <= j < free.shape[1] and free[i, j]


@njit(cache=True)
def steer(team, goals, people, graph, space):  # type: ignore[no-untyped-def]
    """Velocity commands (r, 2) m/s and rad/s of robots of states team (r, 7) to goal nodes goals (r,), among people (p, 2) m.

    graph: nodes (n, 2) m and next_node (n, n) of the roadmap. space: `Roadmap.grid`.
    """
    out = np.zeros((len(team), 2))
    others = np.empty((len(team) - 1 + len(people), 2))
    others[len(team) - 1 :] = people
    for k in range(len(team)):
        others[:k], others[k : len(team) - 1] = team[:k, :2], team[k + 1 :, :2]
        ax, ay = _target(team[k, X], team[k, Y], goals[k], graph, space)
        ax, ay = _avoid(team[k], (ax, ay), others, space)
        out[k, 0], out[k, 1] = _velocity(team[k], ax, ay)
    return out


@njit(cache=True)
def _target(x, y, goal, graph, space):  # type: ignore[no-untyped-def]
    """The target (x, y) m: the farthest node of the path to `goal` that a free straight segment reaches within LOOKAHEAD, or the next node."""
    nodes, next_node = graph
    start, least = nearest_node(nodes, x, y)
    target, node = start, start
    if start == goal and least < REACHED_DISTANCE * REACHED_DISTANCE:
        return nodes[start, 0], nodes[start, 1]
    while node != goal:
        node = next_node[node, goal]
        distance = math.sqrt((nodes[node, 0] - x) ** 2 + (nodes[node, 1] - y) ** 2)
        # The next node counts at any distance: nodes of a large map are farther apart than LOOKAHEAD.
        if (distance > LOOKAHEAD and target != start) or not segment_is_free(space, (x, y), (nodes[node, 0], nodes[node, 1])):
            break
        target = node
    if node != start and (nodes[target, 0] - x) ** 2 + (nodes[target, 1] - y) ** 2 < REACHED_DISTANCE * REACHED_DISTANCE:
        target = node
    return nodes[target, 0], nodes[target, 1]


@njit(cache=True)
def _avoid(robot, target, others, space):  # type: ignore[no-untyped-def]
    """The target, deflected where others (k, 2) m block the lane to it: to the right, else to the left, onto free ground."""
    x, y = robot[X], robot[Y]
    distance = math.sqrt((target[0] - x) ** 2 + (target[1] - y) ** 2)
    if distance < STOP_DISTANCE:
        return target
    c, s = (target[0] - x) / distance, (target[1] - y) / distance
    if not _blocked(x, y, (c, s), others, (0.0, min(LANE_LENGTH, distance + 0.5))):
        return target
    for turn in (-0.9, 0.9, -1.6, 1.6):
        tc, ts = math.cos(turn) * c - math.sin(turn) * s, math.sin(turn) * c + math.cos(turn) * s
        both_free = is_free(space, x + 0.4 * tc, y + 0.4 * ts) and is_free(space, x + 0.8 * tc, y + 0.8 * ts)
        if both_free and not _blocked(x, y, (tc, ts), others, (0.2, 1e30)):
            return x + tc, y + ts
    return target


@njit(cache=True)
def _blocked(x, y, direction, others, stretch):  # type: ignore[no-untyped-def]
    """Whether one of `others` is in the lane from (x, y) m along the unit vector `direction`.

    stretch: least and greatest distance along it, m. An infinite stretch (1e30) ends at the distance LANE_LENGTH.
    """
    for k in range(len(others)):
        dx, dy = others[k, 0] - x, others[k, 1] - y
        along, aside = dx * direction[0] + dy * direction[1], dy * direction[0] - dx * direction[1]
        if stretch[0] < along < stretch[1] and abs(aside) < HALF_LANE_WIDTH and (stretch[1] < 1e29 or dx * dx + dy * dy < LANE_LENGTH * LANE_LENGTH):
            return True
    return False


@njit(cache=True)
def _velocity(robot, ax, ay):  # type: ignore[no-untyped-def]
    """Speed m/s and yaw rate rad/s of a robot (7,) towards (ax, ay) m. It first turns on the spot, and slows down before the target."""
    dx, dy = ax - robot[X], ay - robot[Y]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < STOP_DISTANCE:
        return 0.0, 0.0
    error = (math.atan2(dy, dx) - robot[YAW] + math.pi) % (2 * math.pi) - math.pi
    speed = min(TOP_SPEED, 1.2 * distance) * max(math.cos(error), 0.0) ** 2 if abs(error) < 0.7 else 0.0
    return speed, min(max(2.5 * error, -TOP_YAW_RATE), TOP_YAW_RATE)
