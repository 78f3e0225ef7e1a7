"""How far each view's boxes can be believed, learned while tracking: how often it finds whom it should see, and how many boxes are nobody's.

Both are counted by confidence, so that a detector whose doubtful boxes are mostly right is used to the full, and one that is sure of
what is not there is not believed. Counts fade, and begin with what is assumed of every view. How often people are found of whom a part is
covered is counted, too, by how much it is and by what: an old detector loses whom a sign covers by a third, a new one hardly does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints

LEVELS = np.array([0.5, 0.8, 0.9, 0.97])
"""Bounds between the classes of confidence."""
COVERED = np.array([0.05, 0.2, 0.4, 0.6, 0.8])
"""Shares of a body that is covered at which the classes of cover begin ..."""
MIDDLE = np.array([0.0, 0.12, 0.3, 0.5, 0.7, 0.9])
"""... and the middles of the classes, after that of who is not covered."""


@dataclass(frozen=True)
class DetectionRateParameters:
    """detection: share of people found that is assumed at first, weight: as if counted on so many people; false: boxes of nobody, a square metre,
    weight_false: as if counted in so many ticks; memory: ticks after which a count has faded to a third; watched m: radius of the ground on which
    boxes are counted where no area is set; sharpness: share of the first counts that lies in the highest class of confidence."""

    detection: float = 0.9
    weight: float = 30.0
    false: float = 1e-3
    weight_false: float = 10.0
    memory: float = 150.0
    watched: float = 15.0
    sharpness: float = 0.6
    least: float = 0.2
    most: float = 0.97
    behind_things: tuple[float, ...] = (0.85, 0.6, 0.3, 0.15, 0.05)  # how often people are found who are covered by classes, of those who are not ...
    behind_people: tuple[float, ...] = (0.7, 0.5, 0.4, 0.3, 0.2)
    weight_covered: float = 40.0  # ... as if counted on so many of each


@dataclass(eq=False)
class _Counts:
    found: Array
    expected: float
    false: Array
    ticks: float


class DetectionRates:
    """Counts of each view. `square` m² is the ground on which boxes are counted."""

    def __init__(self, parameters: DetectionRateParameters, square: float) -> None:
        self.parameters, self.square = parameters, square
        self._counts: dict[str, _Counts] = {}
        self._covered: dict[tuple[str, int], tuple[Array, Array]] = {}  # camera, by things or by people → found and expected by classes of cover

    @staticmethod
    def level(confidence: Array) -> Ints:
        """Class (n,) of confidences (n,)."""
        return np.searchsorted(LEVELS, confidence, side="right")

    def _of(self, camera: str) -> _Counts:
        if camera not in self._counts:
            q, n = self.parameters, len(LEVELS) + 1
            true = np.full(n, (1 - q.sharpness) / (n - 1))
            true[-1] = q.sharpness
            self._counts[camera] = _Counts(
                q.detection * q.weight * true, q.weight, np.full(n, q.false * self.square * q.weight_false / n), q.weight_false
            )
        return self._counts[camera]

    def detection(self, camera: str) -> float:
        """Share of the people in full view who get a box."""
        c = self._of(camera)
        return float(np.clip(c.found.sum() / c.expected, self.parameters.least, self.parameters.most))

    def worth(self, camera: str, confidence: Array) -> Array:
        """log (n,) of the rate at which people get such boxes over that of false ones a square metre."""
        c, k = self._of(camera), self.level(confidence)
        found = c.found / c.found.sum() * self.detection(camera)
        return np.asarray(np.log(found[k] / (c.false[k] / c.ticks / self.square)))

    def shown(self, camera: str, cover: Array) -> Array:
        """How often (n,) people are found of whom things and others cover so much (n, 2), of those who are not covered."""
        out, q, detection = np.ones(len(cover)), self.parameters, self.detection(camera)
        for by, assumed in enumerate((q.behind_things, q.behind_people)):
            found, expected = self._covered.get((camera, by), (0.0, 0.0))
            share = (found + detection * q.weight_covered * np.array(assumed)) / (detection * (expected + q.weight_covered))
            # Who is covered more is not found more often, whatever few counts say.
            out *= np.interp(cover[:, by], MIDDLE, np.minimum.accumulate(np.append(1.0, share)))
        return out

    def learn_shown(self, camera: str, cover: Array, found: NDArray[np.bool_]) -> None:
        """Count of known people, of whom so much (n, 2) is covered, who was found (n,)."""
        for by in range(2):
            rows = (cover[:, by] >= COVERED[0]) & (cover[:, 1 - by] < COVERED[1] / 2)
            level = np.searchsorted(COVERED, cover[rows, by], side="right") - 1
            n = len(COVERED)
            before = self._covered.get((camera, by), (np.zeros(n), np.zeros(n)))
            now = np.bincount(level, found[rows], n), np.bincount(level, minlength=n).astype(np.float64)
            self._covered[camera, by] = before[0] + now[0], before[1] + now[1]

    def learn(self, camera: str, found: Array, expected: float, false: tuple[Array, Array]) -> None:
        """A tick: confidences (n,) of the boxes of known people, how many should have been seen, and of the other boxes confidence and weight."""
        c, n = self._of(camera), len(LEVELS) + 1
        fade, q = np.exp(-1 / self.parameters.memory), self.parameters
        c.found = fade * c.found + np.bincount(self.level(found), minlength=n)
        c.expected = fade * c.expected + expected
        c.false = fade * c.false + np.bincount(self.level(false[0]), weights=false[1], minlength=n)
        c.ticks = fade * c.ticks + 1.0
        # What has never been seen stays possible.
        c.false = np.maximum(c.false, 0.02 * q.false * self.square * c.ticks / n)
        c.found = np.maximum(c.found, 0.002 * c.expected)
