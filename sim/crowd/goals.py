"""Plans of pedestrians: goals, pauses, groups, and times and areas of entry and exit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from worlds.terrain.free_space import FreeSpace

PREFERRED_SPEED, SPEED_SPREAD = 1.2, 0.2
"""m/s: mean and standard deviation of the walking speed on level ground (1.3 in the open, less indoors)."""
GROUP_CHANCE = 0.19
"""Probability that a person joins the group of the previous one. A third of all people then are in groups."""
LARGEST_GROUP = 3
_GOALS = 32


@dataclass(frozen=True, eq=False)
class GoalPlans:
    """Plans of m people.

    speed: (m,) m/s on level ground. goals: (g, 2) m. itinerary: (m, k) indices of goals, repeated cyclically. pauses: (m, k) s at these goals.
    group: (m,) index of the first person of the group, who leads it; at most the person's own index.
    entry: (m, 2) m. exit: (m,) index of the goal through which one leaves. leave: (m,) s, time of leaving, inf for never.
    at_once: how many people are present at once; 0 for all.
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
        """Plans of people without groups who stay throughout."""
        m = len(speed)
        nowhere = np.zeros((m, 2)), np.zeros(m, dtype=np.int64), np.full(m, np.inf)
        return GoalPlans(speed, goals, itinerary, pauses, np.arange(m), *nowhere)


@dataclass(frozen=True, eq=False)
class Schedule:
    """Entering and leaving of people: at most `at_once` are present at once; 0 means that all stay throughout.

    areas: (k, 2, 2) [[xmin, ymin], [xmax, ymax]] m, of entry and exit. duration: s of the whole run.
    """

    areas: Array
    at_once: int
    duration: float


def make_plans(free_space: FreeSpace, rngs: list[np.random.Generator], goal_rng: np.random.Generator, schedule: Schedule | None = None) -> GoalPlans:
    """Plans for one person per stream of `rngs`, which draws speed, itinerary and pauses. `goal_rng` draws the shared goals.

    Raises ValueError if free space is too small for the goals.
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
        # People only pass half of the goals, and pause for some seconds at the others.
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
        # People leave at even intervals, and each is replaced. Everybody has entered before the end, and the number present hardly changes.
        leave = ((np.arange(m) + 1) * schedule.duration / (m - at_once + 1))[group]
        goals = np.concatenate([goals, schedule.areas.mean(axis=1)])
    return GoalPlans(speed, goals, plans.itinerary, plans.pauses, group, entry, exits, leave, at_once)


def order_by_group(places: Array, group: NDArray[np.int64]) -> Array:
    """places (m, 2) m, reordered so that the members of a group (m,) get places near their leader."""
    left = list(range(len(places)))
    chosen: list[int] = []
    for i, leader in enumerate(group.tolist()):
        near = 0 if leader == i else int(np.argmin(((places[left] - places[chosen[leader]]) ** 2).sum(axis=1)))
        chosen.append(left.pop(near))
    return places[chosen]
