"""What a placement is worth: named terms, each a number a decision, and their weighted sum."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array

GOSPA_GATE = 2.0
"""m: c of GOSPA."""
TERMS: dict[str, str] = {
    "seen": "share of people whom at least one robot sees, in [0, 1]",
    "seen_twice": "share of people whom at least two robots see, in [0, 1]",
    "gospa": "GOSPA of tracks or beliefs (c = 2 m, p = 2), m, over that of an empty answer: 0 is perfect, 1 is as good as saying nothing",
    "information": "nats gained a person: half of what the log determinants of their places' covariances lost by what was seen",
    "collisions": "robots stopped by a person, by another robot or by the ground in this decision",
    "near_misses": "people within 0.98 m of a robot that moves",
    "tip_overs": "robots that have tipped over in this decision",
    "energy": "kJ spent by all robots",
}
"""Every term and what it is."""
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
"""The weights where none are given."""

Reward = Mapping[str, float] | Callable[[Mapping[str, float]], float]
"""Weights by term (a term that is left out counts nothing), or a function of all terms."""


def checked(reward: Reward | None) -> Reward:
    """The reward that is meant. Raises ValueError for a term that there is not, or for a weight that is no finite number."""
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


def worth(reward: Reward, terms: Mapping[str, float]) -> float:
    """The reward of a decision. Raises ValueError where a user's function gives no finite number."""
    if callable(reward):
        value = float(reward(terms))
        if not np.isfinite(value):
            raise ValueError(f"the reward function gave {value}, needs a finite number")
        return value
    return float(sum(weight * terms[name] for name, weight in reward.items()))


def gospa(truth: Array, estimate: Array, gate: float = GOSPA_GATE) -> float:
    """m: between places (m, 2) and (k, 2) m, p = 2, α = 2 (Rahmathullah, García-Fernández and Svensson 2017, proposition 1)."""
    m, k = len(truth), len(estimate)
    if not (m and k):
        return gate * float(np.sqrt((m + k) / 2))
    square = np.minimum(((truth[:, None] - estimate[None]) ** 2).sum(axis=2), gate**2)
    rows, columns = linear_sum_assignment(square)
    cost = square[rows, columns]
    near = cost < gate**2
    missed = m + k - 2 * int(near.sum())
    return float(np.sqrt(cost[near].sum() + gate**2 / 2 * missed))


def gospa_share(truth: Array, estimate: Array) -> float:
    """GOSPA over that of saying nothing; where nobody is there, over that of one false person."""
    return gospa(truth, estimate) / (GOSPA_GATE * float(np.sqrt(max(len(truth), 1) / 2)))
