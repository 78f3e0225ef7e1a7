"""What walkers decide as they go: arrivals, pauses, changes of mind, coming and leaving. Compiled, one thread, in a fixed order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sim.crowd.social_force import FREE, GOAL, PAUSE, PRESENT, SPEED, STUCK, VISIT, VX, VY, YIELD, Number, Numbers, X, Y
from tracker.geometry import Array

ARRIVED = 0.7
"""m from a goal at which it counts as reached; where others stand in the way, twice and a half of it does."""
PATIENCE = 6.0
"""s after which somebody who cannot get on wants to go elsewhere; time in a queue counts a quarter."""
WITH_THE_LEADER = 1.6
"""m from the first of a group within which the others stop where that one does."""


class BehaviorState(NamedTuple):
    """The arrays of itinerary.Plans."""

    itinerary: Numbers
    group: Numbers
    exit: Numbers
    speed: Array
    pauses: Array
    entry: Array
    leave: Array


class Now(NamedTuple):
    """time and length of a step, s; how many people have entered so far, and how many may be present at once, all where 0."""

    time: float
    dt: float
    entered: int
    at_once: int


@njit(cache=True)
def decide(body: Array, mind: tuple[Array, Array, Array], goals: Array, wants: BehaviorState, now: Now) -> int:
    """Change what bodies (m, 10) want, after a step; how many have entered by then.

    mind: wishes (m, 6), what others did (m, 5), obstacles (k, 7), as in social_force; goals (g, 2) m.
    """
    here = np.flatnonzero(body[:, PRESENT] > 0)
    for i in here:
        _decide(body, i, (mind[0][i], mind[1][i]), goals, wants)
    _come_and_go(body, here, goals, wants, now.time)
    return _admit(body, mind[2], wants, now)


@njit(cache=True)
def _decide(out: Array, i: Number, mind: tuple[Array, Array], goals: Array, wants: BehaviorState) -> None:
    """Arrivals, changes of mind and the next goal of body i; who follows does as the first of the group that is there."""
    wish, met = mind
    if math.hypot(out[i, VX], out[i, VY]) >= 0.25 * wish[SPEED] + 0.05:
        out[i, STUCK] = 0.0
    elif met[YIELD] > 0 or met[FREE] < 0.5 * wish[SPEED]:
        out[i, STUCK] -= 0.75 * min(out[i, STUCK], 0.05)
    goal = int(out[i, GOAL])
    if wants.leave[i] < np.inf and goal == wants.exit[i]:
        return
    k = wants.itinerary.shape[1]
    distance = math.hypot(goals[goal, 0] - out[i, X], goals[goal, 1] - out[i, Y])
    there = distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 0.5)
    lead = wants.group[i]
    while lead < i and out[lead, PRESENT] <= 0:
        lead += 1
    if lead < i:
        near = math.hypot(out[lead, X] - out[i, X], out[lead, Y] - out[i, Y]) < WITH_THE_LEADER
        out[i, PAUSE] = out[lead, PAUSE] if near or there else 0.0
        out[i, VISIT] = out[lead, VISIT]
    elif there and out[i, PAUSE] <= 0 and wish[SPEED] > 0:
        out[i, PAUSE] = max(wants.pauses[i, int(out[i, VISIT]) % k], 1e-6)
    elif out[i, STUCK] > PATIENCE:
        out[i, STUCK] = 0.0
        out[i, VISIT] += 1
    out[i, GOAL] = wants.itinerary[i, int(out[i, VISIT]) % k]


@njit(cache=True)
def _come_and_go(out: Array, here: Numbers, goals: Array, wants: BehaviorState, time: float) -> None:
    """Who has to be gone by now walks to the exit, and is absent once there."""
    for i in here:
        if wants.leave[i] == np.inf:
            continue
        exit_ = wants.exit[i]
        distance = math.hypot(goals[exit_, 0] - out[i, X], goals[exit_, 1] - out[i, Y])
        if int(out[i, GOAL]) != exit_:
            if time + 1.3 * distance / wants.speed[i] >= wants.leave[i]:
                out[i, GOAL], out[i, PAUSE] = exit_, 0.0
        elif distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 1.0):
            out[i, PRESENT] = out[i, VX] = out[i, VY] = 0.0


@njit(cache=True)
def _admit(out: Array, obstacle: Array, wants: BehaviorState, now: Now) -> int:
    """How many have entered: one more where there is a place to; whose own entry is taken comes by that of one of the next."""
    entered, at_once, m = now.entered, now.at_once, len(out)
    if at_once == 0 or entered >= m or (out[:, PRESENT] > 0).sum() >= at_once:
        return entered
    for a in range(8):
        x, y = wants.entry[(entered + a) % m]
        free = True
        for i in range(m):
            free = free and (out[i, PRESENT] <= 0 or math.hypot(out[i, X] - x, out[i, Y] - y) > 0.7)
        for o in range(len(obstacle)):
            free = free and math.hypot(obstacle[o, 0] - x, obstacle[o, 1] - y) > obstacle[o, 4] + 0.6
        if free:
            out[entered, X], out[entered, Y], out[entered, PRESENT] = x, y, 1.0
            return entered + 1
    return entered
