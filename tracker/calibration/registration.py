"""Registration of two cameras: the rigid motion on the ground and the clock offset under which people of both walk the same paths.

Each pair of tracklets, one of each camera, gives a motion for each offset (Umeyama 1991 in the plane, all pairs at once). The best motions are
scored by all people. The bundle adjustment then refines them with all other parameters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from tracker.calibration.body import OFFSET, YAW, X, Y, boxes_of, ground_places
from tracker.calibration.boxes import LinkedBoxes, smoothed
from tracker.calibration.single_view import STATURE, SingleView
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.cameras import Camera

MOST_OFFSET = 5.0
"""s: largest offset between two clocks."""
EARLIER = 2 * MOST_OFFSET
"""s before time 0 at which paths begin, as clocks may be late."""
STEP = 0.3
"""s between two places of a path."""
SMOOTH = 0.5
"""s over which places are averaged."""
LEAST_TIME, LEAST_WAY, LONGEST = 1.5, 1.0, 80
"""Least duration, s, and extent, m, of tracklets for guesses of motions, and their largest number per camera, the longest first."""
ERROR, FAR_ERROR = 0.3, 0.1
"""Standard deviation of a place before the adjustment: a constant, m, and its increase per metre of distance from the camera."""
PAIRS, TRIED, KEPT, REFINED = 60, 300, 10, 6
"""Most guesses per offset, guesses that are scored, guesses that are scored again with more places, and matches of two cameras."""
UNLIKELY = 8.0
"""Loss of log density for which a match counts 1/e. It is large, because boxes of real detectors inflate such losses."""
FEW, POINTS = 100, 700
"""Places of a camera by which a guess is scored in the first and the second round."""
APART = 100.0
"""m along the third axis of the search tree between two steps of time."""
FARTHEST = 60.0
"""m: places beyond are not used."""
LEAST_STEPS = 4
LEAST_IN_VIEW = 20
"""Least places in view for a comparison of two cameras; less if a twentieth of those tried, plus one, is less."""
FOOT = 0.15


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
    """Two cameras in the frame of the first. rows: parameters of both. score: places that agree, above chance. share: of those that could.

    likely: 1 for the likeliest focal lengths of both, less for others.
    """

    rows: tuple[Array, Array]
    score: float
    share: float
    likely: float

    @property
    def value(self) -> float:
        """Rank of the match."""
        return self.score * self.share * self.likely


def steps_of(views: Iterable[CameraBoxes]) -> int:
    """Number of steps from EARLIER s before time 0 to EARLIER s after the last box."""
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
    first, second = (_longest(paths) for paths in (a, b))
    za, ma, zb, mb = a.z[first], a.here[first], b.z[second], b.here[second]
    out: list[Guess] = []
    if not len(za) or not len(zb):
        return out
    flat = np.vstack([za.real, za.imag])
    square = np.abs(za) ** 2
    for k in range(-most, most + 1):
        zk, mk = _moved(zb, k), _moved(mb, k)
        n = ma @ mk.T
        ok = n >= max(LEAST_STEPS, LEAST_TIME / STEP)
        safe = np.maximum(n, 1.0)
        sa, sb = (re + 1j * im for re, im in (np.split(flat @ mk.T, 2), np.split(ma @ np.vstack([zk.real, zk.imag]).T, 2, axis=1)))
        va = square @ mk.T - np.abs(sa) ** 2 / safe
        vb = ma @ (np.abs(zk) ** 2).T - np.abs(sb) ** 2 / safe
        cross = za @ np.conj(zk).T - sa * np.conj(sb) / safe
        error = np.maximum(va + vb - 2 * np.abs(cross), 0.0) / safe
        value = np.where(ok, np.sqrt(safe) * np.log1p(np.minimum(va, vb) / safe / (error + ERROR**2)), 0.0)
        best = np.argpartition(value, -min(PAIRS, value.size), axis=None)[-PAIRS:]
        for i, j in zip(*np.unravel_index(best, value.shape), strict=True):
            if value[i, j] > 0:
                turn = complex(cross[i, j] / max(abs(cross[i, j]), 1e-9))
                out.append(Guess(turn, complex((sa[i, j] - turn * sb[i, j]) / n[i, j]), k, float(value[i, j])))
    return sorted(out, key=lambda g: -g.value)[:TRIED]


def _longest(paths: Paths) -> Ints:
    """Tracklets for guesses of motions, at most LONGEST of them."""
    steps = paths.here.sum(axis=1)
    moving = np.flatnonzero((steps * STEP >= LEAST_TIME) & (_way(paths) >= LEAST_WAY))
    return np.sort(moving[np.argsort(-steps[moving], kind="stable")[:LONGEST]])


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

    def some(self, most: int) -> Cloud:
        """At most `most` of the places, evenly spread."""
        rows = np.linspace(0, len(self.point) - 1, min(most, len(self.point))).astype(np.int64)
        return replace(self, point=self.point[rows], step=self.step[rows], error=self.error[rows])

    def nearest(self, point: Array, step: Ints, most: float = 5.0) -> tuple[Array, Ints]:
        """Distance (n,) and row (n,) of the nearest place of the same step."""
        distance, row = self.tree.query(np.column_stack([point, APART * step]), distance_upper_bound=most)
        return distance, row


def agreement(a: Cloud, b: Cloud, in_view: Mask, moved: Array, steps: Ints | int = 0) -> tuple[Array, Array]:
    """Number of b's n places at which a sees somebody, above chance, and its share of those in view, each (g,) for g motions.

    in_view (g, n): whether a should see the places. moved (g, n, 2) m: places in a's frame. steps (g,): added to b's time.
    """
    motion, place = np.nonzero(in_view)
    count = len(in_view)
    if not len(a.point) or not len(motion):
        return np.zeros(count), np.zeros(count)
    points, time = moved[motion, place], (b.step[place] + np.broadcast_to(steps, count)[motion])

    def kernel(step: Ints) -> Array:
        distance, row = a.nearest(points, step)
        found = np.isfinite(distance)
        error = np.hypot(b.error[place], a.error[np.where(found, row, 0)])
        return np.where(found, np.exp(-0.5 * (np.where(found, distance, 0.0) / error) ** 2), 0.0)

    chance = np.mean([kernel((time + int(part * a.steps)) % a.steps) for part in (0.29, 0.53, 0.71)], axis=0)
    gain, most = (np.bincount(motion, weights, count) for weights in (kernel(time) - chance, 1 - chance))
    enough = np.bincount(motion, minlength=count) >= min(LEAST_IN_VIEW, 1 + in_view.shape[1] // 20)
    return np.where(enough, gain, 0.0), np.where(enough, gain / np.maximum(most, 1.0), 0.0)


def visible(view: CameraBoxes, row: Array, point: Array) -> Mask:
    """Which people at places (n, 2) m are wholly in the image of a camera, and not smaller there than its boxes."""
    box = boxes_of(view.camera, row, point, np.full(len(point), STATURE), np.array([FOOT, FOOT]))
    t = view.table
    with np.errstate(invalid="ignore"):
        inside = (box[:, 0] > 0) & (box[:, 0] < view.camera.width) & (box[:, 1] > 0) & (box[:, 2] < view.camera.height)
        return np.asarray(inside & (box[:, 2] - box[:, 1] > np.quantile(t.height[t.whole], 0.03)))


def seen_alike(a: CameraBoxes, row: Array, own: Cloud, other: Cloud) -> tuple[int, float, float]:
    """Number of places of another camera that camera a should see, and their agreement with its own: above chance, and as a share.

    row (11,): parameters of a. own, other: places that a and the other camera see, in one frame.
    """
    inside = visible(a, row, other.point)
    score, share = agreement(own, other, inside[None], other.point[None])
    return int(inside.sum()), float(score[0]), float(share[0])


@dataclass(frozen=True, eq=False)
class _Side:
    """A camera under parameters `row` (11,): its paths and their places."""

    view: CameraBoxes
    row: Array
    likely: float
    paths: Paths
    cloud: Cloud

    @staticmethod
    def of(view: CameraBoxes, row: Array, less: float, steps: int) -> _Side:
        """less: loss of log density against the likeliest parameters."""
        paths = paths_of(view, row, steps)
        return _Side(view, row, float(np.exp(-less / UNLIKELY)), paths, Cloud.of(paths))

    def matches(self, other: _Side, guesses: list[Guess], points: int) -> list[Match]:
        """Matches of the other camera as placed by each of the guesses, scored by at most `points` of its places."""
        part = other.cloud.some(points)
        turn, shift = (np.array([getattr(guess, name) for guess in guesses], dtype=np.complex128) for name in ("turn", "shift"))
        z = turn[:, None] * (part.point[:, 0] + 1j * part.point[:, 1]) + shift[:, None]
        moved = np.stack([z.real, z.imag], axis=2)
        inside = visible(self.view, self.row, moved.reshape(-1, 2)).reshape(z.shape)
        score, share = agreement(self.cloud, part, inside, moved, np.array([guess.steps for guess in guesses], dtype=np.int64))
        placed = [(self.row, _placed(other.row, guess)) for guess in guesses]
        return [Match(*one, self.likely * other.likely) for one in zip(placed, score.tolist(), share.tolist(), strict=True)]


def match(a: CameraBoxes, b: CameraBoxes, steps: int) -> list[Match]:
    """The likeliest ways in which camera b stands in the frame of camera a; the best first.

    An uncertain focal length stretches the ground plane, so all pairs of the likely ones are tried.
    """
    sides = [[_Side.of(view, row, less, steps) for row, less in view.single.tried] for view in (a, b)]
    out: list[Match] = []
    for one, other in product(*sides):
        tried = guesses(one.paths, other.paths, round(MOST_OFFSET / STEP))
        rough = one.matches(other, tried, FEW) if tried else []
        best = sorted(range(len(tried)), key=lambda k: -rough[k].value)[:KEPT]
        out += one.matches(other, [tried[k] for k in best], POINTS) if tried else []
    return _distinct(sorted(out, key=lambda one: -one.value), REFINED)


def _placed(row: Array, guess: Guess) -> Array:
    out = row.copy()
    z = guess.turn * complex(*row[[X, Y]]) + guess.shift
    out[X], out[Y], out[YAW], out[OFFSET] = z.real, z.imag, row[YAW] + np.angle(guess.turn), row[OFFSET] + guess.steps * STEP
    return out


def _distinct(found: list[Match], most: int) -> list[Match]:
    """The first `most` matches that differ from each other; of similar ones, the first."""
    out: list[Match] = []
    for one in found:
        row = one.rows[1]
        near = [np.hypot(*(row - other.rows[1])[[X, Y]]) < 1.0 and abs(np.angle(np.exp(1j * (row - other.rows[1])[YAW]))) < 0.25 for other in out]
        if not any(near):
            out.append(one)
        if len(out) == most:
            break
    return out
