"""Who is who: tracklets of all cameras joined to people, and their boxes as the observations of the adjustment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.calibration.body import OFFSET
from tracker.calibration.registration import ERROR, FAR_ERROR, STEP, Paths, View, paths_of
from tracker.calibration.single_view import thinned
from tracker.geometry import Array, Ints

LEAST_STEPS = 3
"""Common steps of two tracklets that are joined."""
NEAR = 1.3
"""Root mean square distance of two tracklets that are joined, in errors of places."""
LONGER = 0.15
"""By how much the distance of tracklets may be larger for e times the common steps."""
ALONE = 4.0
"""s: tracklets that no other camera sees are used where they are as long."""
SPACING, MOST = 0.4, 7000
"""s between two boxes of a tracklet, and most boxes in all."""
EDGE, EDGE_PIXELS = 0.04, 1.5
"""Error of an edge: a share of the height of the box, and px."""


@dataclass(frozen=True, eq=False)
class Observations:
    """n boxes of people: view (n,), person (n,) from 0, time (n,) s by the camera's clock, box (n, 3): middle, top and bottom px, sigma (n, 3) px.

    alone (people,): whether one camera only has seen somebody.
    """

    view: Ints
    person: Ints
    time: Array
    box: Array
    sigma: Array
    track: Ints
    alone: Array


def observations(views: Mapping[str, View], rows: Mapping[str, Array], steps: int, tight: float = 1.0, most: int = MOST) -> Observations:
    """The boxes of people under parameters `rows`. tight: factor of the errors of places within which tracklets are joined."""
    names = list(rows)
    paths = [paths_of(views[name], rows[name], steps) for name in names]
    person = _joined(paths, tight)
    parts, alone_at = [], 0
    seen: dict[int, set[int]] = {}
    for k, of_view in enumerate(person):
        for one in of_view.tolist():
            seen.setdefault(one, set()).add(k)
    for k, name in enumerate(names):
        t = views[name].table
        of_track = np.full(int(t.track.max(initial=0)) + 1, -1, dtype=np.int64)
        of_track[paths[k].track] = person[k]
        used = thinned(t, SPACING)
        who = of_track[t.track[used]]
        length = np.bincount(t.track, minlength=len(of_track)) * 0.0
        np.maximum.at(length, t.track, t.time)
        first = np.full(len(of_track), np.inf)
        np.minimum.at(first, t.track, t.time)
        shared = np.array([len(seen.get(one, ())) > 1 for one in who.tolist()], dtype=bool)
        keep = (who >= 0) & (shared | ((length - first)[t.track[used]] >= ALONE))
        parts.append((k, used[keep], who[keep], shared[keep]))
        alone_at += int(keep.sum())
    stride = 1 + alone_at // most
    view = np.concatenate([np.full(len(rows_[::stride]), k) for k, rows_, _, _ in parts])
    at = [rows_[::stride] for _, rows_, _, _ in parts]
    who = np.concatenate([one[::stride] for _, _, one, _ in parts])
    numbers, compact = np.unique(who, return_inverse=True)
    tables = [views[name].table for name in names]
    box = np.concatenate([np.column_stack([t.middle[r], t.top[r], t.bottom[r]]) for t, r in zip(tables, at, strict=True)])
    high = box[:, 2] - box[:, 1]
    sigma = np.hypot(EDGE * high, EDGE_PIXELS)[:, None] * np.ones(3)
    time = np.concatenate([t.time[r] for t, r in zip(tables, at, strict=True)])
    track = np.concatenate([t.track[r] for t, r in zip(tables, at, strict=True)])
    alone = np.array([len(seen[int(one)]) < 2 for one in numbers], dtype=bool)
    return Observations(view.astype(np.int64), compact.astype(np.int64), time, box, sigma, track, alone)


def _joined(paths: list[Paths], tight: float) -> list[Ints]:
    """Person of each tracklet of each view."""
    first = np.cumsum([0, *(len(p.z) for p in paths)])
    of_view = np.repeat(np.arange(len(paths)), np.diff(first))
    pairs: list[tuple[float, int, int]] = []
    for a, b in combinations(range(len(paths)), 2):
        pairs += _near(paths[a], paths[b], tight, (int(first[a]), int(first[b])))
    parent = np.arange(first[-1])
    here: dict[int, dict[int, Array]] = {k: {int(of_view[k]): paths[of_view[k]].here[k - first[of_view[k]]] > 0} for k in range(int(first[-1]))}

    def root(k: int) -> int:
        while parent[k] != k:
            k = int(parent[k])
        return k

    for _, i, j in sorted(pairs):
        a, b = root(i), root(j)
        if a == b or any((here[a][v] & here[b][v]).any() for v in here[a].keys() & here[b].keys()):
            continue
        parent[b] = a
        for v, mask in here.pop(b).items():
            here[a][v] = here[a][v] | mask if v in here[a] else mask
    roots = np.array([root(k) for k in range(int(first[-1]))], dtype=np.int64)
    return [roots[low:high] for low, high in zip(first[:-1].tolist(), first[1:].tolist(), strict=True)]


def _near(a: Paths, b: Paths, tight: float, first: tuple[int, int]) -> list[tuple[float, int, int]]:
    """Pairs of tracklets of two views that walk together: their distance in errors, less for longer ones, and their numbers."""
    if not len(a.z) or not len(b.z):
        return []
    n = a.here @ b.here.T
    safe = np.maximum(n, 1.0)
    square = (np.abs(a.z) ** 2) @ b.here.T + a.here @ (np.abs(b.z) ** 2).T - 2 * (a.z @ np.conj(b.z).T).real
    error = (ERROR + FAR_ERROR * (a.range * a.here) @ b.here.T / safe) ** 2 + (ERROR + FAR_ERROR * a.here @ (b.range * b.here).T / safe) ** 2
    distance = np.sqrt(np.maximum(square, 0.0) / safe / error) / tight
    rows, columns = np.nonzero((n >= LEAST_STEPS) & (distance < NEAR))
    cost = distance[rows, columns] - LONGER * np.log(n[rows, columns])
    return [(float(c), first[0] + i, first[1] + j) for c, i, j in zip(cost, rows.tolist(), columns.tolist(), strict=True)]
