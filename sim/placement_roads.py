"""Where rovers can drive to and how: a sparse net of places over the room in which they can turn, with all shortest ways between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from tracker.geometry import Array
from worlds.walkable import Walkable

MOST = 500
"""Places of a net, about: its spacing is chosen for so many."""
FINEST, COARSEST = 0.45, 2.0
"""m between neighbouring places."""
_CLOSE = 0.3
"""m: a place that one has come so near to has been reached."""


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

    def nearest(self, points: Array) -> NDArray[np.int64]:
        """(k, 2) m → (k,) the nearest place."""
        gap = ((points[:, None] - self.places) ** 2).sum(axis=2)
        return np.asarray(np.argmin(gap, axis=1), dtype=np.int64)

    def aim(self, point: Array, goal: int, ahead: float = 1.5) -> Array:
        """(2,) m to head for from point (2,) m on the way to the place `goal`: as far along it as one can go straight, up to `ahead` m."""
        here = int(self.nearest(point[None])[0])
        aim = self.places[here]
        if here == goal and np.hypot(*(aim - point)) < _CLOSE:
            return aim
        node = here
        while node != goal:
            node = int(self.onward[node, goal])
            if np.hypot(*(self.places[node] - point)) > ahead or not _straight(self.room, point, self.places[node]):
                break
            aim = self.places[node]
        if np.hypot(*(aim - point)) < _CLOSE and node != here:
            return self.places[node]
        return aim


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
    pairs = []
    for k, (c, r) in enumerate(cell.tolist()):
        for step in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2)):
            other = number.get((c + step[0], r + step[1]))
            if other is not None and _straight(room, places[k], places[other]):
                pairs.append((k, other))
    a, b = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return sparse.csr_matrix((np.hypot(*(places[a] - places[b]).T), (a, b)), shape=(len(places), len(places)))


def _straight(room: Walkable, a: Array, b: Array) -> bool:
    """Whether the straight way from a to b (2,) m is free."""
    steps = max(2, int(np.hypot(*(b - a)) / room.spacing * 2) + 1)
    return bool(room.free_at(a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)).all())
