"""Association: tracklets of all cameras are joined to people, whose boxes are the observations of the adjustment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.calibration.boxes import extents, smoothed
from tracker.calibration.registration import CameraBoxes, Timeline, paths_of
from tracker.calibration.single_view import thinned
from tracker.calibration.tracklet_pairs import GroundMotion, Paths, TrackletPairs
from tracker.geometry import Array, Ints, Mask

ALONE = 4.0
"""s: least duration of a tracklet that no other camera sees, to be used."""
SPACING, MOST = 0.4, 7000
"""s between two boxes of a tracklet, and most boxes in all."""
EDGE, EDGE_PIXELS = 0.04, 1.5
"""Error of an edge: a share of the height of the box, and px."""


@dataclass(frozen=True, eq=False)
class Observations:
    """n boxes of people: view (n,), person (n,) from 0, time (n,) s by the camera's clock, box (n, 3): middle, top and bottom px, sigma (n, 3) px."""

    view: Ints
    person: Ints
    time: Array
    box: Array
    sigma: Array

    def of_people(self, kept: Mask) -> Observations:
        """The boxes of the people in the mask `kept` (people,), who are renumbered from 0."""
        rows, number = kept[self.person], np.cumsum(kept) - 1
        return Observations(self.view[rows], number[self.person[rows]], self.time[rows], self.box[rows], self.sigma[rows])


def observations(views: Mapping[str, CameraBoxes], rows: Mapping[str, Array], times: Timeline, tight: float = 1.0, most: int = MOST) -> Observations:
    """The boxes of people under parameters `rows`. tight: factor of the errors of places within which tracklets are joined."""
    paths = [paths_of(views[name], rows[name], times) for name in rows]
    joined = _joined(paths, tight)
    cameras = Counter(one for of_view in joined for one in set(of_view.tolist()))
    parts = []
    for k, name in enumerate(rows):
        t = views[name].table
        of_track = np.full(int(t.track.max(initial=0)) + 1, -1, dtype=np.int64)
        of_track[paths[k].track] = joined[k]
        used = thinned(t, SPACING)
        who = of_track[t.track[used]]
        shared = np.array([cameras[one] > 1 for one in who.tolist()], dtype=bool)
        keep = (who >= 0) & (shared | (extents(t, t.time[:, None])[t.track[used], 0] >= ALONE))
        parts.append((k, t.select(used[keep]), who[keep], smoothed(t, t.height[:, None])[used[keep], 0]))
    stride = 1 + sum(len(who) for _, _, who, _ in parts) // most
    parts = [(k, t.select(np.arange(0, len(who), stride)), who[::stride], tall[::stride]) for k, t, who, tall in parts]
    view = np.concatenate([np.full(len(who), k, dtype=np.int64) for k, _, who, _ in parts])
    person = np.unique(np.concatenate([who for _, _, who, _ in parts]), return_inverse=True)[1]
    box = np.concatenate([np.column_stack([t.middle, t.top, t.bottom]) for _, t, _, _ in parts])
    high = np.concatenate([tall for _, _, _, tall in parts])
    sigma = np.hypot(EDGE * high, EDGE_PIXELS)[:, None] * np.ones(3)
    return Observations(view, person.astype(np.int64), np.concatenate([t.time for _, t, _, _ in parts]), box, sigma)


def _joined(paths: list[Paths], tight: float) -> list[Ints]:
    """Person of each tracklet of each view."""
    first = np.cumsum([0, *(len(p.z) for p in paths)])
    of_view = np.repeat(np.arange(len(paths)), np.diff(first))
    pairs: list[tuple[float, int, int]] = []
    for a, b in combinations(range(len(paths)), 2):
        pairs += _likely(paths[a], paths[b], tight, (int(first[a]), int(first[b])))
    parent = np.arange(first[-1])
    here: dict[int, dict[int, Mask]] = {k: {int(of_view[k]): paths[of_view[k]].here[k - first[of_view[k]]] > 0} for k in range(int(first[-1]))}

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


def _likely(a: Paths, b: Paths, tight: float, first: tuple[int, int]) -> list[tuple[float, int, int]]:
    """Pairs of tracklets of two views that are likelier one person than two: negative log-likelihood ratio, and their numbers."""
    if not len(a.z) or not len(b.z):
        return []
    ratio = TrackletPairs(a, b, tight).log_ratio(GroundMotion())
    rows, columns = np.nonzero(ratio > 0)
    return [(-float(r), first[0] + i, first[1] + j) for r, i, j in zip(ratio[rows, columns], rows.tolist(), columns.tolist(), strict=True)]
