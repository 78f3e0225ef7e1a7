"""Registration of two cameras: the rigid motion on the ground and the clock offset under which people of both walk the same paths.

Each pair of tracklets, one of each camera, gives a motion for each offset (Umeyama 1991 in the plane, all pairs at once). The best motions are
ranked by the likelihood of all pairs (tracklet_pairs.py). The bundle adjustment then refines them with all other parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from tracker.calibration.body import OFFSET, YAW, X, Y, boxes_of, ground_places
from tracker.calibration.boxes import LinkedBoxes, smoothed
from tracker.calibration.single_view import STATURE, SingleView
from tracker.calibration.tracklet_pairs import ERROR, MOST, STEP, Evidence, GroundMotion, Paths, TrackletPairs, evidence
from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Camera

SMOOTH = 0.5
"""s over which places are averaged."""
LEAST_TIME, LEAST_WAY, LONGEST = 1.5, 1.0, 80
"""Least duration, s, and extent, m, of tracklets for guesses of motions, and their largest number per camera, the longest first."""
PAIRS, TRIED, KEPT, REFINED = 60, 300, 10, 6
"""Most guesses per offset, guesses whose likelihood is bounded, guesses whose likelihood is found, and matches of two cameras."""
FARTHEST = 60.0
"""m: places beyond are not used."""
FOOT = 0.15


class Timeline(NamedTuple):
    """Common times of all paths, every STEP s. offset: largest offset between two clocks, s. steps: their number.

    They begin `earlier` s before time 0 and end as long after the last box, as clocks may be late or early.
    """

    offset: float
    steps: int

    @staticmethod
    def of(views: Iterable[CameraBoxes], offset: float) -> Timeline:
        """The timeline of all boxes."""
        last = max((view.table.time.max(initial=0.0) for view in views), default=0.0)
        return Timeline(offset, int((last + 4 * offset) / STEP) + 2)

    @property
    def earlier(self) -> float:
        return 2 * self.offset


@dataclass(frozen=True, eq=False)
class CameraBoxes:
    """A camera with its boxes and its estimate from one view."""

    name: str
    camera: Camera
    table: LinkedBoxes
    single: SingleView

    def places(self, row: Array) -> Array:
        """Places (n, 2) m of boxes under parameters `row`."""
        t = self.table
        return ground_places(self.camera, row, np.column_stack([t.middle, t.top, t.bottom]), FOOT)


@dataclass(frozen=True, eq=False)
class Match:
    """Two cameras in the frame of the first. rows: parameters of both. known, own: paths that the two see. motion: of `own` into the first's frame.

    value: rank of the match; less for focal lengths that are less likely, and where few of the people in view of both are paired.
    """

    rows: tuple[Array, Array]
    value: float
    known: Paths
    own: Paths
    motion: GroundMotion

    @cached_property
    def evidence(self) -> Evidence:
        """That both cameras see the same people."""
        return evidence(self.known, self.own.placed(self.motion))


def paths_of(view: CameraBoxes, row: Array, times: Timeline) -> Paths:
    """The tracklets of a camera under its parameters `row`."""
    place, t, steps = view.places(row), view.table, times.steps
    own = place - row[[X, Y]]
    used = np.flatnonzero(t.whole & (np.hypot(*own.T) < FARTHEST))
    order = used[np.lexsort([t.time[used], t.track[used]])]
    smooth = np.empty(place.shape)
    smooth[used] = smoothed(t.select(used), place[used], SMOOTH)
    bounds = np.flatnonzero(np.diff(t.track[order], prepend=-1, append=-1))
    clock = t.time + row[OFFSET] + times.earlier
    z, here, away, track = [], [], [], []
    for first, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        rows = order[first:end]
        if end - first < 3 or clock[rows[-1]] - clock[rows[0]] < STEP:
            continue
        time, at = clock[rows], np.arange(np.ceil(clock[rows[0]] / STEP), np.floor(clock[rows[-1]] / STEP) + 1).astype(np.int64)
        at = at[(at >= 0) & (at < steps)]
        if len(at) < 2:
            continue
        one, mask, far = np.zeros(steps, dtype=np.complex128), np.zeros(steps), np.zeros(steps)
        one[at] = np.interp(at * STEP, time, smooth[rows, 0]) + 1j * np.interp(at * STEP, time, smooth[rows, 1])
        far[at] = np.abs(one[at] - complex(*row[[X, Y]]))
        mask[at] = 1.0
        z.append(one)
        here.append(mask)
        away.append(far)
        track.append(int(t.track[rows[0]]))
    if not z:
        return Paths(np.zeros((0, steps), dtype=np.complex128), np.zeros((0, steps)), np.zeros((0, steps)), np.zeros(0, dtype=np.int64))
    return Paths(np.array(z), np.array(here), np.array(away), np.array(track))


def guesses(pairs: TrackletPairs, most: int) -> list[GroundMotion]:
    """The best motions of single pairs of tracklets, for offsets of up to `most` steps."""
    out: list[tuple[float, GroundMotion]] = []
    if not len(pairs.a.z) or not len(pairs.b.z):
        return []
    for steps in range(-most, most + 1):
        m = pairs.moments(steps)
        error = np.maximum(m.spread_a + m.spread_b - 2 * np.abs(m.cross), 0.0)
        ok = m.n * STEP >= LEAST_TIME
        value = np.where(ok, np.sqrt(m.n) * np.log1p(np.minimum(m.spread_a, m.spread_b) / (error + ERROR**2)), 0.0)
        best = np.argpartition(value, -min(PAIRS, value.size), axis=None)[-PAIRS:]
        for i, j in zip(*np.unravel_index(best, value.shape), strict=True):
            if value[i, j] > 0:
                turn = complex(m.cross[i, j] / max(abs(m.cross[i, j]), 1e-9))
                out.append((float(value[i, j]), GroundMotion(turn, complex(m.mean_a[i, j] - turn * m.mean_b[i, j]), steps)))
    return [motion for _, motion in sorted(out, key=lambda one: -one[0])[:TRIED]]


def _walkers(paths: Paths) -> Paths:
    """Tracklets for guesses of motions, at most LONGEST of them."""
    moving = np.flatnonzero((paths.here.sum(axis=1) * STEP >= LEAST_TIME) & (_way(paths) >= LEAST_WAY))
    return paths.select(moving).longest(LONGEST)


def _way(paths: Paths) -> Array:
    """Extent (n,) m of each tracklet."""
    masked = np.where(paths.here > 0, paths.z, np.nan)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.hypot(*(np.nanmax(part, axis=1) - np.nanmin(part, axis=1) for part in (masked.real, masked.imag))))


def visible(view: CameraBoxes, row: Array, point: Array) -> Mask:
    """Which people at places (n, 2) m are wholly in the image of a camera, and not smaller there than its boxes."""
    box = boxes_of(view.camera, row, point, np.full(len(point), STATURE), np.array([FOOT, FOOT]))
    t = view.table
    if not t.whole.any():
        return np.zeros(len(point), dtype=bool)
    with np.errstate(invalid="ignore"):
        inside = (box[:, 0] > 0) & (box[:, 0] < view.camera.width) & (box[:, 1] > 0) & (box[:, 2] < view.camera.height)
        return np.asarray(inside & (box[:, 2] - box[:, 1] > np.quantile(t.height[t.whole], 0.03)))


def in_view(view: CameraBoxes, row: Array, other: Paths) -> int:
    """Number of places of another camera's paths that a camera should see under its parameters `row`."""
    return int(visible(view, row, other.points).sum())


