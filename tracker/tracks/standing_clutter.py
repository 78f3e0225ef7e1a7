"""False boxes that stay: for each view a map of the ground where boxes keep appearing that nobody takes, learned while tracking.

Such boxes are of furniture, or of pictures of people. Counts fade in time, and fast where a person stands whom several views see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints

CELL = 0.5
"""m: edge of a cell of the map."""
AROUND = np.array([(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
"""Cells over which a place is looked up: errors of feet are about as large as a cell."""
LEAST = 0.05
"""Counts below which a cell is forgotten."""
FALSE = 0.5
"""Probability to be false from which a box counts."""


@dataclass(frozen=True)
class StandingClutterParameters:
    """How false boxes that stay are learned."""

    memory: float = 60.0  # ticks, time constant with which counts fade
    weight: float = 30.0  # ticks without a false box for which an unknown place counts
    chance: float = 1.0  # boxes about a place that say nothing, as people are missed and false boxes come anew
    seen_again: float = 0.8  # factor of the counts in a tick in which a person stands there whom several views see
    enabled: bool = True


class StandingClutter:
    """The maps of all views."""

    def __init__(self, parameters: StandingClutterParameters) -> None:
        self.parameters = parameters
        self._maps: dict[str, dict[tuple[int, int], float]] = {}

    def density(self, feet: GroundDetections) -> Array:
        """Density (n,) of false boxes that stay, a square metre and tick, at the boxes of a view."""
        q, out, known = self.parameters, np.zeros(len(feet)), self._maps.get(feet.camera)
        if not known:
            return out
        for k in np.flatnonzero(feet.grounded).tolist():
            out[k] = sum(known.get((int(i), int(j)), 0.0) for i, j in _cell(feet.point[k, :2]) + AROUND)
        return np.maximum(out - q.chance, 0.0) / (len(AROUND) * CELL**2 * (q.memory + q.weight))

    def learn(self, feet: GroundDetections, false: Array, sure: Array) -> None:
        """Count a tick of a view. false (n,): probability of each box to be false. sure (m, 2) m: places of people whom several views see."""
        q, known = self.parameters, self._maps.setdefault(feet.camera, {})
        fade = np.exp(-1 / q.memory)
        for cell, count in list(known.items()):
            known[cell] = fade * count
            if known[cell] < LEAST:
                del known[cell]
        for k in np.flatnonzero(feet.grounded & (false > FALSE)).tolist():
            i, j = _cell(feet.point[k, :2]).tolist()
            known[i, j] = known.get((i, j), 0.0) + float(false[k])
        for place in sure:
            for i, j in (_cell(place) + AROUND).tolist():
                if (i, j) in known:
                    known[i, j] *= q.seen_again


def _cell(place: Array) -> Ints:
    return np.asarray(np.floor(place / CELL), dtype=np.int64)
