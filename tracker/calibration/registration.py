"""Two cameras brought to one ground: the rigid motion and the clock offset under which people of both walk the same paths.

Each pair of tracklets, one of either camera, fits a motion for each offset (Umeyama 1991 in the plane, all pairs at once). The best ones are
tried on all people. The cameras' own parameters, known to their covariances alone, are then adjusted with the motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tracker.calibration.body import FOCAL, OFFSET, YAW, X, Y, boxes_of, ground_places
from tracker.calibration.boxes import LinkedBoxes, smoothed
from tracker.calibration.result import MOST_OFFSET
from tracker.calibration.single_view import STATURE, SingleView
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Camera

EARLIER = 2 * MOST_OFFSET
"""s before time 0 at which paths begin, as clocks may be late."""
STEP = 0.3
"""s between two places of a path."""
SMOOTH = 0.5
"""s over which places are averaged."""
LEAST_TIME, LEAST_WAY = 1.5, 1.0
"""s and m: tracklets by which motions are guessed."""
ERROR, FAR_ERROR = 0.3, 0.1
"""m: error of a place, and what is added to it by the metre from its camera, before cameras are adjusted."""
PAIRS, TRIED, REFINED = 60, 300, 6
"""Guesses of an offset, guesses that are tried, and those whose cameras are adjusted."""
POINTS = 700
"""Places of a camera by which a guess is tried."""
APART = 100.0
"""m along the third axis of the search tree between two steps of time."""
FARTHEST = 60.0
"""m: places beyond are not used."""
LEAST_STEPS = 4
FOOT = 0.15


@dataclass(frozen=True, eq=False)
class CameraBoxes:
    """A camera with its boxes and what it says by itself."""

    name: str
    camera: Camera
    table: LinkedBoxes
    single: SingleView

    def places(self, row: Array, rows: Ints | slice = slice(None)) -> Array:
        """Places (n, 2) m of boxes under parameters `row`."""
        t = self.table
        return ground_places(self.camera, row, np.column_stack([t.middle, t.top, t.bottom])[rows], FOOT)


@dataclass(frozen=True, eq=False)
class Paths:
    """Places of tracklets at common times: z (tracklets, steps) m as complex numbers, 0 where absent; here (tracklets, steps); range (same) m.

    track (tracklets,): their numbers in the table.
    """

    z: Array
    here: Array
    range: Array
    track: Ints


@dataclass(frozen=True, eq=False)
class Match:
    """Two cameras in the frame of the first. rows: parameters of both. score: places that agree, above chance. share: of those that could agree."""

    rows: tuple[Array, Array]
    score: float
    share: float
    second: float = 0.0


def steps_of(views: Iterable[CameraBoxes]) -> int:
    """Steps from EARLIER s before time 0 to as long after the last box."""
    return int((max(view.table.time.max(initial=0.0) for view in views) + 2 * EARLIER) / STEP) + 2


def paths_of(view: CameraBoxes, row: Array, steps: int) -> Paths:
    """The tracklets of a camera under its parameters `row`, every STEP s from EARLIER s before time 0."""
    place, t = view.places(row), view.table
    own = place - row[[X, Y]]
    used = np.flatnonzero(t.whole & (np.hypot(*own.T) < FARTHEST))
    order = used[np.lexsort([t.time[used], t.track[used]])]
    smooth = np.empty(place.shape)
    smooth[used] = smoothed(t.select(used), place[used], SMOOTH)
    bounds = np.flatnonzero(np.diff(t.track[order], prepend=-1, append=-1))
    clock = t.time + row[OFFSET] + EARLIER
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


@dataclass(frozen=True, eq=False)
class Guess:
    """A motion of the second camera's plane onto the first's: z → turn · z + shift (complex), after its time is moved on by `steps`. value: rank."""

    turn: complex
    shift: complex
    steps: int
    value: float


def guesses(a: Paths, b: Paths, most: int) -> list[Guess]:
    """The best motions of single pairs of tracklets, for offsets of up to `most` steps."""
    moving = [np.flatnonzero((p.here.sum(axis=1) * STEP >= LEAST_TIME) & (_way(p) >= LEAST_WAY)) for p in (a, b)]
    za, ma, zb, mb = a.z[moving[0]], a.here[moving[0]], b.z[moving[1]], b.here[moving[1]]
    out: list[Guess] = []
    if not len(za) or not len(zb):
        return out
    for k in range(-most, most + 1):
        zk, mk = _moved(zb, k), _moved(mb, k)
        n = ma @ mk.T
        ok = n >= max(LEAST_STEPS, LEAST_TIME / STEP)
        safe = np.maximum(n, 1.0)
        sa, sb = za @ mk.T, ma @ zk.T
        va = (np.abs(za) ** 2) @ mk.T - np.abs(sa) ** 2 / safe
        vb = ma @ (np.abs(zk) ** 2).T - np.abs(sb) ** 2 / safe
        cross = za @ np.conj(zk).T - sa * np.conj(sb) / safe
        error = np.maximum(va + vb - 2 * np.abs(cross), 0.0) / safe
        value = np.where(ok, np.sqrt(safe) * np.log1p(np.minimum(va, vb) / safe / (error + ERROR**2)), 0.0)
        for i, j in zip(*np.unravel_index(np.argsort(value, axis=None)[::-1][:PAIRS], value.shape), strict=True):
            if value[i, j] > 0:
                turn = complex(cross[i, j] / max(abs(cross[i, j]), 1e-9))
                out.append(Guess(turn, complex((sa[i, j] - turn * sb[i, j]) / n[i, j]), k, float(value[i, j])))
    return sorted(out, key=lambda g: -g.value)[:TRIED]


def _way(paths: Paths) -> Array:
    """Extent (n,) m of each tracklet."""
    masked = np.where(paths.here > 0, paths.z, np.nan)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.hypot(*(np.nanmax(part, axis=1) - np.nanmin(part, axis=1) for part in (masked.real, masked.imag))))


def _moved(values: Array, steps: int) -> Array:
    """Columns moved to later times by `steps`."""
    out = np.zeros_like(values)
    if steps >= 0:
        out[:, steps:] = values[:, : values.shape[1] - steps]
    else:
        out[:, :steps] = values[:, -steps:]
    return out


@dataclass(frozen=True, eq=False)
class Cloud:
    """Places (n, 2) m with their steps (n,) of time and errors (n,) m, as a search tree."""

    point: Array
    step: Ints
    error: Array
    tree: cKDTree
    steps: int

    @staticmethod
    def of(paths: Paths, tight: float = 1.0) -> Cloud:
        """tight: factor of the errors."""
        track, step = np.nonzero(paths.here)
        z = paths.z[track, step]
        point = np.column_stack([z.real, z.imag])
        tree = cKDTree(np.column_stack([point, APART * step]))
        return Cloud(point, step, tight * (ERROR + FAR_ERROR * paths.range[track, step]), tree, paths.here.shape[1])

    def nearest(self, point: Array, step: Ints, most: float = 5.0) -> tuple[Array, Ints]:
        """Distance (n,) and row (n,) of the nearest place of the same step."""
        distance, row = self.tree.query(np.column_stack([point, APART * step]), distance_upper_bound=most)
        return distance, row


def agreement(a: Cloud, b: Cloud, in_view: Array, moved: Array, steps: int) -> tuple[float, float]:
    """How many of b's places, `moved` (n, 2) m into a's frame, are where a sees somebody, above chance; and as a share of those `in_view` (n,)."""
    rows = np.flatnonzero(in_view)
    if len(rows) < 20 or not len(a.point):
        return 0.0, 0.0

    def kernel(step: Ints) -> Array:
        distance, row = a.nearest(moved[rows], step)
        found = np.isfinite(distance)
        error = np.hypot(b.error[rows], a.error[np.where(found, row, 0)])
        return np.where(found, np.exp(-0.5 * (np.where(found, distance, 0.0) / error) ** 2), 0.0)

    own = kernel(b.step[rows] + steps)
    chance = np.mean([kernel((b.step[rows] + steps + int(part * a.steps)) % a.steps) for part in (0.29, 0.53, 0.71)], axis=0)
    gain = float((own - chance).sum())
    return gain, gain / max(float((1 - chance).sum()), 1.0)


def visible(view: CameraBoxes, row: Array, point: Array) -> Array:
    """Which people at places (n, 2) m are wholly in the image of a camera, not too far from it for its boxes."""
    box = boxes_of(view.camera, row, point, np.full(len(point), STATURE), np.array([FOOT, FOOT]))
    t = view.table
    with np.errstate(invalid="ignore"):
        inside = (box[:, 0] > 0) & (box[:, 0] < view.camera.width) & (box[:, 1] > 0) & (box[:, 2] < view.camera.height)
        return np.asarray(inside & (box[:, 2] - box[:, 1] > np.quantile(t.height[t.whole], 0.03)))


def match(a: CameraBoxes, b: CameraBoxes, row: Array, steps: int, most: float = MOST_OFFSET) -> list[Match]:
    """The likeliest ways in which camera b stands in the frame of camera a, whose parameters are `row`; the best first."""
    found = []
    for row_a, row_b in _focal_guesses(a, b, row):
        pa, pb = paths_of(a, row_a, steps), paths_of(b, row_b, steps)
        ca, cb = Cloud.of(pa), Cloud.of(pb)
        some = np.linspace(0, len(cb.point) - 1, min(POINTS, len(cb.point))).astype(np.int64) if len(cb.point) else np.zeros(0, dtype=np.int64)
        part = replace(cb, point=cb.point[some], step=cb.step[some], error=cb.error[some])
        for guess in guesses(pa, pb, round(most / STEP)):
            z = guess.turn * (part.point[:, 0] + 1j * part.point[:, 1]) + guess.shift
            moved = np.column_stack([z.real, z.imag])
            score, share = agreement(ca, part, visible(a, row_a, moved), moved, guess.steps)
            found.append((score * share, Match((row_a, _placed(row_b, guess)), score, share)))
    found.sort(key=lambda one: -one[0])
    return _distinct([one for _, one in found], REFINED)


def _placed(row: Array, guess: Guess) -> Array:
    out = row.copy()
    z = guess.turn * complex(*row[[X, Y]]) + guess.shift
    out[X], out[Y], out[YAW], out[OFFSET] = z.real, z.imag, row[YAW] + np.angle(guess.turn), row[OFFSET] + guess.steps * STEP
    return out


def _focal_guesses(a: CameraBoxes, b: CameraBoxes, row: Array) -> list[tuple[Array, Array]]:
    """Pairs of parameters of both cameras: as they are likeliest, and with common focal lengths where these are not known."""
    zero = b.single.row.copy()
    out = [(row, zero)]
    sigma = [view.single.sigma[FOCAL] for view in (a, b)]
    if max(sigma) > 0.1:
        for factor in (-1.0, 1.0):
            first = row + (a.single.with_focal(a.single.row[FOCAL] + factor * sigma[0]) - a.single.row if row is a.single.row else 0.0)
            out.append((first, b.single.with_focal(zero[FOCAL] + factor * sigma[1])))
    return out


def _distinct(found: list[Match], most: int) -> list[Match]:
    """The first of matches that are like each other."""
    out: list[Match] = []
    for one in found:
        row = one.rows[1]
        near = [np.hypot(*(row - other.rows[1])[[X, Y]]) < 1.0 and abs(np.angle(np.exp(1j * (row - other.rows[1])[YAW]))) < 0.25 for other in out]
        if not any(near):
            out.append(one)
        if len(out) == most:
            break
    return out
