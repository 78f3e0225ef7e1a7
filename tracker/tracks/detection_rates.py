"""Detection rate and clutter rate of each view, estimated while tracking.

Both are counted by classes of confidence. So the less confident boxes of a good detector count in full, and a confident detector with many false
boxes counts little. Counts fade exponentially and start from prior counts, which are the same for all views.

A confidence is a probability as given, or it is learned what it says. Then a class is a range of ranks among the last boxes of the view, so that no
detector's scale matters. The odds of a true box grow with its class (isotonic regression: Barlow et al. 1972, Statistical inference under order
restrictions).

Detection rates of partly visible people are counted by the share of the body that is covered, and by whether objects or people cover it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints

LEVELS = np.array([0.5, 0.8, 0.9, 0.97])
"""Bounds between the classes of confidences that are probabilities."""
CLASSES = 8
"""Number of classes of learned confidences."""
REMEMBERED = 600
"""Boxes of a view among which confidences are ranked, at most."""
PRIOR_RANKS = 20.0
"""Boxes that a rank in the middle counts for, while few boxes were seen."""
COVER_BOUNDS = np.array([0.05, 0.2, 0.4, 0.6, 0.8])
"""Covered shares of a body at which the classes of cover begin."""
COVER_MIDDLES = np.array([0.0, 0.12, 0.3, 0.5, 0.7, 0.9])
"""Covered shares in the middle of the classes; the first is that of visible bodies."""


@dataclass(frozen=True)
class DetectionRateParameters:
    """Prior counts, memory and bounds."""

    learned: bool = False  # whether it is learned what a confidence says; else it is a probability
    top_share: float = 0.6  # share of the prior counts in the highest class of confidences that are probabilities
    detection: float = 0.9  # prior detection rate of people in full view
    weight: float = 30.0  # people for which that rate counts
    false: float = 1e-3  # prior density of false boxes, a square metre of ground and tick
    weight_false: float = 10.0  # ticks for which that density counts
    memory: float = 150.0  # ticks, time constant with which counts fade
    watched: float = 15.0  # m, radius of the ground on which false boxes are counted where no area is set
    log_ratios: tuple[float, float] = (1.0, 8.5)  # prior of log_ratio in the lowest and the highest class of confidence
    shares: tuple[float, float] = (0.1, 0.95)  # prior share of people in the lowest and the highest class of confidence
    weight_share: float = 10.0  # boxes of a class for which that share counts
    min_detection: float = 0.2  # least detection rate
    max_detection: float = 0.97  # greatest detection rate
    behind_things: tuple[float, ...] = (0.85, 0.6, 0.3, 0.15, 0.05)  # prior relative detection rates of people behind objects, by classes of cover
    behind_people: tuple[float, ...] = (0.7, 0.5, 0.4, 0.3, 0.2)  # the same of people behind people
    weight_covered: float = 40.0  # people for which each of these rates counts


@dataclass(eq=False)
class _Counts:
    """Counts of a view: found and false (levels,) boxes by classes of confidence, expected people, and ticks."""

    found: Array
    expected: float
    false: Array
    ticks: float


class DetectionRates:
    """Counts of all views. `ground_area` m²: the ground on which false boxes are counted."""

    def __init__(self, parameters: DetectionRateParameters, ground_area: float) -> None:
        self.parameters, self.ground_area = parameters, ground_area
        self._counts: dict[str, _Counts] = {}
        self._seen: dict[str, Array] = {}  # camera → confidences of its last boxes, the latest last
        self._ranked: dict[str, Array] = {}  # the same, sorted
        self._covered: dict[tuple[str, int], tuple[Array, Array]] = {}  # camera, cover by objects (0) or people (1) → found and expected (classes,)

    def observe(self, camera: str, confidence: Array) -> None:
        """Remember the confidences (n,) of a tick where they are learned. Call it before they are ranked."""
        if not self.parameters.learned:
            return
        self._seen[camera] = np.concatenate([self._seen.get(camera, confidence[:0]), confidence])[-REMEMBERED:]
        self._ranked[camera] = np.sort(self._seen[camera])

    def level(self, camera: str, confidence: Array) -> Ints:
        """Class (n,) of confidences (n,): by value, or by their ranks among the last boxes of the view."""
        if not self.parameters.learned:
            return np.searchsorted(LEVELS, confidence, side="right")
        last = self._ranked.get(camera, confidence[:0])
        below = (np.searchsorted(last, confidence, side="left") + np.searchsorted(last, confidence, side="right")) / 2
        rank = (below + PRIOR_RANKS / 2) / (len(last) + PRIOR_RANKS)
        return np.minimum((CLASSES * rank).astype(np.int64), CLASSES - 1)

    def _of(self, camera: str) -> _Counts:
        if camera not in self._counts:
            q, n = self.parameters, len(LEVELS)
            if q.learned:
                rising = (np.arange(CLASSES) + 0.5) * 2 / CLASSES**2
                found = q.detection * q.weight * rising
                false = rising * q.detection * q.weight_false * self.ground_area * np.exp(-np.linspace(*q.log_ratios, CLASSES))
            else:
                found = q.detection * q.weight * np.append(np.full(n, (1 - q.top_share) / n), q.top_share)
                false = np.full(n + 1, q.false * self.ground_area * q.weight_false / (n + 1))
            self._counts[camera] = _Counts(found, q.weight, false, q.weight_false)
        return self._counts[camera]

    def detection(self, camera: str) -> float:
        """Detection rate of people in full view."""
        c = self._of(camera)
        return float(np.clip(c.found.sum() / c.expected, self.parameters.min_detection, self.parameters.max_detection))

    def log_ratio(self, camera: str, confidence: Array) -> Array:
        """log (n,) of the rate of boxes of people over the density of false boxes a square metre, for boxes of such confidence (n,)."""
        c = self._of(camera)
        scale = self.detection(camera) / c.found.sum() * c.ticks * self.ground_area
        odds = _isotonic_odds(c.found, c.false) if self.parameters.learned else c.found / c.false
        return np.asarray(np.log(scale * odds[self.level(camera, confidence)]))

    def share(self, camera: str, confidence: Array) -> Array:
        """Probability (n,) that boxes of such confidence (n,) are of people."""
        if not self.parameters.learned:
            return confidence
        c = self._of(camera)
        prior, q = self.parameters.weight_share * np.linspace(*self.parameters.shares, CLASSES), self.parameters
        odds = _isotonic_odds(c.found + prior, c.false + q.weight_share - prior)[self.level(camera, confidence)]
        return np.asarray(odds / (1 + odds))

    def relative_detection(self, camera: str, cover: Array) -> Array:
        """Detection rate (n,) of people covered by shares (n, 2) by objects and by people, relative to people in full view."""
        out, q, detection = np.ones(len(cover)), self.parameters, self.detection(camera)
        for by, prior in enumerate((q.behind_things, q.behind_people)):
            found, expected = self._covered.get((camera, by), (0.0, 0.0))
            share = (found + detection * q.weight_covered * np.array(prior)) / (detection * (expected + q.weight_covered))
            # Rates must not increase with the covered share, which small counts may suggest.
            out *= np.interp(cover[:, by], COVER_MIDDLES, np.minimum.accumulate(np.append(1.0, share)))
        return out

    def learn_partly_visible(self, camera: str, cover: Array, found: NDArray[np.bool_]) -> None:
        """Count which people (n,) were found, by their covered shares (n, 2); people covered by both objects and people are left out."""
        for by in range(2):
            rows = (cover[:, by] >= COVER_BOUNDS[0]) & (cover[:, 1 - by] < COVER_BOUNDS[1] / 2)
            level = np.searchsorted(COVER_BOUNDS, cover[rows, by], side="right") - 1
            n = len(COVER_BOUNDS)
            before = self._covered.get((camera, by), (np.zeros(n), np.zeros(n)))
            now = np.bincount(level, found[rows], n), np.bincount(level, minlength=n).astype(np.float64)
            self._covered[camera, by] = before[0] + now[0], before[1] + now[1]

    def learn(self, camera: str, found: Array, expected: float, false: tuple[Array, Array]) -> None:
        """Count a tick.

        found (n,): confidences of the boxes of confirmed people; expected: number of these people in full view. false: confidences and weights of the
        other boxes; a weight is the probability of a false box.
        """
        c = self._of(camera)
        n = len(c.found)
        fade, q = np.exp(-1 / self.parameters.memory), self.parameters
        c.found = fade * c.found + np.bincount(self.level(camera, found), minlength=n)
        c.expected = fade * c.expected + expected
        c.false = fade * c.false + np.bincount(self.level(camera, false[0]), weights=false[1], minlength=n)
        c.ticks = fade * c.ticks + 1.0
        # Floors keep all log ratios finite.
        c.false = np.maximum(c.false, 0.02 * q.false * self.ground_area * c.ticks / n)
        c.found = np.maximum(c.found, 0.002 * c.expected)


def _isotonic_odds(found: Array, false: Array) -> Array:
    """Odds (k,) found over false that do not fall from class to class; classes that would are pooled (pool adjacent violators)."""
    pools: list[tuple[float, float, int]] = []
    for good, bad in zip(found.tolist(), false.tolist(), strict=True):
        pools.append((good, bad, 1))
        while len(pools) > 1 and pools[-2][0] * pools[-1][1] >= pools[-1][0] * pools[-2][1]:
            (a, b, m), (c, d, n) = pools[-2:]
            pools[-2:] = [(a + c, b + d, m + n)]
    return np.repeat([good / bad for good, bad, _ in pools], [n for _, _, n in pools])
