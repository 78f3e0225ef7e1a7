"""The reward of a decision: named terms and their weighted sum."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array

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
