"""An episode of placing robots: the state between decisions, and the reward of each decision, a weighted sum of named terms.

It is independent of gymnasium. env.py and parallel_env.py wrap it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.placement import beliefs, kinematics, visibility
from sim.placement.beliefs import Beliefs
from sim.placement.config import FRAMES_PER_DECISION, SEEDS_PER_MAP, SPEED, PlacementConfig, X, Y
from sim.placement.kinematics import NEAR_MISS_DISTANCE
from sim.placement.map import MapKey, PlacementMap, height_on, map_of
from sim.placement.movers import KinematicMover, Mover, PhysicsMover
from sim.placement.roadmap import steer
from sim.placement.tracker_in_loop import TrackerInLoop
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds.terrain.heightfield import Mask

TRAIL_LENGTH = 60
"""Number of decisions that a trail covers."""
GOSPA_CUTOFF = 2.0
"""Cut-off distance c of GOSPA, m."""
TERMS: dict[str, str] = {
    "seen": "share of people whom at least one robot sees, in [0, 1]",
    "seen_twice": "share of people whom at least two robots see, in [0, 1]",
    "gospa": "GOSPA of tracks or beliefs (c = 2 m, p = 2) over that of an empty estimate: 0 is perfect, 1 is no better than the empty estimate",
    "information": "information gain per person, nats: half the decrease of the log determinants of the position covariances",
    "collisions": "robots stopped by a person, by another robot or by the ground in this decision",
    "near_misses": "people within 0.98 m of a moving robot",
    "tip_overs": "robots that tipped over in this decision",
    "energy": "energy spent by all robots, kJ",
}
"""Every term of the reward and its meaning."""
WEIGHTS: dict[str, float] = {
    "seen": 0.3,
    "seen_twice": 1.0,
    "gospa": 0.0,
    "information": 0.02,
    "collisions": -0.05,
    "near_misses": -0.05,
    "tip_overs": -5.0,
    "energy": -0.02,
}
"""Default weights."""

Reward = Mapping[str, float] | Callable[[Mapping[str, float]], float]
"""Weights by term (0 for a missing term), or a function of all terms."""


@dataclass(frozen=True, eq=False)
class Decision:
    """The situation after a decision.

    team (r, 7): rover states, in the columns of config.py. people (p, 4): feet x, y, z m and stature m. cameras (r, 3): positions, m.
    seen (r, p): shares of bodies seen. stopped (r,): what stopped a robot in the last decision, as in kinematics.drive.
    tipped (r,): whether a robot has tipped over.
    """

    team: Array
    people: Array
    cameras: Array
    seen: Array
    stopped: Array
    tipped: Mask


@dataclass(eq=False)
class Episode:
    """The state between decisions. `begin` makes an episode and `step` advances it.

    time_unseen (p,): time since each person was last seen, s. goals (r,): goal nodes of the roadmap, for waypoint actions.
    trail: robot positions (r, 2) m after each of the last decisions.
    """

    config: PlacementConfig
    place: PlacementMap
    mover: Mover
    rng: np.random.Generator
    now: Decision
    beliefs: Beliefs
    time_unseen: Array
    tracking: TrackerInLoop | None = None
    goals: NDArray[np.int64] | None = None
    trail: list[Array] = field(default_factory=list)
    terms: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def begin(config: PlacementConfig, key: MapKey, rng: np.random.Generator, starts: Array | None = None) -> Episode:
        """An episode at its start. starts (robots, 3): x, y m and yaw rad, drawn where None.

        Raises ValueError for starts that are not free, and where robots or people do not fit into the world.
        """
        place = map_of(key)
        chosen = place.draw_starts(rng, config.robots) if starts is None else place.checked_starts(starts, config.robots)
        crowd = place.start_people(rng, chosen[:, :2])
        kind = PhysicsMover if config.drive == "physics" else KinematicMover.begin
        mover: Mover = kind(config, place, chosen, crowd)
        tracking = TrackerInLoop.begin(config, place, mover, rng) if config.observation == "tracks" else None
        nothing = np.zeros(config.robots)
        upright = np.zeros(config.robots, dtype=bool)
        people = place.people_at(mover.crowd)
        now = Decision(mover.team, people, np.zeros((config.robots, 3)), np.zeros((config.robots, config.people)), nothing, upright)
        episode = Episode(config, place, mover, rng, now, Beliefs.none(config.people), np.zeros(config.people), tracking)
        if tracking is not None:
            tracking.update(mover, people)
        episode._update_beliefs(0.0)
        return episode

    def step(self, action: Array) -> dict[str, float]:
        """Advance by one decision with action (r, 2) in [−1, 1], and return its reward terms."""
        before, mover, near_misses = self.now, self.mover, 0
        stopped = np.zeros(len(before.team))
        if self.config.action == "waypoint":
            self.goals = self.place.roadmap.nearest(self.place.metres(action))
        for _ in range(FRAMES_PER_DECISION):
            stopped = np.maximum(stopped, mover.advance(self._command(action, mover.team)))
            near_misses = max(near_misses, _near_misses(mover.team, mover.crowd.position))
            if self.tracking is not None:
                self.tracking.update(mover, self.place.people_at(mover.crowd))
        self.now = replace(before, team=mover.team, people=self.place.people_at(mover.crowd), stopped=stopped, tipped=mover.tipped())
        self.trail = [*self.trail[1 - TRAIL_LENGTH :], mover.team[:, :2]]
        information = self._update_beliefs(self.config.period)
        climbed = self.now.cameras[:, 2] - before.cameras[:, 2]
        self.terms = self._visibility_terms(information) | {
            "collisions": float((stopped > 0).sum()),
            "near_misses": float(near_misses),
            "tip_overs": float((self.now.tipped & ~before.tipped).sum()),
            "energy": kinematics.energy(before.team, self.now.team, climbed),
        }
        return self.terms

    @property
    def all_tipped(self) -> bool:
        """Whether all robots have tipped over."""
        return bool(self.now.tipped.all())

    def estimates(self) -> tuple[Array, Array]:
        """Positions (k, 2) m of people and their covariances (k, 2, 2) m², from the tracker where it is in the loop."""
        if self.tracking is not None:
            return self.tracking.position, self.tracking.covariance
        known = self.beliefs.known > 0
        return self.beliefs.mean[known, :2], self.beliefs.covariance[known, :2, :2]

    def _command(self, action: Array, team: Array) -> Array:
        """Velocity commands (r, 2) m/s and rad/s of an action, for robots of states team (r, 7)."""
        if self.goals is None:
            return action * np.array([TOP_SPEED, TOP_YAW_RATE])
        roadmap = self.place.roadmap
        return np.asarray(steer(team, self.goals, self.mover.crowd.position, (roadmap.nodes, roadmap.next_node), roadmap.grid), dtype=np.float64)

    def _update_beliefs(self, dt: float) -> float:
        """Update visibility and beliefs. Returns the information gain per person, nats."""
        now, config = self.now, self.config
        cameras = kinematics.camera_positions(now.team, self.place, config.camera_height)
        seen = visibility.seen_share(self.place.elevation, cameras, now.people, config.visibility_limits) * ~now.tipped[:, None]
        self.now = replace(now, cameras=cameras, seen=seen)
        self.time_unseen = (self.time_unseen + dt) * ~seen.any(axis=0)
        feet = now.people[:, :2]
        mast = cameras.copy()
        mast[:, 2] = np.maximum(cameras[:, 2] - height_on(self.place.floor, now.team[:, :2]), 0.2)
        measured = beliefs.measure(feet, mast, self.rng)
        self.beliefs, gain = self.beliefs.predicted(dt).updated(measured, mast, seen)
        return gain / max(config.people, 1)

    def _visibility_terms(self, information: float) -> dict[str, float]:
        views, people = (self.now.seen > 0).sum(axis=0), max(self.config.people, 1)
        return {
            "seen": float((views >= 1).sum() / people),
            "seen_twice": float((views >= 2).sum() / people),
            "gospa": relative_gospa(self.now.people[:, :2], self.estimates()[0]),
            "information": information,
        }

    @staticmethod
    def key(config: PlacementConfig, seed: int) -> MapKey:
        """The key of the map of an episode of this seed."""
        return MapKey(config.world, config.difficulty, seed // SEEDS_PER_MAP if config.map_seed is None else config.map_seed, config.people)


def checked_reward(reward: Reward | None) -> Reward:
    """The reward, or the default weights for None. Raises ValueError for an unknown term and for a weight that is not finite."""
    if reward is None:
        return dict(WEIGHTS)
    if callable(reward):
        return reward
    if not isinstance(reward, Mapping):
        raise ValueError(f"reward is {reward!r}, needs weights by term or a function of the terms")
    for name, weight in reward.items():
        if name not in TERMS:
            raise ValueError(f"reward has the term {name!r}, needs some of {', '.join(TERMS)}")
        if not isinstance(weight, (int, float, np.integer, np.floating)) or isinstance(weight, bool) or not np.isfinite(weight):
            raise ValueError(f"the weight of {name} is {weight!r}, needs a finite number")
    return {name: float(weight) for name, weight in reward.items()}


def reward_of(reward: Reward, terms: Mapping[str, float]) -> float:
    """The reward of a decision with these terms. Raises ValueError where a user's function gives no finite number."""
    if callable(reward):
        value = float(reward(terms))
        if not np.isfinite(value):
            raise ValueError(f"the reward function gave {value}, needs a finite number")
        return value
    return float(sum(weight * terms[name] for name, weight in reward.items()))


