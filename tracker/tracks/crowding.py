"""How crowded it is, by the distances of tracked people to their nearest neighbours.

From it follows the rate of new people.

Among people at random places of density λ, the mean distance to the nearest one is 1 / (2 √λ) (Clark & Evans 1954).
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array

LEAST, MEMORY = 4, 3.0
"""Tracks from which on distances tell anything, and s of the average."""
USUAL_DENSITY = 0.15
"""People a square metre up to which the rate of new people stays as it is; above, it grows in proportion."""


class Crowding:
    """The average distance of neighbours, m, and what follows from it."""

    def __init__(self, period: float) -> None:
        """period: s of a tick."""
        self._share = 1 - np.exp(-period / MEMORY)
        self.distance = np.inf

    def learn(self, places: Array) -> None:
        """Take the places (n, 2) m of the tracked people of a tick."""
        if len(places) < LEAST:
            return
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        np.fill_diagonal(apart, np.inf)
        now = float(np.mean(apart.min(axis=1)))
        self.distance = now if not np.isfinite(self.distance) else self.distance + self._share * (now - self.distance)

    @property
    def arrivals(self) -> float:
        """Factor of the rate of new people."""
        density = 1 / (4 * self.distance**2) if self.distance > 0 else np.inf
        return float(np.clip(density / USUAL_DENSITY, 1.0, 100.0))
