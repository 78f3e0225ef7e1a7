"""An episode of placing robots: the state between decisions, and the reward of each decision, a weighted sum of named terms.

It is independent of gymnasium. env.py, vector_env.py and parallel_env.py wrap it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.placement import kinematics
from sim.placement.beliefs import Beliefs, predict, update
from sim.placement.config import FRAMES_PER_DECISION, SEEDS_PER_MAP, PlacementConfig
from sim.placement.information import Views, add_information, detector_of, move_robots, started_robots, unknown_people
from sim.placement.kinematics import camera_kernel
from sim.placement.map import MapKey, PlacementMap, bilinear_at, map_of
from sim.placement.movers import KinematicMover, Mover, Order, PhysicsMover
from sim.placement.tracker_in_loop import TrackerInLoop
from sim.placement.visibility import share_kernel
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import model_of
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds.terrain.heightfield import Mask

TRAIL_LENGTH = 60
"""Number of decisions that a trail covers."""
GOSPA_CUTOFF = 2.0
"""Cut-off distance c of GOSPA, m."""
NO_GOALS: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
TERMS: dict[str, str] = {
    "information": "expected information about the place of a person, nats: ½ log det of an unknown place over the bound, the mean over people",
    "seen": "share of people whom at least one robot sees, in [0, 1]",
    "seen_twice": "share of people whom at least two robots see, in [0, 1]",
    "collisions": "robots stopped by a person, by another robot or by the ground in this decision",
    "near_misses": "people within 0.98 m of a moving robot",
    "tip_overs": "robots that tipped over in this decision",
    "energy": "energy spent by all robots, kJ",
}
"""Every term of the reward and its meaning."""
WEIGHTS: dict[str, float] = {"information": 0.2, "collisions": -0.05, "near_misses": -0.05, "tip_overs": -5.0, "energy": -0.02}
"""Default weights. A person who is seen well has about 5 nats."""
GOSPA = "gospa"
"""A term that rewards may have too, and that is computed for them alone: GOSPA of tracks or beliefs over that of an empty estimate."""

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

    bounds (p, 4, 4), robot_bounds (r, 3, 3): expected covariances of people and of poses, as in information.py.
    time_unseen (p,): time since each person was last seen, s. goals (r,): goal nodes of the roadmap, for waypoint actions.
    trail: robot positions (r, 2) m after each of the last decisions. added (r,): what each robot adds to the information about a person, nats.
    decided: s that a policy took for the last decision, where somebody measures it.
    """

    config: PlacementConfig
    place: PlacementMap
    mover: Mover
    rng: np.random.Generator
    now: Decision
    beliefs: Beliefs
    bounds: Array
    robot_bounds: Array
    time_unseen: Array
    tracking: TrackerInLoop | None = None
    goals: NDArray[np.int64] | None = None
    trail: list[Array] = field(default_factory=list)
    added: Array = field(default_factory=lambda: np.zeros(0))
    terms: dict[str, float] = field(default_factory=dict)
    decided: float = 0.0

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
        nothing, r, p = np.zeros(config.robots), config.robots, config.people
        people = place.people_at(mover.crowd)
        now = Decision(mover.team, people, np.zeros((r, 3)), np.zeros((r, p)), nothing, np.zeros(r, dtype=bool))
        bounds = unknown_people(p), started_robots(r)
        episode = Episode(config, place, mover, rng, now, Beliefs.none(p), *bounds, np.zeros(p), tracking)
        if tracking is not None:
            tracking.update(mover, people)
        episode._sense(mover.team, nothing, 0.0)
        return episode

    def step(self, action: Array) -> dict[str, float]:
        """Advance by one decision with action (r, 2) in [−1, 1], and return its reward terms."""
        before, mover, near = self.now, self.mover, 0
        order = Order(action * np.array([TOP_SPEED, TOP_YAW_RATE]), NO_GOALS)
        if self.config.action == "waypoint":
            self.goals = self.place.roadmap.nearest(self.place.metres(action))
            order = Order(np.zeros_like(action), self.goals)
        stopped = np.zeros(len(before.team))
        # The tracker in the loop takes every frame. Without it, all frames of a decision are one compiled call.
        for _ in range(1 if self.tracking is None else FRAMES_PER_DECISION):
            blocked, close = mover.advance(order, FRAMES_PER_DECISION if self.tracking is None else 1)
            stopped, near = np.maximum(stopped, blocked), max(near, close)
            if self.tracking is not None:
                self.tracking.update(mover, self.place.people_at(mover.crowd))
        self.trail = [*self.trail[1 - TRAIL_LENGTH :], mover.team[:, :2]]
        information = self._sense(before.team, stopped, self.config.period)
        now, people = self.now, max(self.config.people, 1)
        views = (now.seen > 0).sum(axis=0)
        self.terms = {
            "information": information,
            "seen": float((views >= 1).sum() / people),
            "seen_twice": float((views >= 2).sum() / people),
            "collisions": float((stopped > 0).sum()),
            "near_misses": float(near),
            "tip_overs": float((now.tipped & ~before.tipped).sum()),
            "energy": float(kinematics.energy(before.team, now.team, now.cameras[:, 2] - before.cameras[:, 2])),
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

    def relative_gospa(self) -> float:
        """GOSPA (c = 2 m, p = 2) of `estimates` over that of an empty estimate: 0 is perfect, 1 is no better than the empty estimate."""
        return relative_gospa(self.now.people[:, :2], self.estimates()[0])

    def _sense(self, before: Array, stopped: Array, dt: float) -> float:
        """Update the situation, beliefs and bounds with what the cameras see. Returns the information about a person, nats."""
        config, mover, b = self.config, self.mover, self.beliefs
        shape = config.robots, config.people
        drawn = self.rng.normal(size=(*shape, 2)), self.rng.random(shape)
        limits = config.visibility_limits
        settings = detector_row(config), (limits.reach, limits.size, 0.0), limits.share, config.camera_height
        tipped, body = mover.tipped(), mover.body
        found = _sense(
            self.place.scene,
            (before, mover.team, tipped),
            (body, self.place.stature),
            settings,
            (dt, float(FRAMES_PER_DECISION)),
            drawn,
            (b.known, b.mean, b.covariance, self.bounds, self.robot_bounds),
        )
        people, cameras, seen, known, mean, covariance, information, self.added = found
        self.now = Decision(mover.team, people, cameras, seen, stopped, tipped)
        self.beliefs = Beliefs(known, mean, covariance)
        self.time_unseen = (self.time_unseen + dt) * ~seen.any(axis=0)
        return float(information)

    @staticmethod
    def key(config: PlacementConfig, seed: int) -> MapKey:
        """The key of the map of an episode of this seed."""
        return MapKey(config.world, config.difficulty, seed // SEEDS_PER_MAP if config.map_seed is None else config.map_seed, config.people)


@lru_cache(maxsize=64)
def detector_row(config: PlacementConfig) -> Array:
    """The detector of a configuration, in the columns of information.py, cached."""
    model = model_of(config.detector_model, IndependentErrors(config.misses, config.clutter, min_visible=config.visibility_limits.share))
    return detector_of(model, config.frame_period)


@njit(cache=True, nogil=True)
def _sense(scene, motion, crowd, settings, step, drawn, state):  # type: ignore[no-untyped-def]
    """What a team sees after a decision: people (p, 4), cameras (r, 3), seen (r, p), beliefs, and what add_information gives.

    motion: team before and after (r, 7), tipped (r,). crowd: bodies (p, 10), stature (p,). settings: detector, limits of views, least share that
    counts as seen, camera height. step: time s, frames. drawn: noise (r, p, 2), luck (r, p). state: beliefs, and bounds, which change in place.
    """
    before, team, tipped = motion
    body, stature = crowd
    detector, limits, least, mast = settings
    known, mean, covariance, bounds, robots = state
    people, cameras = np.empty((len(body), 4)), camera_kernel(team, scene.floor, scene.origin, scene.spacing, mast)
    for p in range(len(body)):
        people[p, 0], people[p, 1], people[p, 3] = body[p, 0], body[p, 1], stature[p]
        people[p, 2] = bilinear_at(scene.floor, scene.origin, scene.spacing, body[p, 0], body[p, 1])
    share = share_kernel(scene.top, scene.frame, cameras, people, limits)
    above = cameras.copy()
    for r in range(len(team)):
        if tipped[r]:
            share[r] = 0.0
        above[r, 2] = max(cameras[r, 2] - bilinear_at(scene.floor, scene.origin, scene.spacing, team[r, 0], team[r, 1]), 0.2)
    if step[0] > 0:
        move_robots(robots, before, team, scene.landmarks, step[0])
    views = Views(detector, robots, share, above, people)
    if step[0] > 0:
        known, mean, covariance = predict(known, mean, covariance, step[0])
    known, mean, covariance = update(known, mean, covariance, views, drawn)
    information, added = add_information(bounds, views, step)
    seen = np.where(share >= least, share, 0.0)
    return people, cameras, seen, known, mean, covariance, information, added


def checked_reward(reward: Reward | None) -> Reward:
    """The reward, or the default weights for None. Raises ValueError for an unknown term and for a weight that is not finite."""
    if reward is None:
        return dict(WEIGHTS)
    if callable(reward):
        return reward
    if not isinstance(reward, Mapping):
        raise ValueError(f"reward is {reward!r}, needs weights by term or a function of the terms")
    for name, weight in reward.items():
        if name not in TERMS and name != GOSPA:
            raise ValueError(f"reward has the term {name!r}, needs some of {', '.join((*TERMS, GOSPA))}")
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
