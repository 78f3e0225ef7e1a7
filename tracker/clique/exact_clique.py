"""The maximum-weight clique of a small graph, proved: by Lagrangian bounds (set_packing.py), or by branch and bound with weighted colouring.

Vertices that pairwise exclude each other form a class, of which a clique holds at most one. No clique weighs more than the sum of the heaviest
vertices of the classes (Kumlander 2004, On importance of a special sorting in the maximum-weight clique algorithm).
Sets of vertices are bitsets, as in San Segundo et al. (2011).
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.clique.local_search import Found, Graph
from tracker.clique.set_packing import Effort, heaviest_clique
from tracker.geometry import Array
from tracker.geometry.compilation import njit

Words = NDArray[np.uint64]
LARGEST = 2000
"""Greatest number of vertices of a graph; the memory of the branches grows with its square."""
_DEBRUIJN = np.uint64(0x03F79D71B4CB0A89)
_ZEROS = np.zeros(64, dtype=np.int64)
for _k in range(64):
    _ZEROS[((1 << _k) * 0x03F79D71B4CB0A89 % (1 << 64)) >> 58] = _k


def exact(graph: Graph, seconds: float = 60.0) -> Found:
    """The heaviest clique, proved; `moves` counts the branches of branch and bound by colouring.

    Raises ValueError for a graph of more than LARGEST vertices, or where the proof takes more than `seconds`.
    """
    n = len(graph)
    if n > LARGEST:
        raise ValueError(f"graph has {n} vertices, an exact solution needs at most {LARGEST}")
    began = time.perf_counter()
    known, proved = heaviest_clique(graph, np.zeros(0, dtype=np.int64), Effort(branches=0))
    weight = float(graph.weight[known].sum())
    if proved:
        return Found(weight, known, 0, time.perf_counter() - began, ((weight, known),))
    state, order = _initial_state(graph)
    state[6][np.argsort(order)[known]] = True
    state[8][0] = weight
    while not _branch(state, 200_000):
        if time.perf_counter() - began > seconds:
            raise ValueError(f"no proof after {seconds} s; breakout local search has no such limit")
    best = np.sort(order[np.flatnonzero(state[6])])
    weight = float(graph.weight[best].sum())
    return Found(weight, best, int(state[7][1]), time.perf_counter() - began, ((weight, best),))


def _initial_state(graph: Graph) -> tuple[tuple[Any, ...], NDArray[np.int64]]:
    """The state before the first branch, and the vertices by descending weight: the first of a class is then its heaviest.

    weight, adjacent; by depth: branch (vertices to try), bound (of each), left (their number); chosen (the clique); best; numbers (depth,
    branches); heaviest (weight of best); free: by depth the vertices that can be added.
    """
    n = len(graph)
    order = np.argsort(-graph.weight, kind="stable")
    rank = np.argsort(order)
    together = ~np.eye(n, dtype=bool)
    together[rank[np.repeat(np.arange(n), np.diff(graph.start))], rank[graph.conflict]] = False
    free = np.zeros((n + 1, max(1, -(-n // 64))), dtype=np.uint64)
    free[0] = _bits(np.ones((1, n), dtype=bool))[0]
    state = (
        graph.weight[order], _bits(together), np.zeros((n + 1, n), np.int64), np.zeros((n + 1, n)), np.full(n + 1, -1), np.zeros(n + 1, np.int64),
        np.zeros(n, np.bool_), np.zeros(2, np.int64), np.zeros(1), free,
    )  # fmt: skip
    return state, order


def _bits(rows: NDArray[np.bool_]) -> Words:
    """Rows of bits (r, words) of rows of booleans (r, n)."""
    r, n = rows.shape
    words = max(1, -(-n // 64))
    padded = np.zeros((r, 64 * words), dtype=np.uint8)
    padded[:, :n] = rows
    return np.packbits(padded, axis=1, bitorder="little").view(np.uint64).reshape(r, words)


@njit(cache=True)
def _first(word: np.uint64) -> int:
    """The index of the lowest bit that is set, by a de Bruijn sequence."""
    return _ZEROS[((word & (~word + np.uint64(1))) * _DEBRUIJN) >> np.uint64(58)]


@njit(cache=True)
def _colour(weight: Array, adjacent: Words, free: Words, branch: NDArray[np.int64], bound: Array) -> int:
    """Colour free vertices greedily: write them to `branch` by class, and to `bound` the weight of the classes so far; return their number."""
    words = len(free)
    rest = free.copy()
    count, total = 0, 0.0
    while True:
        candidates, first = rest.copy(), True
        for w in range(words):
            while candidates[w]:
                v = 64 * w + _first(candidates[w])
                if first:
                    total += weight[v]
                    first = False
                branch[count], bound[count] = v, total
                count += 1
                bit = np.uint64(1) << np.uint64(v % 64)
                rest[w] &= ~bit
                candidates[w] &= ~bit
                for k in range(w, words):
                    candidates[k] &= ~adjacent[v, k]
        if first:
            return count


@njit(cache=True)
def _branch(state: Any, cap: int) -> bool:
    """Explore at most `cap` more branches; return whether the search is complete."""
    weight, adjacent, branch, bound, left, chosen, best, numbers, heaviest, free = state
    depth, stop = numbers[0], numbers[1] + cap
    here = 0.0
    for d in range(depth):
        here += weight[chosen[d]]
    if left[0] < 0:
        left[0] = _colour(weight, adjacent, free[0], branch[0], bound[0])
    while numbers[1] < stop:
        k = left[depth] - 1
        if k < 0 or here + bound[depth, k] <= heaviest[0] * (1 + 1e-12):
            if depth == 0:
                return True
            depth -= 1
            here -= weight[chosen[depth]]
            continue
        v = branch[depth, k]
        left[depth] = k
        free[depth, v // 64] &= ~(np.uint64(1) << np.uint64(v % 64))
        chosen[depth] = v
        here += weight[v]
        free[depth + 1] = free[depth] & adjacent[v]
        depth += 1
        numbers[1] += 1
        left[depth] = _colour(weight, adjacent, free[depth], branch[depth], bound[depth])
        if left[depth] == 0 and here > heaviest[0] * (1 + 1e-12):
            heaviest[0] = here
            best[:] = False
            for d in range(depth):
                best[chosen[d]] = True
        numbers[0] = depth
    numbers[0] = depth
    return False
