"""An episode of placing robots: people walk, robots go where they are told, and who is seen, believed and in danger is told each decision.

No gymnasium in it: placement.py and placement_parallel.py wrap it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.placement import beliefs, kinematics, visibility
from sim.placement.beliefs import Beliefs
from sim.placement.config import FRAMES, SEEDS_A_MAP, SPEED, PlacementConfig, X, Y
from sim.placement.kinematics import NEAR
from sim.placement.map import MapKey, PlacementMap, height_on, map_of
from sim.placement.movers import Kinematic, Mover, Physical
from sim.placement.rewards import gospa_share
from sim.placement.roadmap import steer
from sim.placement.tracker_in_loop import Tracking
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array
from worlds.terrain.heightfield import Mask

TRAIL = 60
"""Decisions that a trail goes back."""


@dataclass(frozen=True, eq=False)
class Decision:
    """How things are: team (r, 7) in the columns of placement_team; people (p, 4) feet x, y, z m and stature m; eyes (r, 3) m; seen (r, p) shares;
    stopped (r,), who was stopped in the last decision, and by what (placement_team.drive); over (r,), who has tipped over.
    """

    team: Array
    people: Array
    eyes: Array
    seen: Array
    stopped: Array
    over: Mask


@dataclass(eq=False)
class Episode:
    """The state between decisions. `begin` makes one; `step` changes it.

    unseen (p,): s since each of the people was seen; goals (r,): the places of the roads that robots are on the way to, where waypoints are
    given; trail: where they have been, (r, 2) m a decision.
    """

    config: PlacementConfig
    place: PlacementMap
    mover: Mover
    rng: np.random.Generator
    now: Decision
    beliefs: Beliefs
    unseen: Array
    tracking: Tracking | None = None
    goals: NDArray[np.int64] | None = None
    trail: list[Array] = field(default_factory=list)
    terms: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def begin(config: PlacementConfig, key: MapKey, rng: np.random.Generator, starts: Array | None = None) -> Episode:
        """The first moment; starts (robots, 3) x, y m, yaw rad, drawn where None. Raises ValueError where starts are not free or nothing fits in."""
        place = map_of(key)
        chosen = place.draw_starts(rng, config.robots) if starts is None else place.checked_starts(starts, config.robots)
        crowd = place.start_people(rng, chosen[:, :2])
        kind: type[Physical] | type[Kinematic] = Physical if config.drive == "physics" else Kinematic
        mover: Mover = kind.begin(config, place, chosen, crowd)
        tracking = Tracking.begin(config, place, mover, rng) if config.observation == "tracks" else None
        nothing = np.zeros(config.robots)
        upright = np.zeros(config.robots, dtype=bool)
        people = place.people_at(mover.crowd)
        now = Decision(mover.team, people, np.zeros((config.robots, 3)), np.zeros((config.robots, config.people)), nothing, upright)
        episode = Episode(config, place, mover, rng, now, Beliefs.none(config.people), np.zeros(config.people), tracking)
        if tracking is not None:
            tracking.take(mover, people)
        episode._look(0.0)
        return episode

    def step(self, action: Array) -> dict[str, float]:
        """A decision later: the terms of what that is worth. action (r, 2) in [−1, 1]."""
        before, mover, frightened = self.now, self.mover, 0
        stopped = np.zeros(len(before.team))
        if self.config.action == "waypoint":
            self.goals = self.place.roads.nearest(self.place.metres(action))
        for _ in range(FRAMES):
            stopped = np.maximum(stopped, mover.advance(self._command(action, mover.team)))
            frightened = max(frightened, _frightened(mover.team, mover.crowd.position))
            if self.tracking is not None:
                self.tracking.take(mover, self.place.people_at(mover.crowd))
        self.now = replace(before, team=mover.team, people=self.place.people_at(mover.crowd), stopped=stopped, over=mover.over())
        self.trail = [*self.trail[1 - TRAIL :], mover.team[:, :2]]
        information = self._look(self.config.period)
        climbed = self.now.eyes[:, 2] - before.eyes[:, 2]
        self.terms = self._told(information) | {
            "collisions": float((stopped > 0).sum()),
            "near_misses": float(frightened),
            "tip_overs": float((self.now.over & ~before.over).sum()),
            "energy": kinematics.energy(before.team, self.now.team, climbed),
        }
        return self.terms

    @property
    def lost(self) -> bool:
        """Whether no robot stands on its wheels any more."""
        return bool(self.now.over.all())

    def estimates(self) -> tuple[Array, Array]:
        """(k, 2) m and (k, 2, 2) m²: where people are believed to be, by the tracker where it is in the loop."""
        if self.tracking is not None:
            return self.tracking.position, self.tracking.covariance
        known = self.beliefs.known > 0
        return self.beliefs.mean[known, :2], self.beliefs.covariance[known, :2, :2]

    def _command(self, action: Array, team: Array) -> Array:
        """(r, 2) m/s and rad/s: of an action of the configured kind, for robots that are at team (r, 7) now."""
        if self.goals is None:
            return action * np.array([TOP_SPEED, TOP_YAW_RATE])
        roads = self.place.roads
        return np.asarray(steer(team, self.goals, self.mover.crowd.position, (roads.places, roads.onward), roads.ground), dtype=np.float64)

    def _look(self, dt: float) -> float:
        """See who is seen, and believe it; nats gained a person."""
        now, config = self.now, self.config
        eyes = kinematics.eyes(now.team, self.place, config.camera_height)
        seen = visibility.seen(self.place.heights, eyes, now.people, config.eyesight) * ~now.over[:, None]
        self.now = replace(now, eyes=eyes, seen=seen)
        self.unseen = (self.unseen + dt) * ~seen.any(axis=0)
        feet = now.people[:, :2]
        mast = eyes.copy()
        mast[:, 2] = np.maximum(eyes[:, 2] - height_on(self.place.floor, now.team[:, :2]), 0.2)
        measured = beliefs.measure(feet, mast, self.rng)
        self.beliefs, gain = self.beliefs.predicted(dt).updated(measured, mast, seen)
        return gain / max(config.people, 1)

    def _told(self, information: float) -> dict[str, float]:
        views, people = (self.now.seen > 0).sum(axis=0), max(self.config.people, 1)
        return {
            "seen": float((views >= 1).sum() / people),
            "seen_twice": float((views >= 2).sum() / people),
            "gospa": gospa_share(self.now.people[:, :2], self.estimates()[0]),
            "information": information,
        }

    @staticmethod
    def key(config: PlacementConfig, seed: int) -> MapKey:
        """The map of the episode of that seed."""
        return MapKey(config.world, config.difficulty, seed // SEEDS_A_MAP if config.map_seed is None else config.map_seed, config.people)


@njit(cache=True)
def _frightened(team, people):  # type: ignore[no-untyped-def]
    """How many people are nearer than NEAR to a robot that moves."""
    count = 0
    for p in range(len(people)):
        for r in range(len(team)):
            if abs(team[r, SPEED]) > 0.1 and (people[p, 0] - team[r, X]) ** 2 + (people[p, 1] - team[r, Y]) ** 2 < NEAR**2:
                count += 1
                break
    return count
