"""The protocol of a policy that places robots, and the knowledge on which it acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.placement.observations import Observation
from tracker.geometry import Array


@dataclass(frozen=True, eq=False)
class TeamKnowledge:
    """The knowledge of a team before a decision.

    place: the map. config: the configuration, with the number of people. robots (r, 3): poses, x, y m and yaw rad.
    position (k, 2) m, velocity (k, 2) m/s, covariance (k, 2, 2) m²: of the people known. observation: as the environment gives it.
    """

    place: PlacementMap
    config: PlacementConfig
    robots: Array
    position: Array
    velocity: Array
    covariance: Array
    observation: Observation

    @staticmethod
    def of(episode: Episode, observation: Observation) -> TeamKnowledge:
        """The knowledge of the team of an episode, from its tracker where that is in the loop, else from its beliefs."""
        if episode.tracking is not None:
            memory = episode.tracking.memory
            robots, position, velocity, covariance = episode.tracking.planar_poses(), memory.position, memory.velocity, memory.covariance
        else:
            robots, velocity = episode.now.team[:, :3], episode.beliefs.mean[episode.beliefs.known > 0, 2:]
            position, covariance = episode.estimates()
        return TeamKnowledge(episode.place, episode.config, robots, position[:, :2], velocity, covariance[:, :2, :2], observation)


class Policy(Protocol):
    """Decides where robots go. action: the kind of its actions.

    `begin` gets the knowledge at the start of an episode. `act` gets that of each decision and returns an action (r, 2).
    """

    action: str

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None: ...

    def act(self, knowledge: TeamKnowledge) -> Array: ...


def waypoint_action(place: PlacementMap, numbers: NDArray[np.int64]) -> Array:
    """The waypoint action (r, 2) that sends robots to these nodes of the roadmap (r,)."""
    return place.normalised(place.roadmap.nodes[numbers])
