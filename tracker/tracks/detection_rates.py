"""Detection rate and clutter rate of each view, estimated while tracking.

Both rates are counted by classes of confidence. So the less confident boxes of a good detector have full weight, and the confident boxes of a
detector with many false boxes have little. Counts fade exponentially and start from prior counts, which are the same for all views.

A confidence is taken as a probability, or its meaning is learned, so that the scale of a detector does not matter (`ConfidenceCalibration`). The
odds that a box shows a person grow with its confidence. They are the isotonic regression of the last boxes, each counted as true or false (pool
adjacent violators: Barlow et al. 1972, Statistical inference under order restrictions). Only the order of confidences is used. So any increasing
transform of all of them gives the same odds.

Detection rates of partly visible people are counted without fading, by the covered share of the body and by whether objects or people cover it.

Furniture and pictures of people cause persistent false boxes. For each view, a map of the ground counts likely false boxes (`StandingClutter`).
Its counts fade over time, and fast where several views see a person.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints, Mask

LEVELS = np.array([0.5, 0.8, 0.9, 0.97])
"""Bounds between the classes of confidences that are probabilities."""
COVER_BOUNDS = np.array([0.05, 0.2, 0.4, 0.6, 0.8])
"""Covered shares of a body at which the classes of cover begin."""
COVER_MIDDLES = np.array([0.0, 0.12, 0.3, 0.5, 0.7, 0.9])
"""Covered shares in the middle of the classes; the first is that of visible bodies."""
RELATIVE_RATES = np.array([(0.85, 0.6, 0.3, 0.15, 0.05), (0.7, 0.5, 0.4, 0.3, 0.2)])
"""Prior relative detection rates of people behind objects, and of people behind people, by classes of cover."""
WEIGHT_COVERED = 40.0
"""Number of people for which each of these prior rates counts."""
TOP_SHARE = 0.6
"""Share of the prior counts in the highest class of confidences that are probabilities."""
MIN_DETECTION = 0.2
"""Least detection rate."""
WATCHED = 15.0
"""m, radius of the ground on which false boxes are counted where no area is set."""


@dataclass(frozen=True)
class DetectionRateParameters:
    """Prior counts, memory and bounds."""

    learned: bool = True  # whether the meaning of confidences is learned; else they are probabilities
    detection: float = 0.9  # prior detection rate of people in full view
    weight: float = 30.0  # number of people for which that rate counts
    false: float = 1e-3  # prior density of false boxes, per square metre of ground and tick
    weight_false: float = 100.0  # number of ticks for which that density counts
    memory: float = 150.0  # ticks, time constant with which counts fade
    log_ratios: tuple[float, float] = (1.0, 8.5)  # prior of log_ratio in the lowest and the highest class of confidence
    max_detection: float = 0.9  # greatest detection rate


@dataclass(eq=False)
class _Counts:
    """Counts of a view: found and false (levels,) boxes by classes of confidence, expected people and ticks, all faded; steps: ticks not faded."""

    found: Array
    expected: float
    false: Array
    ticks: float
    steps: int = 0


class DetectionRates:
    """Counts of all views. `ground_area` m²: the ground on which false boxes are counted."""

    def __init__(self, parameters: DetectionRateParameters, ground_area: float) -> None:
        self.parameters, self.ground_area = parameters, ground_area
        self._counts: dict[str, _Counts] = {}
        self._calibration: dict[str, ConfidenceCalibration] = {}  # of each camera, where the meaning of confidences is learned
        self._covered: dict[tuple[str, int], tuple[Array, Array]] = {}  # camera, cover by objects (0) or people (1) → found and expected (classes,)

    def observe(self, camera: str, confidence: Array) -> None:
        """Remember the confidences (n,) of a tick, where they are learned; call it before `rank` and `log_ratio` of that tick."""
        if self.parameters.learned:
            self._calibrated(camera).observe(confidence)

    def rank(self, camera: str, confidence: Array) -> Array:
        """Rank (n,) of confidences (n,) among the last boxes of a camera, 0 to 1; the confidences themselves where they are probabilities."""
        return self._calibrated(camera).rank(confidence) if self.parameters.learned else confidence

    def _calibrated(self, camera: str) -> ConfidenceCalibration:
        if camera not in self._calibration:
            self._calibration[camera] = ConfidenceCalibration(self.parameters.memory)
        return self._calibration[camera]

    def _of(self, camera: str) -> _Counts:
        if camera not in self._counts:
            q, n = self.parameters, len(LEVELS)
            found = q.detection * q.weight * np.append(np.full(n, (1 - TOP_SHARE) / n), TOP_SHARE)
            false = np.full(n + 1, q.false * self.ground_area * q.weight_false / (n + 1))
            self._counts[camera] = _Counts(found, q.weight, false, q.weight_false)
        return self._counts[camera]

    def detection(self, camera: str) -> float:
        """Detection rate of people in full view."""
        c = self._of(camera)
        return float(np.clip(c.found.sum() / c.expected, MIN_DETECTION, self.parameters.max_detection))

    def false_density(self, camera: str) -> float:
        """Density of false boxes of all confidences, per square metre and tick."""
        c = self._of(camera)
        return float(c.false.sum() / (c.ticks * self.ground_area))

    def log_ratio(self, camera: str, confidence: Array) -> Array:
        """log (n,) of the rate of boxes of people over the density of false boxes per square metre, for boxes of these confidences (n,)."""
        c, q = self._of(camera), self.parameters
        scale = self.detection(camera) / c.found.sum() * c.ticks * self.ground_area
        if not q.learned:
            return np.asarray(np.log(scale * (c.found / c.false)[np.searchsorted(LEVELS, confidence, side="right")]))
        # The prior is part of the counts, and fades with them.
        rising = (np.arange(RANKS) + 0.5) * 2 / RANKS**2 * q.detection
        false = rising * q.weight_false * self.ground_area * np.exp(-np.linspace(*q.log_ratios, RANKS))
        faded = np.exp(-(c.steps / q.memory))
        return np.asarray(np.log(scale * self._calibrated(camera).odds(confidence, faded * q.weight * rising, faded * false)))

    def relative_detection(self, camera: str, cover: Array) -> Array:
        """Detection rate (n,) of people covered by shares (n, 2) by objects and by people, relative to people in full view."""
        out, detection = np.ones(len(cover)), self.detection(camera)
        for by, prior in enumerate(RELATIVE_RATES):
            found, expected = self._covered.get((camera, by), (0.0, 0.0))
            share = (found + detection * WEIGHT_COVERED * prior) / (detection * (expected + WEIGHT_COVERED))
            # Rates must not increase with the covered share, although small counts may suggest it.
            out *= np.interp(cover[:, by], COVER_MIDDLES, np.minimum.accumulate(np.append(1.0, share)))
        return out

    def learn_partly_visible(self, camera: str, cover: Array, found: Mask) -> None:
        """Count which people (n,) were found, by their covered shares (n, 2); people covered by both objects and people are left out."""
        for by in range(2):
            rows = (cover[:, by] >= COVER_BOUNDS[0]) & (cover[:, 1 - by] < COVER_BOUNDS[1] / 2)
            level = np.searchsorted(COVER_BOUNDS, cover[rows, by], side="right") - 1
            n = len(COVER_BOUNDS)
            before = self._covered.get((camera, by), (np.zeros(n), np.zeros(n)))
            now = np.bincount(level, found[rows], n), np.bincount(level, minlength=n).astype(np.float64)
            self._covered[camera, by] = before[0] + now[0], before[1] + now[1]

    def learn(self, camera: str, found: Array, expected: float, false: Array, weight: Array) -> None:
        """Count a tick.

        found (n,): confidences of the boxes of confirmed people; expected: number of these people in full view. false (m,): confidences of the other
        boxes, which are false with probability `weight` (m,).
        """
        c, n = self._of(camera), len(LEVELS) + 1
        fade, q = np.exp(-1 / self.parameters.memory), self.parameters
        c.found = fade * c.found + np.bincount(np.searchsorted(LEVELS, found, side="right"), minlength=n)
        c.expected = fade * c.expected + expected
        c.false = fade * c.false + np.bincount(np.searchsorted(LEVELS, false, side="right"), weights=weight, minlength=n)
        c.ticks, c.steps = fade * c.ticks + 1.0, c.steps + 1
        # Floors keep all log ratios finite.
        c.false = np.maximum(c.false, 0.02 * q.false * self.ground_area * c.ticks / n)
        c.found = np.maximum(c.found, 0.002 * c.expected)
        if q.learned:
            self._calibrated(camera).learn(found, false, weight)


RANKS = 8
"""Number of ranks at which prior odds are given."""
REMEMBERED = 1500
"""Greatest number of boxes of a view that are remembered."""
PRIOR_RANKS = 20
"""Number of virtual boxes by which ranks are shrunk to the middle, while few boxes were seen."""
LEAST_COUNT = 1e-3
"""Least count of true or false boxes in a pool, which keeps odds finite."""


class ConfidenceCalibration:
    """Odds that boxes of one view show people, by confidence. `memory`: ticks, time constant with which counts fade."""

    def __init__(self, memory: float) -> None:
        self._fade = np.exp(-1 / memory)
        self._seen = np.zeros(0)  # confidences of the last boxes, the latest last
        self._ranked = self._seen  # the same, sorted
        self._confidence, self._found, self._false = np.zeros(0), np.zeros(0), np.zeros(0)  # of boxes that were judged, sorted by confidence
        self._age = np.zeros(0)

    def observe(self, confidence: Array) -> None:
        """Remember the confidences (n,) of a tick, among which boxes are ranked."""
        self._seen = np.concatenate([self._seen, confidence])[-REMEMBERED:]
        self._ranked = np.sort(self._seen)

    def rank(self, confidence: Array) -> Array:
        """Rank (n,), 0 to 1, of confidences (n,) among those that are remembered; equal ones have the mean of their ranks."""
        left, right = (np.searchsorted(self._ranked, confidence, side=side) for side in ("left", "right"))
        return np.asarray((left + right) / (2 * max(len(self._ranked), 1)))

    def learn(self, found: Array, false: Array, weight: Array) -> None:
        """Count the boxes of a tick: confidences of people's boxes (f,), and of other boxes (n,), which are false with probability `weight` (n,)."""
        new = np.concatenate([found, false])
        keep = np.argsort(self._age, kind="stable")[: REMEMBERED - min(len(new), REMEMBERED)]
        confidence = np.concatenate([self._confidence[keep], new])
        order = np.argsort(confidence, kind="stable")
        self._confidence = confidence[order]
        self._found = np.concatenate([self._fade * self._found[keep], np.ones(len(found)), np.zeros(len(false))])[order]
        self._false = np.concatenate([self._fade * self._false[keep], np.zeros(len(found)), weight])[order]
        self._age = np.concatenate([self._age[keep] + 1, np.zeros(len(new))])[order]

    def odds(self, confidence: Array, found: Array, false: Array) -> Array:
        """Odds (n,) that boxes of these confidences (n,) show people. found, false (RANKS,): prior counts, from the lowest to the highest rank."""
        if not len(confidence):
            return np.zeros(0)
        # Before the first tick no box is ranked, and all have the middle rank.
        ranked = self._ranked if len(self._ranked) else np.zeros(1)
        # Prior counts lie at quantiles of the boxes seen; where few were seen, these have ranks near the middle.
        rank = (np.arange(RANKS) + 0.5) / RANKS
        n = len(ranked)
        at = np.clip(np.round(rank * (n + PRIOR_RANKS) - PRIOR_RANKS / 2), -1, n).astype(np.int64)
        inside = (at >= 0) & (at < n)
        where = np.where(inside, ranked[np.clip(at, 0, n - 1)], np.where(at < 0, -np.inf, np.inf))
        values = np.concatenate([self._confidence, where])
        order = np.argsort(values, kind="stable")
        values, first = np.unique(values[order], return_index=True)
        good = np.add.reduceat(np.concatenate([self._found, found])[order], first)
        bad = np.add.reduceat(np.concatenate([self._false, false])[order], first)
        fitted = _isotonic(good, bad)
        # Between two values, the odds are their geometric mean.
        below = np.clip(np.searchsorted(values, confidence, side="right") - 1, 0, None)
        above = np.clip(np.searchsorted(values, confidence, side="left"), None, len(values) - 1)
        return np.asarray(np.sqrt(fitted[below] * fitted[above]))


