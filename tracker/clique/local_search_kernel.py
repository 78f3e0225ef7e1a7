"""The inner loop of breakout local search for maximum-weight cliques, compiled: its state, its moves, its jumps.

With C the clique, every other vertex is one of: PA, in no conflict with C; OM, in conflict with one vertex of C; OC, with more. Vertices lie in
one array a kind, so that a move costs as many steps as the moved vertex has conflicts.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array, Ints

Words = NDArray[np.uint64]

OC, PA, OM, C = 0, 1, 2, 3
"""Kinds of vertices."""

MOVES, OMEGA, STRENGTH, KEPT = 0, 1, 2, 3
"""Places in State.tally: moves so far, local optima since the last new best, strength of the jump, local optima kept."""

WEIGHT, BEST = 0, 1
"""Places in State.real: of the clique now, of the best."""

# A state is some twenty arrays: handing it from function to function takes a sixth of a search.
_inlined = njit(cache=True, forceinline=True)


class SearchState(NamedTuple):
    """All that a search knows; every field is an array that it changes.

    weight, start, conflict: the graph. kind (n,); member (4, n) the vertices of each kind, size (4,) how many, place (n,) where each is.
    blocks (n,): how many of C a vertex is in conflict with, blocker (n,) the sum of their numbers, load (n,) of their weights. tabu (n,): the
    move up to which it stays out. key (n,) random words whose xor names a clique; word (3,): the generator, the name of C, the name of the last
    local optimum. best (n,): the best clique. kept (k, n), kept_weight (k,), kept_name (k,): local optima. tally, real: see above.
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
    kept_name: Words
    tally: Ints
    real: Array


def begin(weight: Array, start: Ints, conflict: Ints, seed: np.uint64, keep: int) -> SearchState:
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


def remembered(state: SearchState) -> tuple[tuple[float, Ints], ...]:
    """The local optima kept, the heaviest first."""
    order = np.argsort(-state.kept_weight, kind="stable")[: int(state.tally[KEPT])]
    row, vertex = np.nonzero(state.kept[order])
    sets = np.split(vertex, np.searchsorted(row, np.arange(1, len(order))))
    # Without any optimum there is one set too many.
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
def _sort(s: Any, v: int, kind: int) -> None:
    """Put a vertex among those of another kind."""
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
    """v of PA into C."""
    _sort(s, v, C)
    s.real[WEIGHT] += s.weight[v]
    s.word[1] ^= s.key[v]
    for k in range(s.start[v], s.start[v + 1]):
        u = s.conflict[k]
        s.blocks[u] += 1
        s.blocker[u] += v
        s.load[u] += s.weight[v]
        if s.blocks[u] <= 2:
            _sort(s, u, _kind_by_blocks(s.blocks[u]))


@_inlined
def _drop(s: Any, v: int, stay_out: float) -> None:
    """v out of C; it stays out for so many moves."""
    _sort(s, v, PA)
    s.real[WEIGHT] -= s.weight[v]
    s.word[1] ^= s.key[v]
    s.tabu[v] = s.tally[MOVES] + int(stay_out + _random(s.word) * s.size[OM])
    for k in range(s.start[v], s.start[v + 1]):
        u = s.conflict[k]
        s.blocks[u] -= 1
        s.blocker[u] -= v
        s.load[u] -= s.weight[v]
        if s.blocks[u] <= 1:
            _sort(s, u, _kind_by_blocks(s.blocks[u]))


@_inlined
def _insert(s: Any, v: int, phi: float) -> None:
    """v into C, and out of C what is in conflict with it."""
    if s.blocks[v] == 1:
        _drop(s, s.blocker[v], phi)
    elif s.blocks[v]:
        for k in range(s.start[v], s.start[v + 1]):
            if s.kind[s.conflict[k]] == C:
                _drop(s, s.conflict[k], phi)
    _add(s, v)
    s.tally[MOVES] += 1


