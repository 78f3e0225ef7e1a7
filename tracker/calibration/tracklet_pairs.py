"""Pairs of tracklets of two cameras: how much likelier they are one person than two.

One person has one constant displacement, from errors of the cameras, and small deviations from it. Two people walk on independent paths in one area.
So paths of walking people weigh much more than places, which in a crowd agree by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, Mask

Complexes = NDArray[np.complex128]
Number = TypeVar("Number", bound=np.generic)
STEP = 0.3
"""s between two places of a path."""
ERROR, FAR_ERROR = 0.3, 0.1
"""Standard deviation of a place before the adjustment: a constant, m, and its increase per metre of distance from the camera."""
JITTER, STRETCH = 0.2, 0.25
"""Standard deviation of a place about the displacement, m, and its increase per metre that the paths extend, as errors of cameras stretch them."""
INDEPENDENT = 1.0
"""s between two places with independent deviations."""
LEAST_STEPS = 3
"""Least common steps of two tracklets that are compared."""
LEAST_AREA = 4.0
"""m²: least area in which two people are independent."""
MOST = 400
"""Most tracklets of a camera by which motions are judged, those with the most steps, as memory grows with the number of pairs."""
CACHED = 64
"""Most offsets whose moments are cached, 0.6 MB each."""
SHIFTS = (0.29, 0.53, 0.71)
"""Shifts of time, as shares of the duration, by which the evidence that arises by chance is estimated."""
CLEARLY, LEAST_GAIN = 2.0, 10.0
"""Two cameras see the same people where the evidence is so many times that of chance, and exceeds it by LEAST_GAIN."""


class GroundMotion(NamedTuple):
    """A motion of the second camera's plane onto the first's: z → turn · z + shift (complex), after its time is moved on by `steps`."""

    turn: complex = 1.0 + 0.0j
    shift: complex = 0.0j
    steps: int = 0


@dataclass(frozen=True, eq=False)
class Paths:
    """Places of tracklets at common times: z (tracklets, steps) m as complex numbers, 0 where absent; here (tracklets, steps); range (same) m.

    track (tracklets,): their numbers in the table.
    """

    z: Complexes
    here: Array
    range: Array
    track: Ints

    def select(self, rows: Ints) -> Paths:
        """The tracklets in `rows`."""
        return Paths(self.z[rows], self.here[rows], self.range[rows], self.track[rows])

    def longest(self, most: int) -> Paths:
        """At most `most` tracklets, those with the most steps."""
        if len(self.track) <= most:
            return self
        return self.select(np.sort(np.argsort(-self.here.sum(axis=1), kind="stable")[:most]))

    def between(self, begin: int, end: int) -> Paths:
        """The steps from `begin` to before `end`."""
        return Paths(self.z[:, begin:end], self.here[:, begin:end], self.range[:, begin:end], self.track)

    def rolled(self, steps: int) -> Paths:
        """Moved to later times by `steps`, circularly."""
        return Paths(np.roll(self.z, steps, axis=1), np.roll(self.here, steps, axis=1), np.roll(self.range, steps, axis=1), self.track)

    def placed(self, motion: GroundMotion) -> Paths:
        """In the first camera's frame, by a motion."""
        here = moved(self.here, motion.steps)
        z = np.asarray((motion.turn * moved(self.z, motion.steps) + motion.shift) * here, dtype=np.complex128)
        return Paths(z, here, moved(self.range, motion.steps), self.track)

    @staticmethod
    def joined(parts: Sequence[Paths]) -> Paths:
        """The tracklets of several cameras in one frame."""
        return Paths(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("z", "here", "range", "track")))

    @property
    def points(self) -> Array:
        """Places (n, 2) m of all tracklets."""
        z = self.z[self.here > 0]
        return np.column_stack([z.real, z.imag])

    @property
    def people(self) -> float:
        """Mean number of tracklets at a time, where there are any."""
        count = self.here.sum(axis=0)
        return float(count[count > 0].mean()) if count.any() else 1.0

    @property
    def mean_range(self) -> Array:
        """Mean distances (tracklets,) m from the camera."""
        return np.asarray((self.range * self.here).sum(axis=1) / np.maximum(self.here.sum(axis=1), 1.0))

    @property
    def area(self) -> float:
        """m² in which all the places lie: four times that of the ellipse of one standard deviation."""
        z = self.z[self.here > 0]
        if len(z) < 3:
            return LEAST_AREA
        return max(4 * np.pi * float(np.sqrt(max(np.linalg.det(np.cov([z.real, z.imag])), 0.0))), LEAST_AREA)


class Moments(NamedTuple):
    """Of each pair (tracklets, tracklets), over its common steps: their number, means of za and zb, mean squared distances from them, covariance.

    The log-likelihood ratio of one person against two is constant − of_far · d² − of_varies · v. Here d is the distance of the means and v the
    variance of the displacement.
    """

    n: Array
    mean_a: Complexes
    mean_b: Complexes
    spread_a: Array
    spread_b: Array
    cross: Complexes
    constant: Array
    of_far: Array
    of_varies: Array


class Evidence(NamedTuple):
    """That two or more cameras see the same people: log-likelihood ratio of their pairs of tracklets, and the same by chance.

    chance: the largest ratio after one camera's time is shifted circularly by SHIFTS. In a crowd it is large. steps: common steps of the pairs.
    """

    ratio: float = 0.0
    chance: float = 0.0
    steps: float = 0.0

    @property
    def gain(self) -> float:
        """Log-likelihood ratio above that of chance."""
        return self.ratio - self.chance

    @property
    def clear(self) -> bool:
        """Whether the cameras see the same people."""
        return self.ratio >= CLEARLY * self.chance and self.gain >= LEAST_GAIN

    def plus(self, other: Evidence) -> Evidence:
        """The evidence of both."""
        return Evidence(*(one + two for one, two in zip(self, other, strict=True)))


