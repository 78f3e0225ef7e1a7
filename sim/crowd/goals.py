"""Plans of pedestrians: goals, pauses, groups, times and areas of entry and exit, and who sits or stands in a talking group.

Sitting and talking are off by default. Postures are enforced after each step of the crowd.
A talking group walks to a goal, stands in a circle about its centre for a while, its members face each other, and walks on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.crowd.social_force import BODY_RADIUS, HEADING, PAUSE, PRESENT, STUCK, VX, X
from tracker.geometry import Array, Ints, wrap
from worlds.terrain.free_space import FreeSpace

SIZES = {2: 0.45, 3: 0.28, 4: 0.17, 5: 0.10}
"""Number of people in a talking group → its probability. Small groups are the most frequent (Moussaïd et al. 2010, PLoS ONE 5(4), fig. 1)."""
TALK = (15.0, 60.0)
"""s: shortest and longest time in which a group stands and talks."""
SPACING = 0.85
"""m between neighbours in the circle: the personal distance of Hall (1966), The Hidden Dimension, is 0.45 to 1.2 m."""
SHUFFLE_SPEED, TURN_RATE = 0.4, 2.5
"""m/s and rad/s: how fast people take their places in the circle, and turn there."""
SETTLED = 0.06
"""m: distance from the place in the circle within which people stay."""
ROBOT_RANGE = 2.0
"""m: people who talk make way as others do for a robot within this range."""
FOREVER = 1e9
"""s: the pause of a person who sits."""
PREFERRED_SPEED, SPEED_SPREAD = 1.2, 0.2
"""m/s: mean and standard deviation of the walking speed on level ground (1.3 in the open, less indoors)."""
GROUP_CHANCE = 0.19
"""Probability that a person joins the group of the previous one. A third of all people then are in groups."""
LARGEST_GROUP = 3
_GOALS = 32


@dataclass(frozen=True, eq=False)
class Postures:
    """sitters (k,): indices of people who sit. seat (k, 4): x, y and height m of their seats, and heading rad.

    talks (m,): number of the talking group of each person, −1 for none.
    """

    sitters: Ints
    seat: Array
    talks: Ints

    @staticmethod
    def none(m: int) -> Postures:
        """Nobody sits or talks."""
        return Postures(np.zeros(0, np.int64), np.zeros((0, 4)), np.full(m, -1))

    def placed(self, body: Array, plans: GoalPlans, free_space: FreeSpace, robots: Array) -> None:
        """Seat the sitters and put talking groups into circles that are free, at the start, in place. robots: (r, 2) m."""
        self._sit(body)
        for group in range(int(self.talks.max(initial=-1)) + 1):
            members = np.flatnonzero((self.talks == group) & (body[:, PRESENT] > 0))
            if len(members) < 2:
                continue
            others = np.flatnonzero((self.talks != group) & (body[:, PRESENT] > 0))
            circle = circle_at(body[members[0], X : X + 2], len(members), free_space, np.concatenate([body[others, X : X + 2], robots]))
            if circle is not None:
                body[members, X : X + 2] = circle
                away = circle.mean(axis=0) - circle
                body[members, HEADING] = np.arctan2(away[:, 1], away[:, 0])
                body[members, PAUSE] = plans.pauses[members[0], 0]

    def kept(self, before: Array, body: Array, free_space: FreeSpace, obstacles: Array, dt: float) -> None:
        """Correct a step of the crowd from `before` to `body` (m, 10), in place. obstacles (k, 7): as in social_force."""
        self._sit(body)
        for group in range(int(self.talks.max(initial=-1)) + 1):
            members = np.flatnonzero((self.talks == group) & (before[:, PAUSE] > 0) & (body[:, PRESENT] > 0) & (before[:, PRESENT] > 0))
            # The steering moves people who are still braking.
            members = members[np.hypot(*before[members, VX : VX + 2].T) < SHUFFLE_SPEED + 0.1]
            if len(members) > 1:
                _stand_in_circle(before, body, members, (free_space, obstacles), dt)

    def _sit(self, body: Array) -> None:
        body[self.sitters, X : X + 2] = self.seat[:, :2]
        body[self.sitters, VX : VX + 2] = body[self.sitters, STUCK : STUCK + 1] = 0.0
        body[self.sitters, HEADING], body[self.sitters, PAUSE] = self.seat[:, 3], FOREVER


def drawn_postures(plans: GoalPlans, seats: Array, shares: tuple[float, float], rng: np.random.Generator) -> tuple[GoalPlans, Postures]:
    """Plans and postures with a share of people who sit on seats (k, 4), and a share who talk in groups.

    Sitters are among the people who are present from the start, and stay. shares: of those present, sitting and in groups.
    Raises ValueError for more sitters than seats.
    """
    m = len(plans.speed)
    first = plans.at_once or m
    count = round(shares[0] * first)
    if count > len(seats):
        raise ValueError(f"{count} people shall sit, needs at most {len(seats)}, the number of seats")
    talks, sits = _laid_out(first, count, shares[1], rng)
    later, _ = _laid_out(m - first, 0, shares[1], rng)
    talks = np.concatenate([talks, np.where(later >= 0, later + talks.max(initial=-1) + 1, -1)])
    sitters = np.flatnonzero(sits)
    group, pauses, itinerary, speed = np.arange(m), plans.pauses.copy(), plans.itinerary.copy(), plans.speed.copy()
    single = (talks < 0) & ~np.isin(group, sitters)
    for i in range(1, m):
        walks_along = single[i] and single[i - 1] and plans.group[i] == plans.group[i - 1]
        if walks_along or (talks[i] >= 0 and talks[i] == talks[i - 1]):
            group[i] = group[i - 1]
    for i in np.flatnonzero(talks >= 0).tolist():
        leader = group[i]
        if i == leader:
            pauses[i] = rng.uniform(*TALK, pauses.shape[1])
        itinerary[i], pauses[i], speed[i] = itinerary[leader], pauses[leader], speed[leader]
    leave = plans.leave.copy()
    leave[sitters] = np.inf
    exits = plans.exit[group] if plans.at_once else plans.exit
    leave = np.where(talks >= 0, leave[group], leave)
    seat = seats[rng.permutation(len(seats))[: len(sitters)]].reshape(-1, 4)
    plans = replace(plans, group=group, pauses=pauses, itinerary=itinerary, speed=speed, leave=leave, exit=exits)
    return plans, Postures(sitters, seat, talks)


def circle_at(place: Array, count: int, free_space: FreeSpace, others: Array) -> Array | None:
    """Places (count, 2) m in a circle that begins at place (2,) m, clear of walls and of others (k, 2) m; None where none was found."""
    radius = _radius(count)
    for turn in np.linspace(-np.pi, np.pi, 16, endpoint=False):
        centre = place + radius * np.array([np.cos(turn), np.sin(turn)])
        angles = turn + np.pi + 2 * np.pi / count * np.arange(count)
        circle = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        clear = free_space.clearance_at(circle).min() > 0.1
        if clear and np.linalg.norm(circle[:, None] - others, axis=2).min(initial=np.inf) > 0.75:
            return circle
    return None


def _laid_out(m: int, sitting: int, share: float, rng: np.random.Generator) -> tuple[Ints, NDArray[np.bool_]]:
    """Talking groups (m,) of adjacent people, −1 for none, and who sits (m,), in random order."""
    left = min(round(share * m), m - sitting)
    sizes: list[int] = []
    while left > 1:
        size = min(int(rng.choice(list(SIZES), p=list(SIZES.values()))), left)
        sizes.append(size + 1 if left - size == 1 and size < max(SIZES) else size)
        left -= sizes[-1]
    alone = m - sum(sizes)
    talks, sits, groups = np.full(m, -1), np.zeros(m, dtype=np.bool_), 0
    blocks, i = rng.permutation(np.array([*sizes, *[1] * (alone - sitting), *[0] * sitting], dtype=np.int64)), 0
    for size in blocks.tolist():
        if size > 1:
            talks[i : i + size], groups = groups, groups + 1
        elif size == 0:
            sits[i] = True
        i += max(size, 1)
    return talks, sits


def _radius(count: int) -> float:
    return float(0.5 * SPACING / np.sin(np.pi / count))


def _stand_in_circle(before: Array, body: Array, members: Ints, place: tuple[FreeSpace, Array], dt: float) -> None:
    """Move members towards even places on their circle and turn them to its centre, unless a robot is near."""
    free_space, obstacles = place
    position = before[members, X : X + 2]
    centre, n = position.mean(axis=0), len(members)
    away = position - centre
    angle = np.arctan2(away[:, 1], away[:, 0])
    order = np.argsort(angle, kind="stable")
    even = 2 * np.pi / n * np.arange(n)
    start = np.angle(np.exp(1j * (angle[order] - even)).sum())
    target = np.empty_like(position)
    target[order] = centre + _radius(n) * np.stack([np.cos(start + even), np.sin(start + even)], axis=1)
    way = target - position
    length = np.hypot(way[:, 0], way[:, 1])
    step = way * (np.where(length > SETTLED, np.minimum(SHUFFLE_SPEED * dt, length), 0.0) / np.maximum(length, 1e-9))[:, None]
    new = position + step
    others = np.delete(body[:, X : X + 2], members, axis=0)[np.delete(body[:, PRESENT], members) > 0]
    near = np.linalg.norm(new[:, None] - others, axis=2).min(axis=1, initial=np.inf) < 2 * BODY_RADIUS
    stay = near | (free_space.clearance_at(new) < 0.05)
    new[stay] = position[stay]
    if np.linalg.norm(position[:, None] - obstacles[:, :2], axis=2).min(initial=np.inf) > ROBOT_RANGE:
        body[members, X : X + 2], body[members, VX : VX + 2] = new, (new - position) / dt
    turn = wrap(np.arctan2(-away[:, 1], -away[:, 0]) - before[members, HEADING])
    body[members, HEADING] = wrap(before[members, HEADING] + np.clip(turn, -TURN_RATE * dt, TURN_RATE * dt))


@dataclass(frozen=True, eq=False)
class GoalPlans:
    """Plans of m people.

    speed: (m,) m/s on level ground. goals: (g, 2) m. itinerary: (m, k) indices of goals, repeated cyclically. pauses: (m, k) s at these goals.
    group: (m,) index of the first person of the group, who leads it; at most the person's own index.
    entry: (m, 2) m. exit: (m,) index of the goal through which a person leaves. leave: (m,) s, time of leaving, inf for never.
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
