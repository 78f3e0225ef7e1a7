"""Where rovers can drive to and how: a sparse net of places over the room in which they can turn, with all shortest ways between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from tracker.geometry import Array
from worlds.heightfield import Mask
from worlds.walkable import Walkable

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
    room: Walkable

    @staticmethod
    def of(room: Walkable) -> Roads:
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


def _widest(room: Walkable, spacing: float) -> tuple[Array, NDArray[np.int64]]:
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


def _links(room: Walkable, places: Array, cell: NDArray[np.int64]) -> sparse.csr_matrix:
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