def gospa(truth: Array, estimate: Array, cutoff: float = GOSPA_CUTOFF) -> float:
    """GOSPA in m between positions (m, 2) and (k, 2) m, p = 2, α = 2 (Rahmathullah, García-Fernández and Svensson 2017, proposition 1)."""
    m, k = len(truth), len(estimate)
    if not (m and k):
        return cutoff * float(np.sqrt((m + k) / 2))
    square = np.minimum(((truth[:, None] - estimate[None]) ** 2).sum(axis=2), cutoff**2)
    rows, columns = linear_sum_assignment(square)
    cost = square[rows, columns]
    near = cost < cutoff**2
    missed = m + k - 2 * int(near.sum())
    return float(np.sqrt(cost[near].sum() + cutoff**2 / 2 * missed))


def relative_gospa(truth: Array, estimate: Array) -> float:
    """GOSPA divided by that of an empty estimate. Without true people it is divided by that of one false person."""
    return gospa(truth, estimate) / (GOSPA_CUTOFF * float(np.sqrt(max(len(truth), 1) / 2)))


@njit(cache=True)
def _near_misses(team, people):  # type: ignore[no-untyped-def]
    """The number of people within NEAR_MISS_DISTANCE of a moving robot."""
    count = 0
    for p in range(len(people)):
        for r in range(len(team)):
            if abs(team[r, SPEED]) > 0.1 and (people[p, 0] - team[r, X]) ** 2 + (people[p, 1] - team[r, Y]) ** 2 < NEAR_MISS_DISTANCE**2:
                count += 1
                break
    return count
