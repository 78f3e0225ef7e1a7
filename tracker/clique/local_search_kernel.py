"""The inner loop of breakout local search for maximum-weight cliques, compiled: state, moves and perturbations (Benlic & Hao 2013).

C is the clique. A vertex outside C is of kind PA without a conflict with C, OM with one, OC with more. Vertices of a kind are listed in an array,
so that a move takes time proportional to the conflicts of the moved vertex.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints
from tracker.geometry.compilation import njit

Words = NDArray[np.uint64]

OC, PA, OM, C = 0, 1, 2, 3
"""Kinds of vertices."""

MOVES, OMEGA, STRENGTH, KEPT = 0, 1, 2, 3
"""Indices of SearchState.counters: moves, local optima since the last new best, strength of the perturbation, local optima kept."""

WEIGHT, BEST = 0, 1
"""Indices of SearchState.totals: weight of the clique, weight of the best clique."""

# A state is some twenty arrays; passing it between functions that are not inlined takes a sixth of a search.
_inlined = njit(cache=True, forceinline=True)


class SearchState(NamedTuple):
    """The state of a search; every field is an array that it changes.

    weight, start, conflict: the graph. kind (n,); member (4, n): vertices of each kind, size (4,): their number, place (n,): index of each there.
    blocks (n,): number of conflicts with C; blocker, load (n,): sums of the numbers and of the weights of those vertices of C.
    tabu (n,): move up to which a vertex is tabu. key (n,): random words, whose xor is the hash of a clique. word (3,): state of the random
    generator, hash of C, hash of the last local optimum. best (n,): the best clique. kept (k, n), kept_weight (k,), kept_hash (k,): local optima.
    counters, totals: see above.
    """

    weight: Array
    start: Ints
    conflict: Ints
    kind: Ints
    member: Ints
    size: Ints
    place: Ints
    blocks: Ints
    blocker: Ints
    load: Array
    tabu: Ints
    key: Words
    word: Words
    best: NDArray[np.bool_]
    kept: NDArray[np.bool_]
    kept_weight: Array
    kept_hash: Words
    counters: Ints
    totals: Array


def initial_state(weight: Array, start: Ints, conflict: Ints, seed: np.uint64, keep: int) -> SearchState:
    """The state with an empty clique."""
    n = len(weight)
    rng = np.random.default_rng(int(seed))
    key = rng.integers(1, np.iinfo(np.uint64).max, n, dtype=np.uint64)
    member = np.zeros((4, n), dtype=np.int64)
    member[PA] = np.arange(n)
    word = np.array([rng.integers(1, np.iinfo(np.uint64).max, dtype=np.uint64), 0, 0], dtype=np.uint64)
    return SearchState(
        weight, start, conflict, np.full(n, PA), member, np.array([0, n, 0, 0]), np.arange(n), np.zeros(n, np.int64), np.zeros(n, np.int64),
        np.zeros(n), np.full(n, -1), key, word, np.zeros(n, np.bool_), np.zeros((keep, n), np.bool_), np.full(keep, -np.inf),
        np.zeros(keep, np.uint64), np.zeros(4, np.int64), np.zeros(2),
    )  # fmt: skip


def local_optima(state: SearchState) -> tuple[tuple[float, Ints], ...]:
    """The local optima that are kept, the heaviest first, each a pair of weight and vertices."""
    order = np.argsort(-state.kept_weight, kind="stable")[: int(state.counters[KEPT])]
    row, vertex = np.nonzero(state.kept[order])
    sets = np.split(vertex, np.searchsorted(row, np.arange(1, len(order))))
    # np.split gives one set even where there is no optimum.
    return tuple(zip(state.kept_weight[order].tolist(), sets, strict=False))


@_inlined
def _random(word: Words) -> float:
    """The next number in [0, 1): xorshift64* (Vigna 2016)."""
    x = word[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    word[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@_inlined
def _reclassify(s: Any, v: int, kind: int) -> None:
    """Move a vertex to the list of another kind."""
    old, at = s.kind[v], s.place[v]
    s.size[old] -= 1
    last = s.member[old, s.size[old]]
    s.member[old, at], s.place[last] = last, at
    s.kind[v], s.place[v] = kind, s.size[kind]
    s.member[kind, s.size[kind]] = v
    s.size[kind] += 1


@_inlined
def _kind_by_blocks(blocks: int) -> int:
    return PA if blocks == 0 else (OM if blocks == 1 else OC)


@_inlined
def _add(s: Any, v: int) -> None:
    """Add v, of kind PA, to C."""
    _reclassify(s, v, C)
    s.totals[WEIGHT] += s.weight[v]
    s.word[1] ^= s.key[v]
    for k in range(s.start[v], s.start[v + 1]):
        u = s.conflict[k]
        s.blocks[u] += 1
        s.blocker[u] += v
        s.load[u] += s.weight[v]
        if s.blocks[u] <= 2:
            _reclassify(s, u, _kind_by_blocks(s.blocks[u]))


@_inlined
def _drop(s: Any, v: int, tenure: float) -> None:
    """Remove v from C; it is tabu for that many moves and a random number more."""
    _reclassify(s, v, PA)
    s.totals[WEIGHT] -= s.weight[v]
    s.word[1] ^= s.key[v]
    s.tabu[v] = s.counters[MOVES] + int(tenure + _random(s.word) * s.size[OM])
    for k in range(s.start[v], s.start[v + 1]):
        u = s.conflict[k]
        s.blocks[u] -= 1
        s.blocker[u] -= v
        s.load[u] -= s.weight[v]
        if s.blocks[u] <= 1:
            _reclassify(s, u, _kind_by_blocks(s.blocks[u]))


@_inlined
def _insert(s: Any, v: int, phi: float) -> None:
    """Add v to C, and remove the vertices of C that it excludes."""
    if s.blocks[v] == 1:
        _drop(s, s.blocker[v], phi)
    elif s.blocks[v]:
        for k in range(s.start[v], s.start[v + 1]):
            if s.kind[s.conflict[k]] == C:
                _drop(s, s.conflict[k], phi)
    _add(s, v)
    s.counters[MOVES] += 1


@njit(cache=True)
def construct(s: Any, vertices: Ints, greedy: bool) -> None:
    """Start from these vertices; if greedy, add the heaviest vertex of PA until there is none."""
    for v in vertices:
        _add(s, v)
    while greedy and s.size[PA]:
        best = s.member[PA, 0]
        for k in range(s.size[PA]):
            v = s.member[PA, k]
            # Ties are broken at random.
            if s.weight[v] > s.weight[best] or (s.weight[v] == s.weight[best] and _random(s.word) < 0.3):
                best = v
        _add(s, best)


@_inlined
def _ascend(s: Any, phi: float, cap: int) -> None:
    """Steepest ascent: the best add or swap, while the weight grows."""
    while s.counters[MOVES] < cap:
        best, gain = -1, 0.0
        for k in range(s.size[PA]):
            v = s.member[PA, k]
            if s.weight[v] > gain:
                best, gain = v, s.weight[v]
        for k in range(s.size[OM]):
            v = s.member[OM, k]
            if s.weight[v] - s.load[v] > gain * (1 + 1e-12) + 1e-12:
                best, gain = v, s.weight[v] - s.load[v]
        if best < 0:
            return
        _insert(s, best, phi)


@_inlined
def _perturb_directed(s: Any, phi: float) -> None:
    """Directed perturbation: the best add, swap or drop that is not tabu or gives a new best; ties are broken at random."""
    best, gain, equal, drops = -1, -np.inf, 0, False
    now, missing = s.counters[MOVES], s.totals[BEST] - s.totals[WEIGHT]
    for kind in (PA, OM):
        for k in range(s.size[kind]):
            v = s.member[kind, k]
            g = s.weight[v] - s.load[v] if kind == OM else s.weight[v]
            if s.tabu[v] >= now and g <= missing + 1e-9:
                continue
            if g > gain:
                best, gain, equal = v, g, 1
            elif g == gain:
                equal += 1
                if _random(s.word) * equal < 1:
                    best = v
    for k in range(s.size[C]):
        v = s.member[C, k]
        if -s.weight[v] > gain:
            best, gain, equal, drops = v, -s.weight[v], 1, True
        elif -s.weight[v] == gain:
            equal += 1
            if _random(s.word) * equal < 1:
                best, drops = v, True
    if best < 0:
        # All moves are tabu; the counter advances.
        s.counters[MOVES] += 1
        return
    if drops and s.kind[best] == C:
        _drop(s, best, phi)
        s.counters[MOVES] += 1
    else:
        _insert(s, best, phi)


@_inlined
def _perturb_random(s: Any, phi: float, alpha: float) -> None:
    """Random perturbation: insert a random vertex of those that leave at least alpha of the weight."""
    least = alpha * s.totals[WEIGHT]
    chosen, seen = -1, 0
    for v in range(len(s.weight)):
        if s.kind[v] != C and s.weight[v] + s.totals[WEIGHT] - s.load[v] >= least:
            seen += 1
            if _random(s.word) * seen < 1:
                chosen = v
    if chosen >= 0:
        _insert(s, chosen, phi)
    else:
        s.counters[MOVES] += 1


@_inlined
def _keep(s: Any) -> None:
    """Keep this local optimum if it is new and heavier than the lightest that is kept."""
    worst = 0
    for k in range(len(s.kept_weight)):
        if k < s.counters[KEPT] and s.kept_hash[k] == s.word[1]:
            return
        if s.kept_weight[k] < s.kept_weight[worst]:
            worst = k
    if s.totals[WEIGHT] > s.kept_weight[worst]:
        s.counters[KEPT] = min(s.counters[KEPT] + 1, len(s.kept_weight))
        s.kept_weight[worst], s.kept_hash[worst] = s.totals[WEIGHT], s.word[1]
        for v in range(len(s.weight)):
            s.kept[worst, v] = s.kind[v] == C


@_inlined
def _at_local_optimum(s: Any, T: float, low: float, high: float) -> bool:
    """At a local optimum: update the best clique and the strength of the next perturbation; return whether the search stagnates."""
    _keep(s)
    if s.totals[WEIGHT] > s.totals[BEST] * (1 + 1e-12):
        s.totals[BEST] = s.totals[WEIGHT]
        s.counters[OMEGA] = 0
        for v in range(len(s.weight)):
            s.best[v] = s.kind[v] == C
    else:
        s.counters[OMEGA] += 1
    stagnates = s.counters[OMEGA] > T
    if stagnates:
        s.counters[OMEGA], s.counters[STRENGTH] = 0, int(high)
    elif s.word[1] == s.word[2]:
        s.counters[STRENGTH] += 1
    else:
        s.counters[STRENGTH] = int(low)
    s.word[2] = s.word[1]
    return stagnates


@njit(cache=True)
def run(s: Any, numbers: tuple[float, ...], cap: int, target: float) -> None:
    """Search until `cap` moves in all or the target weight; numbers: T, L0, Lmax, P0, α_r, α_s, φ; L0 and Lmax in vertices."""
    T, low, high, least_directed, alpha_r, alpha_s, phi = numbers
    while True:
        _ascend(s, phi, cap)
        stagnates = _at_local_optimum(s, T, low, high)
        if s.counters[MOVES] >= cap or s.totals[BEST] >= target:
            return
        directed = not stagnates and _random(s.word) < max(math.exp(-s.counters[OMEGA] / T), least_directed)
        for _ in range(s.counters[STRENGTH]):
            if s.counters[MOVES] >= cap:
                return
            if directed:
                _perturb_directed(s, phi)
            else:
                _perturb_random(s, phi, alpha_s if stagnates else alpha_r)