def likeliest(known: Paths, own: Paths, offset: float) -> list[tuple[float, float, GroundMotion]]:
    """The likeliest motions of a camera's paths onto known paths: log-likelihood ratio, common steps of the pairs, motion.

    offset: the largest between their clocks, s.
    """
    walkers, pairs = TrackletPairs(_walkers(known), _walkers(own)), TrackletPairs(known.longest(MOST), own.longest(MOST))
    found = sorted(guesses(walkers, round(offset / STEP)), key=lambda motion: -walkers.bound(motion))[:KEPT]
    return [(*pairs.likelihood(motion), motion) for motion in found]


def match(a: CameraBoxes, b: CameraBoxes, times: Timeline) -> list[Match]:
    """The likeliest ways in which camera b stands in the frame of camera a; the best first.

    An uncertain focal length stretches the ground plane, so all pairs of the likely ones are tried.
    """
    sides = [[(row, loss, paths_of(view, row, times)) for row, loss in view.single.tried] for view in (a, b)]
    out = []
    for (row, loss, known), (other, its_loss, own) in product(*sides):
        for ratio, common, motion in likeliest(known, own, times.offset):
            share = min(common / max(in_view(a, row, own.placed(motion)), 1), 1.0)
            value = (ratio - loss - its_loss) * float(np.sqrt(share))
            out.append(Match((row, _placed(other, motion)), value, known, own, motion))
    return _distinct(out)


def placements(known: Paths, view: CameraBoxes, times: Timeline) -> list[Array]:
    """The likeliest parameters (11,) of a camera in whose view people walk the known paths."""
    out = []
    for row, loss in view.single.tried:
        own = paths_of(view, row, times)
        out += [Match((row, _placed(row, motion)), ratio - loss, known, own, motion) for ratio, _, motion in likeliest(known, own, times.offset)]
    return [one.rows[1] for one in _distinct(out)]


def _placed(row: Array, guess: GroundMotion) -> Array:
    out = row.copy()
    z = guess.turn * complex(*row[[X, Y]]) + guess.shift
    out[X], out[Y], out[YAW], out[OFFSET] = z.real, z.imag, row[YAW] + np.angle(guess.turn), row[OFFSET] + guess.steps * STEP
    return out


def _distinct(found: list[Match]) -> list[Match]:
    """The REFINED best of those that place the second camera differently."""
    out: list[Match] = []
    for one in sorted(found, key=lambda one: -one.value):
        row = one.rows[1]
        near = [np.hypot(*(row - other.rows[1])[[X, Y]]) < 1.0 and abs(np.angle(np.exp(1j * (row - other.rows[1])[YAW]))) < 0.25 for other in out]
        if not any(near):
            out.append(one)
        if len(out) == REFINED:
            break
    return out
