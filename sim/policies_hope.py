"""Where somebody may be whom the team does not know: wherever people walk and nobody looked for a while."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.placement_map import PlacementMap
from sim.policies import Briefing

FADING = 12.0
"""s after which nobody knows any more that a place was empty."""


class Hope:
    """What a team remembers of having looked: left (k,), how much people may be unseen at each of the map's `where_people_may_be`.

    At first, and long after a look, that is the map's `traffic`; nothing right after it.
    """

    def __init__(self, place: PlacementMap) -> None:
        self.left = place.traffic.copy()

    def look(self, briefing: Briefing, share: float) -> NDArray[np.int64]:
        """(r,): the places of the roads at which the robots are. share: how much comes back of what was lost, since the last look."""
        place = briefing.place
        here = place.roads.nearest(briefing.robots[:, :2])
        self.left += (place.traffic - self.left) * share
        self.left[place.sees(briefing.config.reach)[here].any(axis=0)] = 0.0
        return here
