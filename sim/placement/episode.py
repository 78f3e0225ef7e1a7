"""An episode of placing robots: the state between decisions, and the reward of each decision, a weighted sum of named terms.

It is independent of gymnasium. env.py, vector_env.py and parallel_env.py wrap it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.placement.config import FRAMES_PER_DECISION, SEEDS_PER_MAP, PlacementConfig
from sim.placement.information import (
    COLLISIONS,
    ENERGY,
    INFORMATION,
    SEEN,
    SEEN_TWICE,
    TERMS,
    TIP_OVERS,
    TRAIL_LENGTH,
    Beliefs,
    States,
    Views,
    add_information,
    detector_of,
    move_robots,
    predict,
    update,
)
from sim.placement.map import MapKey, PlacementMap, bilinear_at, map_of
from sim.placement.movers import KinematicMover, Mover, Order, PhysicsMover, advance_rows, camera_kernel, energy, ways_of
from sim.placement.tracker_in_loop import TrackerInLoop
from sim.placement.visibility import share_kernel
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import model_of
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds.terrain.heightfield import Mask

GOSPA_CUTOFF = 2.0
"""Cut-off distance c of GOSPA, m."""
WEIGHTS: dict[str, float] = {"information": 0.2, "collisions": -0.05, "near_misses": -0.05, "tip_overs": -5.0, "energy": -0.02}
"""Default weights. A person who is seen well has about 5 nats."""
GOSPA = "gospa"
"""A further term, computed only for rewards that use it: GOSPA of tracks or beliefs over that of an empty estimate."""

Reward = Mapping[str, float] | Callable[[Mapping[str, float]], float]
"""Weights by term (0 for a missing term), or a function of all terms."""


@dataclass(frozen=True, eq=False)
class Decision:
    """The situation after a decision.

    team (r, 7): rover states, in the columns of config.py. people (p, 4): feet x, y, z m and stature m. cameras (r, 3): positions, m.
    seen (r, p): shares of bodies seen. stopped (r,): what stopped a robot in the last decision, as in movers.drive_step.
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
    """An episode, whose state between decisions is row `row` of `states`. `begin` makes an episode and `step` advances it.

    goals (r,): goal nodes of the roadmap, for waypoint actions. terms: of the last decision.
    decided: processor time of the policy for the last decision, s, where it is measured.
    """

    config: PlacementConfig
    place: PlacementMap
    mover: Mover
    rng: np.random.Generator
    states: States
    row: int = 0
    tracking: TrackerInLoop | None = None
    goals: NDArray[np.int64] | None = None
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
        episode = Episode(config, place, mover, rng, mover.states, tracking=tracking)
        episode.states.before[0] = mover.team
        if tracking is not None:
            tracking.update(mover, place.people_at(mover.crowd))
        _sense([episode], 0.0)
        return episode

    def move_to(self, states: States, row: int) -> None:
        """Move the state into row `row` of `states`, where it stays from now on."""
        states.copy_row(row, self.states, self.row)
        self.states, self.row = self.mover.states, self.mover.row = states, row

    def step(self, action: Array) -> dict[str, float]:
        """Advance by one decision with action (r, 2) in [−1, 1], and return its reward terms."""
        decide([self], action[None])
        self.terms = dict(zip(TERMS, self.states.terms[self.row].tolist(), strict=True))
        return self.terms

    @property
    def now(self) -> Decision:
        """The situation after the last decision. The arrays change with the next one."""
        s, n = self.states, self.row
        return Decision(s.team[n], s.people[n], s.cameras[n], s.seen[n], s.stopped[n], s.tipped[n])

    @property
    def beliefs(self) -> Beliefs:
        """The team's beliefs about people whose identities are known. The arrays change with the next decision."""
        return Beliefs(self.states.known[self.row], self.states.mean[self.row], self.states.covariance[self.row])

    @property
    def trail(self) -> list[Array]:
        """Robot positions (r, 2) m after each of the last decisions."""
        count = int(self.states.decisions[self.row])
        return [self.states.trail[self.row, k % TRAIL_LENGTH] for k in range(max(count - TRAIL_LENGTH, 0), count)]

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
        truth = self.now.people[:, :2]
        # Without true people, the divisor is the GOSPA of one false estimate.
        return gospa(truth, self.estimates()[0]) / (GOSPA_CUTOFF * float(np.sqrt(max(len(truth), 1) / 2)))

    @staticmethod
    def key(config: PlacementConfig, seed: int) -> MapKey:
        """The key of the map of an episode of this seed."""
        return MapKey(config.world, config.difficulty, seed // SEEDS_PER_MAP if config.map_seed is None else config.map_seed, config.people)


def decide(episodes: Sequence[Episode], actions: Array) -> None:
    """Advance episodes of one map and configuration that share their States by one decision with actions (n, r, 2) in [−1, 1].

    The terms are written to states.terms. One kernel call moves the robots of kinematic episodes without a tracker.
    """
    first, rows = episodes[0], _rows(episodes)
    states, order = first.states, Order(actions * np.array([TOP_SPEED, TOP_YAW_RATE]), np.zeros((len(rows), 0), dtype=np.int64))
    if first.config.action == "waypoint":
        goals = first.place.roadmap.nearest(first.place.metres(actions.reshape(-1, 2))).reshape(actions.shape[:2])
        order = Order(np.zeros_like(actions), goals)
        for episode, row in zip(episodes, goals, strict=True):
            episode.goals = row
    states.before[rows], states.stopped[rows], states.terms[rows] = states.team[rows], 0, 0.0
    if first.tracking is None and isinstance(first.mover, KinematicMover):
        advance_rows(rows, states, order, ways_of(first.place), (first.mover.dt, FRAMES_PER_DECISION))
    else:
        for k, episode in enumerate(episodes):
            for _ in range(FRAMES_PER_DECISION):
                episode.mover.advance(Order(order.velocity[k : k + 1], order.goals[k : k + 1]))
                if episode.tracking is not None:
                    episode.tracking.update(episode.mover, episode.place.people_at(episode.mover.crowd))
    _sense(episodes, first.config.period)


def _rows(episodes: Sequence[Episode]) -> NDArray[np.int64]:
    return np.array([episode.row for episode in episodes], dtype=np.int64)


def _sense(episodes: Sequence[Episode], dt: float) -> None:
    """Update situations, beliefs, bounds and terms with what the cameras see."""
    first = episodes[0]
    states, config, limits = first.states, first.config, first.config.visibility_limits
    for episode in episodes:
        episode.rng.standard_normal(out=states.noise[episode.row])
        episode.rng.random(out=states.luck[episode.row])
        states.tipping[episode.row] = episode.mover.tipped()
    settings = detector_row(config), (limits.reach, limits.size, 0.0), limits.share, config.camera_height
    _sense_rows(_rows(episodes), states, (first.place.scene, first.place.stature), settings, (dt, float(FRAMES_PER_DECISION)))


@lru_cache(maxsize=64)
def detector_row(config: PlacementConfig) -> Array:
    """The detector of a configuration, in the columns of information.py, cached."""
    model = model_of(config.detector_model, IndependentErrors(config.misses, config.clutter, min_visible=config.visibility_limits.share))
    return detector_of(model, config.frame_period)


@njit(cache=True, nogil=True)
def _sense_rows(rows, states, place, settings, step):  # type: ignore[no-untyped-def]
    """`_sense` as a kernel, for the episodes `rows` (n,) of one map, in place.

    place: scene, stature (p,). settings: detector, limits of views, least share that counts as seen, camera height. step: time s, frames.
    """
    for n in rows:
        climbed = -states.cameras[n, :, 2]
        share = _look(n, states, place, settings, step)
        climbed += states.cameras[n, :, 2]
        states.seen[n] = np.where(share >= settings[2], share, 0.0)
        once = twice = 0
        for p in range(share.shape[1]):
            views = (states.seen[n, :, p] > 0).sum()
            once, twice = once + (views >= 1), twice + (views >= 2)
            states.time_unseen[n, p] = 0.0 if views else states.time_unseen[n, p] + step[0]
        terms, people = states.terms[n], max(share.shape[1], 1)
        terms[SEEN], terms[SEEN_TWICE] = once / people, twice / people
        terms[COLLISIONS] = (states.stopped[n] > 0).sum()
        terms[TIP_OVERS] = (states.tipping[n] & ~states.tipped[n]).sum()
        terms[ENERGY] = energy(states.before[n], states.team[n], climbed)
        states.tipped[n] = states.tipping[n]
        if step[0] > 0:
            states.trail[n, states.decisions[n] % TRAIL_LENGTH] = states.team[n, :, :2]
            states.decisions[n] += 1


@njit(cache=True)
def _look(n, states, place, settings, step):  # type: ignore[no-untyped-def]
    """Update people, cameras, beliefs and bounds of episode n, and return the share (r, p) of bodies that cameras see."""
    (scene, stature), (detector, limits, _, mast) = place, settings
    team, people, robots = states.team[n], states.people[n], states.robot_bounds[n]
    cameras = camera_kernel(team, scene.floor, scene.origin, scene.spacing, mast)
    for p in range(len(people)):
        people[p, 0], people[p, 1], people[p, 3] = states.body[n, p, 0], states.body[n, p, 1], stature[p]
        people[p, 2] = bilinear_at(scene.floor, scene.origin, scene.spacing, people[p, 0], people[p, 1])
    share = share_kernel(scene.elevation, cameras, people, limits)
    above = cameras.copy()
    for r in range(len(team)):
        if states.tipping[n, r]:
            share[r] = 0.0
        above[r, 2] = max(cameras[r, 2] - bilinear_at(scene.floor, scene.origin, scene.spacing, team[r, 0], team[r, 1]), 0.2)
    known, mean, covariance = states.known[n], states.mean[n], states.covariance[n]
    if step[0] > 0:
        move_robots(robots, states.before[n], team, scene.landmarks, step[0])
        known, mean, covariance = predict(known, mean, covariance, step[0])
    views = Views(detector, robots, share, above, people)
    found = update(known, mean, covariance, views, (states.noise[n], states.luck[n]))
    states.known[n], states.mean[n], states.covariance[n], states.cameras[n] = found[0], found[1], found[2], cameras
    states.terms[n, INFORMATION], states.added[n] = add_information(states.bounds[n], states.without[n], views, step)
    return share


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
    return float(weighted(reward, terms))


def weighted(weights: Mapping[str, float], terms: Mapping[str, Any]) -> Any:
    """The weighted sum of terms: of numbers, or of arrays (n,) of many episodes."""
    return sum(weight * terms[name] for name, weight in weights.items())


def gospa(truth: Array, estimate: Array) -> float:
    """GOSPA in m between positions (m, 2) and (k, 2) m, p = 2, α = 2 (Rahmathullah, García-Fernández and Svensson 2017, proposition 1)."""
    m, k = len(truth), len(estimate)
    if not (m and k):
        return GOSPA_CUTOFF * float(np.sqrt((m + k) / 2))
    square = np.minimum(((truth[:, None] - estimate[None]) ** 2).sum(axis=2), GOSPA_CUTOFF**2)
    rows, columns = linear_sum_assignment(square)
    cost = square[rows, columns]
    near = cost < GOSPA_CUTOFF**2
    missed = m + k - 2 * int(near.sum())
    return float(np.sqrt(cost[near].sum() + GOSPA_CUTOFF**2 / 2 * missed))
