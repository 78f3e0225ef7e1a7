"""What a policy that places robots is: the protocol, and what it is told at the start of an episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.placement.observations import Arrays
from tracker.geometry import Array


@dataclass(frozen=True, eq=False)
class Briefing:
    """What a team knows: the map; own places (r, 3) x, y m and yaw; people believed at position (k, 2) m, moving with velocity (k, 2) m/s, covariance
    (k, 2, 2) m²; how many people there are; and what the environment shows.
    """

    place: PlacementMap
    config: PlacementConfig
    robots: Array
    position: Array
    velocity: Array
    covariance: Array
    shown: Arrays

    @staticmethod
    def of(episode: Episode, shown: Arrays) -> Briefing:
        if episode.tracking is not None:
            told = episode.tracking.recall
            robots, position, velocity, covariance = episode.tracking.planar_poses(), told.position, told.velocity, told.covariance
        else:
            robots, velocity = episode.now.team[:, :3], episode.beliefs.mean[episode.beliefs.known > 0, 2:]
            position, covariance = episode.estimates()
        return Briefing(episode.place, episode.config, robots, position[:, :2], velocity, covariance[:, :2, :2], shown)


class Policy(Protocol):
    """Decides where robots go. action: the kind of action that it gives; `begin` is told the first briefing of an episode, `act` each one."""

    action: str

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None: ...

    def act(self, briefing: Briefing) -> Array: ...


def to_places(place: PlacementMap, numbers: NDArray[np.int64]) -> Array:
    """(r, 2): the action "waypoint" that sends robots to these places of the roads."""
    return place.normalised(place.roads.places[numbers])