def _isotonic(good: Array, bad: Array) -> Array:
    """Non-decreasing odds (k,) of good over bad counts; neighbours that would decrease are pooled."""
    total = np.maximum(good + bad, LEAST_COUNT**2)
    first = isotonic_regression(good / total, weights=total).blocks[:-1]
    odds = (np.add.reduceat(good, first) + LEAST_COUNT) / (np.add.reduceat(bad, first) + LEAST_COUNT)
    return np.asarray(np.repeat(odds, np.diff(np.append(first, len(good)))))


CELL = 0.5
"""m: edge of a cell of the map."""
AROUND = np.array([(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
"""Offsets of the cells that are summed around a place: errors of feet are about as large as a cell."""
LEAST_IN_CELL = 0.05
"""Counts below which a cell is forgotten."""
SURELY_FALSE = 0.5
"""Probability of being false above which a box is counted."""


CLUTTER_MEMORY, UNKNOWN = 60.0, 30.0
"""Ticks: time constant with which counts fade; prior number of ticks without a false box at any place."""
CHANCE = 1.0
"""Number of boxes around a place that is no evidence: people are missed, and false boxes occur at random."""
SEEN_AGAIN = 0.8
"""Factor of the counts around a person whom several views see, per person and tick."""


class StandingClutter:
    """The maps of all views: of each camera, the keys (k,) of cells in ascending order, and their counts (k,)."""

    def __init__(self) -> None:
        self._maps: dict[str, tuple[Ints, Array]] = {}

    def density(self, feet: GroundDetections) -> Array:
        """Density (n,) of persistent false boxes, per square metre and tick, at the boxes of a view."""
        out = np.zeros(len(feet))
        if feet.camera in self._maps:
            row, known = self._rows(feet.camera, feet.point[feet.grounded, :2])
            out[feet.grounded] = np.where(known, self._maps[feet.camera][1][row], 0.0).sum(axis=1)
        return np.maximum(out - CHANCE, 0.0) / (len(AROUND) * CELL**2 * (CLUTTER_MEMORY + UNKNOWN))

    def learn(self, feet: GroundDetections, false: Array, sure: Array) -> None:
        """Count a tick of a view. false (n,): probability that each box is false. sure (m, 2) m: places of people whom several views see."""
        key, count = self._maps.get(feet.camera, (np.zeros(0, dtype=np.int64), np.zeros(0)))
        count = np.exp(-1 / CLUTTER_MEMORY) * count
        kept, rows = count >= LEAST_IN_CELL, feet.grounded & (false > SURELY_FALSE)
        keys, of = np.unique(np.concatenate([key[kept], _key(_cell(feet.point[rows, :2]))]), return_inverse=True)
        total = np.bincount(of, np.concatenate([count[kept], false[rows]]), len(keys)).astype(np.float64)
        if not len(keys):
            self._maps.pop(feet.camera, None)
            return
        self._maps[feet.camera] = keys, total
        row, known = self._rows(feet.camera, sure)
        np.multiply.at(total, row[known], SEEN_AGAIN)

    def _rows(self, camera: str, place: Array) -> tuple[Ints, Mask]:
        """Rows (n, 9) in the map of a camera of the cells around places (n, 2) m, and which of them it has."""
        key = self._maps[camera][0]
        wanted = _key(_cell(place)[:, None] + AROUND)
        row = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
        return row, key[row] == wanted


def _cell(place: Array) -> Ints:
    return np.asarray(np.floor(place / CELL), dtype=np.int64)


def _key(cell: Ints) -> Ints:
    """One number (...,) for each cell (..., 2)."""
    return np.asarray(cell[..., 0] * 2**32 + cell[..., 1])
