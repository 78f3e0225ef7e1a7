"""What a team remembers of the people whom its tracker tells of: how they moved, and for a while where those must be who are told of no more."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array
from tracker.measurements import Ints

LASTING = 8.0
"""s for which somebody is remembered who is told of no more."""
BLEND = 0.5
"""s over which velocities are averaged: a tracker's places tremble."""
UNSTEADY = 0.6
"""m²/s³: how fast the velocity of somebody who is out of sight becomes uncertain, an axis."""
SAME = 1.0
"""m: somebody who is told of so near to where another must be is that other, under a new number."""


@dataclass(eq=False)
class Recall:
    """number (k,) of the tracker; position (k, 2) m, velocity (k, 2) m/s, covariance (k, 2, 2) m², unseen (k,) s since they were told of."""

    number: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    position: Array = field(default_factory=lambda: np.zeros((0, 2)))
    velocity: Array = field(default_factory=lambda: np.zeros((0, 2)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))
    unseen: Array = field(default_factory=lambda: np.zeros(0))

    def take(self, number: Ints, position: Array, covariance: Array, dt: float) -> None:
        """The tracker tells of these people, dt s after it did last."""
        ahead = self.position + self.velocity * dt
        then = {int(n): k for k, n in enumerate(self.number)}
        old = np.array([then.get(int(n), -1) for n in number], dtype=np.int64)
        velocity = np.zeros_like(position)
        known = old >= 0
        moved = (position[known] - self.position[old[known]]) / dt
        velocity[known] = self.velocity[old[known]] + min(dt / BLEND, 1.0) * (moved - self.velocity[old[known]])
        unseen = self.unseen + dt
        near = (np.linalg.norm(ahead[:, None] - position[None], axis=2) < SAME).any(axis=1)
        kept = ~np.isin(self.number, number) & (unseen <= LASTING) & ~near
        # White noise on the acceleration: the place's variance grows with the third power of the time.
        growth = UNSTEADY * (unseen**3 - self.unseen**3) / 3
        spread = self.covariance + growth[:, None, None] * np.eye(2)
        self.number = np.concatenate([number, self.number[kept]])
        self.position, self.velocity = np.concatenate([position, ahead[kept]]), np.concatenate([velocity, self.velocity[kept]])
        self.covariance = np.concatenate([covariance, spread[kept]])
        self.unseen = np.concatenate([np.zeros(len(number)), unseen[kept]])
