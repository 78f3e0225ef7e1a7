"""Behaviour of pedestrians: arrival, pauses, change of goals, entering and leaving. Compiled, single-threaded, in a fixed order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim.crowd.social_force import GOAL, HEADWAY_SPEED, PAUSE, PRESENT, SPEED, STUCK, VISIT, VX, VY, YIELDS, Number, Numbers, X, Y
from tracker.geometry import Array
from tracker.geometry.compilation import njit

ARRIVED = 0.7
"""m: distance at which a goal counts as reached; 2.5 times as far for somebody who is blocked."""
PATIENCE = 6.0
"""s without progress after which a person takes the next goal. Time in a queue counts a quarter."""
GROUP_RANGE = 1.6
"""m: distance to the leader of a group within which the others pause with the leader."""


class BehaviorState(NamedTuple):
    """The arrays of goals.GoalPlans, as compiled functions need them."""

    itinerary: Numbers
    group: Numbers
    exit: Numbers
    speed: Array
    pauses: Array
    entry: Array
    leave: Array


class StepInput(NamedTuple):
    """Time and length of a step, s; how many people have entered so far, and how many may be present at once (0: all)."""

    time: float
    dt: float
    entered: int
    at_once: int


@njit(cache=True)
def update_behavior(body: Array, inputs: tuple[Array, Array, Array], goals: Array, plans: BehaviorState, step_input: StepInput) -> int:
    """Update goals, pauses and presence of bodies (m, 10) after a step, in place. Returns how many people have entered by then.

    inputs: desired motion (m, 6), interactions (m, 5) and obstacles (k, 7), as in social_force. goals: (g, 2) m.
    """
    present = np.flatnonzero(body[:, PRESENT] > 0)
    for i in present:
        _update_goal(body, i, (inputs[0][i], inputs[1][i]), goals, plans)
    _exit_people(body, present, goals, plans, step_input.time)
    return _enter_people(body, inputs[2], plans, step_input)


@njit(cache=True)
def _update_goal(out: Array, i: Number, inputs: tuple[Array, Array], goals: Array, plans: BehaviorState) -> None:
    """Arrival, impatience and next goal of body i. Members of a group copy the first of them who is present."""
    desired, effect = inputs
    if math.hypot(out[i, VX], out[i, VY]) >= 0.25 * desired[SPEED] + 0.05:
        out[i, STUCK] = 0.0
    elif effect[YIELDS] > 0 or effect[HEADWAY_SPEED] < 0.5 * desired[SPEED]:
        out[i, STUCK] -= 0.75 * min(out[i, STUCK], 0.05)
    goal = int(out[i, GOAL])
    if plans.leave[i] < np.inf and goal == plans.exit[i]:
        return
    k = plans.itinerary.shape[1]
    distance = math.hypot(goals[goal, 0] - out[i, X], goals[goal, 1] - out[i, Y])
    there = distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 0.5)
    leader = plans.group[i]
    while leader < i and out[leader, PRESENT] <= 0:
        leader += 1
    if leader < i:
        near = math.hypot(out[leader, X] - out[i, X], out[leader, Y] - out[i, Y]) < GROUP_RANGE
        out[i, PAUSE] = out[leader, PAUSE] if near or there else 0.0
        out[i, VISIT] = out[leader, VISIT]
    elif there and out[i, PAUSE] <= 0 and desired[SPEED] > 0:
        out[i, PAUSE] = max(plans.pauses[i, int(out[i, VISIT]) % k], 1e-6)
    elif out[i, STUCK] > PATIENCE:
        out[i, STUCK] = 0.0
        out[i, VISIT] += 1
    out[i, GOAL] = plans.itinerary[i, int(out[i, VISIT]) % k]


@njit(cache=True)
def _exit_people(out: Array, present: Numbers, goals: Array, plans: BehaviorState, time: float) -> None:
    """Send people whose time is over to their exits, and remove those who have reached them."""
    for i in present:
        if plans.leave[i] == np.inf:
            continue
        exit_ = plans.exit[i]
        distance = math.hypot(goals[exit_, 0] - out[i, X], goals[exit_, 1] - out[i, Y])
        if int(out[i, GOAL]) != exit_:
            if time + 1.3 * distance / plans.speed[i] >= plans.leave[i]:
                out[i, GOAL], out[i, PAUSE] = exit_, 0.0
        elif distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 1.0):
            out[i, PRESENT] = out[i, VX] = out[i, VY] = 0.0


@njit(cache=True)
def _enter_people(out: Array, obstacle: Array, plans: BehaviorState, step_input: StepInput) -> int:
    """Let the next person enter if an entry is free: the own one, or that of one of the next seven. Returns how many have entered."""
    entered, at_once, m = step_input.entered, step_input.at_once, len(out)
    if at_once == 0 or entered >= m or (out[:, PRESENT] > 0).sum() >= at_once:
        return entered
    for a in range(8):
        x, y = plans.entry[(entered + a) % m]
        free = True
        for i in range(m):
            free = free and (out[i, PRESENT] <= 0 or math.hypot(out[i, X] - x, out[i, Y] - y) > 0.7)
        for o in range(len(obstacle)):
            free = free and math.hypot(obstacle[o, 0] - x, obstacle[o, 1] - y) > obstacle[o, 4] + 0.6
        if free:
            out[entered, X], out[entered, Y], out[entered, PRESENT] = x, y, 1.0
            return entered + 1
    return entered
