"""What people want: goals, pauses, company, and when and where they come and go."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from worlds.terrain.free_space import FreeSpace

PREFERRED_SPEED, SPEED_SPREAD = 1.2, 0.2
"""m/s: mean and sigma of the speed that people walk at on level ground (1.3 in the open, less indoors)."""
GROUP_CHANCE = 0.19
"""The chance that somebody walks with the person before, in groups of at most LARGEST_GROUP: a third of all people then are in company."""
LARGEST_GROUP = 3
_GOALS = 32


@dataclass(frozen=True, eq=False)
class GoalPlans:
    """What m people want: speed (m,) m/s on the level, goals (g, 2) m, itinerary (m, k) of goals, gone through again and again, and pauses
    (m, k) s at each of them; group (m,), the first person of one's group, who leads it, no greater than one's own number.

    Who comes and goes: entry (m, 2) m, exit (m,) the goal through which one leaves, leave (m,) s, when one is to be gone, inf for never;
    at_once, how many are present at once, all where 0.
    """

    speed: Array
    goals: Array
    itinerary: NDArray[np.int64]
    pauses: Array
    group: NDArray[np.int64]
    entry: Array
    exit: NDArray[np.int64]
    leave: Array
    at_once: int = 0

    @staticmethod
    def of(speed: Array, goals: Array, itinerary: NDArray[np.int64], pauses: Array) -> GoalPlans:
        """Plans of people who walk alone and stay."""
        m = len(speed)
        nowhere = np.zeros((m, 2)), np.zeros(m, dtype=np.int64), np.full(m, np.inf)
        return GoalPlans(speed, goals, itinerary, pauses, np.arange(m), *nowhere)


@dataclass(frozen=True, eq=False)
class Schedule:
    """That at most at_once people are present at once, for duration s in all, who come and go through areas (k, 2, 2)
    [[xmin, ymin], [xmax, ymax]] m; all of them stay throughout where at_once is 0."""

    areas: Array
    at_once: int
    duration: float


def make_plans(free_space: FreeSpace, rngs: list[np.random.Generator], goal_rng: np.random.Generator, schedule: Schedule | None = None) -> GoalPlans:
    """Plans for as many people as there are streams: each draws speed, goals and pauses from the own one, the goals are shared.

    Raises ValueError where free space is too small for goals.
    """
    count = int(np.clip(free_space.area / 8.0, 4, 12))
    goals = free_space.sample(goal_rng, count, 0.15, 0.5 * math.sqrt(free_space.area / count))
    m = len(rngs)
    itinerary, pauses, speed = np.zeros((m, _GOALS), dtype=np.int64), np.zeros((m, _GOALS)), np.zeros(m)
    group = np.arange(m)
    for i, rng in enumerate(rngs):
        speed[i] = np.clip(rng.normal(PREFERRED_SPEED, SPEED_SPREAD), 0.7, 1.8)
        steps = np.cumsum(rng.integers(1, count, _GOALS))
        itinerary[i] = (rng.integers(count) + steps) % count
        # Half of the goals are only passed; at the others people stay for some seconds.
        pauses[i] = np.where(rng.random(_GOALS) < 0.5, 0.1, rng.uniform(1.5, 6.0, _GOALS))
        if rng.random() < GROUP_CHANCE and i and i - group[i - 1] < LARGEST_GROUP:
            group[i] = group[i - 1]
            speed[i] = speed[group[i]]
    plans = GoalPlans.of(speed, goals, itinerary[group], pauses[group])
    entry, exits, leave, at_once = plans.entry, plans.exit, plans.leave, 0
    if schedule is not None and 0 < schedule.at_once < m:
        at_once = schedule.at_once
        areas = np.array([rng.integers(len(schedule.areas), size=2) for rng in rngs])[group]
        entry = np.array([rng.uniform(*schedule.areas[a]) for rng, a in zip(rngs, areas[:, 0], strict=True)])
        exits = count + areas[:, 1]
        # One leaves and one comes at even times, the last of all just before the end: everybody has come by then, and nearly as many stay.
        leave = ((np.arange(m) + 1) * schedule.duration / (m - at_once + 1))[group]
        goals = np.concatenate([goals, schedule.areas.mean(axis=1)])
    return GoalPlans(speed, goals, plans.itinerary, plans.pauses, group, entry, exits, leave, at_once)


def order_by_group(places: Array, group: NDArray[np.int64]) -> Array:
    """places (m, 2) m in an order in which the people of a group (m,) get places near their first one."""
    left = list(range(len(places)))
    chosen: list[int] = []
    for i, leader in enumerate(group.tolist()):
        near = 0 if leader == i else int(np.argmin(((places[left] - places[chosen[leader]]) ** 2).sum(axis=1)))
        chosen.append(left.pop(near))
    return places[chosen]
