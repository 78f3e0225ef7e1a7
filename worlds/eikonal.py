"""How far it is through free space, where some metres count more than others."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from worlds.heightfield import Array, Mask

# (row, column) steps to half of the eight neighbours; the other half is the way back.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def links(free: Mask, cost: Array) -> sparse.csr_matrix:
    """Free grid points (rows, columns), each linked with its free neighbours by the mean cost of both; none across a blocked corner."""
    rows, columns = free.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    starts, ends, costs = [], [], []
    for di, dj in _NEIGHBOURS:
        here = (slice(0, rows - di), slice(max(0, -dj), columns - max(0, dj)))
        there = (slice(di, rows), slice(max(0, dj), columns - max(0, -dj)))
        passable = free[here] & free[there]
        if di and dj:
            passable &= free[here[0], there[1]] & free[there[0], here[1]]
        starts.append(number[here][passable])
        ends.append(number[there][passable])
        costs.append(np.hypot(di, dj) * 0.5 * (cost[here] + cost[there])[passable])
    shape = (rows * columns, rows * columns)
    return sparse.csr_matrix((np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))), shape=shape)


def distance(graph: sparse.csr_matrix, cost: Array, start: int) -> Array:
    """(rows, columns) how far each grid point is from the flat index `start`; inf where there is no way. cost (rows, columns) a cell.

    Dijkstra's over the links knows eight directions only; then it is relaxed to the eikonal equation |∇T| = cost, which knows all
    (Sethian 1996, "A fast marching level set method"; Godunov's upwind differences, here from all sides at once until nothing changes).
    """
    field = csgraph.dijkstra(graph, directed=False, indices=start).reshape(cost.shape)
    T = np.pad(field, 1, constant_values=np.inf)
    i, j = np.nonzero(np.isfinite(field) & (field > 0))
    here = (i + 1) * T.shape[1] + j + 1
    flat, c = T.ravel(), cost[i, j]
    for _ in range(2 * sum(field.shape)):
        a = np.minimum(flat[here - 1], flat[here + 1])
        b = np.minimum(flat[here - T.shape[1]], flat[here + T.shape[1]])
        near, far = np.minimum(a, b), np.maximum(a, b)
        # Where the farther neighbour is out of reach only the nearer one counts; both formulas agree there.
        gap = np.minimum(far - near, c)
        new = np.minimum(flat[here], near + 0.5 * (gap + np.sqrt(2 * c**2 - gap**2)))
        change = float((flat[here] - new).max(initial=0.0))
        flat[here] = new
        if change < 1e-4:
            break
    return T[1:-1, 1:-1].copy()