class TrackletPairs:
    """All pairs of tracklets of two cameras. Moments by offset are cached, so that a motion costs a few operations for a pair."""

    def __init__(self, a: Paths, b: Paths, tight: float = 1.0) -> None:
        """tight: factor of the errors of places."""
        self.a, self.b = a, b
        self._moments: dict[int, Moments] = {}
        one, two = (tight * (ERROR + FAR_ERROR * paths.mean_range) for paths in (a, b))
        self._error = one[:, None] ** 2 + two**2
        # One of the people whom the other camera sees is the same person.
        self._other = np.log(b.people / a.area)

    @cached_property
    def _overlaps(self) -> tuple[Mask, Mask]:
        """Which tracklets of the first camera, and which of the second, exist at one time (tracklets, same)."""
        first, second = (paths.here @ paths.here.T > 0 for paths in (self.a, self.b))
        return first, second

    def moments(self, steps: int) -> Moments:
        """The moments after the second camera's time is moved on by `steps`."""
        found = self._moments.get(steps)
        if found is None:
            a, mask, b, late = self.a.z, self.a.here, moved(self.b.z, steps), moved(self.b.here, steps)
            number = mask @ late.T
            n = np.maximum(number, 1.0)
            mean_a, mean_b = a @ late.T.astype(np.complex128) / n, mask.astype(np.complex128) @ b.T / n
            spread_a = np.maximum((np.abs(a) ** 2) @ late.T / n - np.abs(mean_a) ** 2, 0.0)
            spread_b = np.maximum(mask @ (np.abs(b) ** 2).T / n - np.abs(mean_b) ** 2, 0.0)
            cross = a @ np.conj(b).T / n - mean_a * np.conj(mean_b)
            jitter = JITTER**2 + STRETCH**2 * (spread_a + spread_b) / 4
            alone = jitter + (spread_a + spread_b) / 2
            independent = number * STEP / INDEPENDENT
            error = self._error + jitter / np.maximum(independent, 1.0)
            constant = np.maximum(independent - 1.0, 0.0) * np.log(alone / jitter) - np.log(2 * np.pi * error) - self._other
            constant[number < LEAST_STEPS] = -np.inf
            of_varies = independent * (1 / jitter - 1 / alone) / 2
            found = Moments(number, mean_a, mean_b, spread_a, spread_b, cross, constant, 1 / (2 * error), of_varies)
            if len(self._moments) < CACHED:
                self._moments[steps] = found
        return found

    def log_ratio(self, motion: GroundMotion) -> Array:
        """Log-likelihood ratio (tracklets, tracklets) of one person against two; −inf with fewer than LEAST_STEPS common steps."""
        m = self.moments(motion.steps)
        apart = m.mean_a - motion.turn * m.mean_b - motion.shift
        varies = np.maximum(m.spread_a + m.spread_b - 2 * (m.cross.real * motion.turn.real + m.cross.imag * motion.turn.imag), 0.0)
        return np.asarray(m.constant - m.of_far * (apart.real**2 + apart.imag**2) - m.of_varies * varies)

    def bound(self, motion: GroundMotion) -> float:
        """Upper bound of `likelihood`: the tracklets of one camera may share those of the other."""
        gain = np.maximum(self.log_ratio(motion), 0.0)
        return float(min(gain.max(axis=0).sum(), gain.max(axis=1).sum())) if gain.size else 0.0

    def likelihood(self, motion: GroundMotion) -> tuple[float, float]:
        """Sum of the log-likelihood ratios of pairs that exclude each other, chosen greedily, and their common steps.

        No tracklet has two others at one time.
        """
        ratio, number = self.log_ratio(motion), self.moments(motion.steps).n
        overlap_a, overlap_b = self._overlaps
        taken, total, steps = np.zeros(ratio.shape, dtype=bool), 0.0, 0.0
        rows, columns = np.nonzero(ratio > 0)
        order = np.argsort(-ratio[rows, columns], kind="stable")
        for i, j in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
            if not taken[i, j]:
                total, steps = total + float(ratio[i, j]), steps + float(number[i, j])
                taken[i] |= overlap_b[j]
                taken[:, j] |= overlap_a[i]
        return total, steps


def evidence(a: Paths, b: Paths, tight: float = 1.0) -> Evidence:
    """The evidence that two cameras see the same people, in one frame. tight: factor of the errors of places."""
    a, b = a.longest(MOST), b.longest(MOST)
    used = np.flatnonzero(a.here.any(axis=0) | b.here.any(axis=0)) if len(a.z) and len(b.z) else np.zeros(0, dtype=np.int64)
    if not len(used):
        return Evidence()
    begin, end = int(used[0]), int(used[-1]) + 1
    one, two = a.between(begin, end), b.between(begin, end)
    others = [two, *(two.rolled(round(share * (end - begin))) for share in SHIFTS)]
    (found, steps), *chance = (TrackletPairs(one, other, tight).likelihood(GroundMotion()) for other in others)
    return Evidence(found, max(ratio for ratio, _ in chance), steps)


def moved(values: NDArray[Number], steps: int) -> NDArray[Number]:
    """Columns moved to later times by `steps`."""
    out = np.zeros_like(values)
    if steps >= 0:
        out[:, steps:] = values[:, : values.shape[1] - steps]
    else:
        out[:, :steps] = values[:, -steps:]
    return out
