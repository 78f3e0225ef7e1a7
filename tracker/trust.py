"""How far each view's boxes can be believed, learned while tracking: how often it finds whom it should see, and how many boxes are nobody's.

Both are counted by confidence, so that a detector whose doubtful boxes are mostly right is used to the full, and one that is sure of
what is not there is not believed. Counts fade, and begin with what is assumed of every view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array
from tracker.measurements import Ints

LEVELS = np.array([0.5, 0.8, 0.9, 0.97])
"""Bounds between the classes of confidence."""


@dataclass(frozen=True)
class TrustParameters:
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


@dataclass(eq=False)
class _Counts:
    found: Array
    expected: float
    false: Array
    ticks: float


class Trust:
    """Counts of each view. `square` m² is the ground on which boxes are counted."""

    def __init__(self, parameters: TrustParameters, square: float) -> None:
        self.parameters, self.square = parameters, square
        self._counts: dict[str, _Counts] = {}

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