@njit(cache=True)
def take(s: Any, vertices: Ints, greedy: bool) -> None:
    """Begin with these vertices; then, if greedy, with the heaviest that fits, again and again."""
    for v in vertices:
        _add(s, v)
    while greedy and s.size[PA]:
        best = s.member[PA, 0]
        for k in range(s.size[PA]):
            v = s.member[PA, k]
            # Between equals, one of them.
            if s.weight[v] > s.weight[best] or (s.weight[v] == s.weight[best] and _random(s.word) < 0.3):
                best = v
        _add(s, best)


@_inlined
def _climb(s: Any, phi: float, cap: int) -> None:
    """The best of add and swap while it gains."""
    while s.tally[MOVES] < cap:
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
def _directed(s: Any, phi: float) -> None:
    """The best of add, swap and drop that is not tabu, or leads to a new best; between equals, one of them at random."""
    best, gain, equal, drops = -1, -np.inf, 0, False
    now, missing = s.tally[MOVES], s.real[BEST] - s.real[WEIGHT]
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
        # All is tabu: time passes.
        s.tally[MOVES] += 1
        return
    if drops and s.kind[best] == C:
        _drop(s, best, phi)
        s.tally[MOVES] += 1
    else:
        _insert(s, best, phi)


@_inlined
def _anywhere(s: Any, phi: float, alpha: float) -> None:
    """A vertex at random of those whose insertion leaves at least alpha of the weight."""
    least = alpha * s.real[WEIGHT]
    chosen, seen = -1, 0
    for v in range(len(s.weight)):
        if s.kind[v] != C and s.weight[v] + s.real[WEIGHT] - s.load[v] >= least:
            seen += 1
            if _random(s.word) * seen < 1:
                chosen = v
    if chosen >= 0:
        _insert(s, chosen, phi)
    else:
        s.tally[MOVES] += 1


@_inlined
def _keep(s: Any) -> None:
    """Remember this local optimum, if it is new and heavier than the lightest that is kept."""
    worst = 0
    for k in range(len(s.kept_weight)):
        if k < s.tally[KEPT] and s.kept_name[k] == s.word[1]:
            return
        if s.kept_weight[k] < s.kept_weight[worst]:
            worst = k
    if s.real[WEIGHT] > s.kept_weight[worst]:
        s.tally[KEPT] = min(s.tally[KEPT] + 1, len(s.kept_weight))
        s.kept_weight[worst], s.kept_name[worst] = s.real[WEIGHT], s.word[1]
        for v in range(len(s.weight)):
            s.kept[worst, v] = s.kind[v] == C


@_inlined
def _optimum(s: Any, T: float, low: float, high: float) -> bool:
    """What is done at a local optimum: the books, and the strength of the next jump; whether the search stagnates."""
    _keep(s)
    if s.real[WEIGHT] > s.real[BEST] * (1 + 1e-12):
        s.real[BEST] = s.real[WEIGHT]
        s.tally[OMEGA] = 0
        for v in range(len(s.weight)):
            s.best[v] = s.kind[v] == C
    else:
        s.tally[OMEGA] += 1
    stagnates = s.tally[OMEGA] > T
    if stagnates:
        s.tally[OMEGA], s.tally[STRENGTH] = 0, int(high)
    elif s.word[1] == s.word[2]:
        s.tally[STRENGTH] += 1
    else:
        s.tally[STRENGTH] = int(low)
    s.word[2] = s.word[1]
    return stagnates


@njit(cache=True)
def run(s: Any, numbers: tuple[float, ...], cap: int, target: float) -> None:
    """Search until `cap` moves were made in all or the target weight is reached; numbers: T, L0, Lmax, P0, α_r, α_s, φ."""
    T, low, high, least_directed, alpha_r, alpha_s, phi = numbers
    while True:
        _climb(s, phi, cap)
        stagnates = _optimum(s, T, low, high)
        if s.tally[MOVES] >= cap or s.real[BEST] >= target:
            return
        directed = not stagnates and _random(s.word) < max(math.exp(-s.tally[OMEGA] / T), least_directed)
        for _ in range(s.tally[STRENGTH]):
            if s.tally[MOVES] >= cap:
                return
            if directed:
                _directed(s, phi)
            else:
                _anywhere(s, phi, alpha_s if stagnates else alpha_r)
