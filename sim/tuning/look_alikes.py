"""Things that a detector takes for people, in all views: coat stands, posts, chairs, plants. They are detected less surely than people."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from sim.tuning.detectors import inside_bounds
from sim.tuning.walks import Surroundings
from tracker.detector_models.bodies import SimulatedBoxes
from tracker.detector_models.processes import persistence
from tracker.geometry import Array

SHARE = 0.35
"""Share of the cases with such things."""
DENSITY, MOST = 0.06, 8.0
"""Mean number per square metre, and its limit per case; one more thing always stands there."""
NEAR_WALL = 0.6
"""m: they stand no farther than this from walls and furniture."""
HEIGHTS = (0.8, 1.9)
"""m: bounds of their heights."""
FOUND, FOUND_TIME = (0.25, 0.9), 3.0
"""Bounds of their detection rate relative to a person in their place, and time constant of detections in a view, s."""
WEAKER, NOISE = (0.3, 3.5), 0.3
"""Bounds of the reduction of the logit of their confidences, and its standard deviation from box to box."""


@dataclass(frozen=True, eq=False)
class LookAlikes:
    """The n things of a case: place (n, 2) m, height (n,) m, found (n,) and weaker (n,) as FOUND and WEAKER, and the seed of their detections."""

    place: Array
    height: Array
    found: Array
    weaker: Array
    seed: int

    def __len__(self) -> int:
        return len(self.place)

    @staticmethod
    def none() -> LookAlikes:
        """No things."""
        return LookAlikes(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), 0)

    @staticmethod
    def drawn(around: Surroundings, rng: np.random.Generator) -> LookAlikes:
        """The things of a case, in a SHARE of all cases."""
        if rng.random() >= SHARE:
            return LookAlikes.none()
        free = around.free
        points = free.points(free.free & (free.clearance < NEAR_WALL))
        area = float(np.prod(around.area[1] - around.area[0]))
        count = min(len(points), 1 + int(rng.poisson(min(MOST, DENSITY * area))))
        place = points[rng.permutation(len(points))[:count]]
        drawn = [rng.uniform(*bounds, count) for bounds in (HEIGHTS, FOUND, WEAKER)]
        return LookAlikes(place, drawn[0], drawn[1], drawn[2], int(rng.integers(1 << 30)))


class LookAlikesInView:
    """The things as one view detects them, frame by frame. `people`: greatest id of a person; the ids of things follow it."""

    def __init__(self, things: LookAlikes, people: int, period: float, view: int) -> None:
        self.things, self.people = things, people
        self._rng, self._kept = np.random.default_rng([things.seed, view]), persistence(FOUND_TIME, period)
        self._state = self._rng.random(len(things))

    def weakened(self, found: SimulatedBoxes) -> SimulatedBoxes:
        """The boxes of a frame. Boxes of things get lower confidences, and are dropped in a share of the frames."""
        n = len(self.things)
        if not n:
            return found
        renewed = self._rng.random(n) >= self._kept
        self._state = np.where(renewed, self._rng.random(n), self._state)
        noise = self._rng.normal(0.0, NOISE, n)
        thing = found.person - self.people - 1
        mine = thing >= 0
        sure = found.confidence.copy()
        sure[mine] = expit(logit(inside_bounds(sure[mine])) - (self.things.weaker + noise)[thing[mine]])
        kept = ~mine | (self._state < self.things.found)[np.maximum(thing, 0)]
        return replace(found, boxes=found.boxes[kept], confidence=sure[kept], person=found.person[kept])
