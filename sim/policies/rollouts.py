"""Policies tried on episodes of many seeds, side by side: what each is worth, with how sure that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from sim.confidence_intervals import Interval, bounds_of, mean_interval
from sim.placement.episode import Episode
from sim.placement.rewards import TERMS
from sim.policies.baselines import Lloyd, Random, Static
from sim.policies.greedy import Greedy
from sim.policies.policy import Briefing, Policy

PLAIN: dict[str, Callable[[], Policy]] = {"random": Random, "static": Static, "lloyd": Lloyd, "greedy": Greedy}
"""Policies that need no file."""
MEASURES = ("reward", *TERMS)


@dataclass(frozen=True)
class Outcome:
    """One episode: its policy, seed, and the mean of each of MEASURES over its decisions, and more where the tracker was in the loop."""

    policy: str
    seed: int
    values: dict[str, float]


def policy_of(name: str) -> Policy:
    """The policy of that name, or ppo:FILE. Raises ValueError for another name, and where a file or stable-baselines3 is missing."""
    if name in PLAIN:
        return PLAIN[name]()
    kind, _, file = name.partition(":")
    if kind == "ppo" and file:
        from sim.policies.ppo import Learned

        return Learned.read(file)
    raise ValueError(f"policy is {name!r}, needs one of {', '.join(PLAIN)} or ppo:FILE")


def try_out(name: str, seeds: Sequence[int], options: dict[str, Any], steps: int) -> list[Outcome]:
    """Episodes of these seeds under a policy of that name; options: of sim.placement.env.Placement, but `action`, which the policy decides."""
    policy = policy_of(name)
    env = gymnasium.make("pilsim/Placement-v0", **options, action=policy.action, max_episode_steps=steps)
    try:
        return [Outcome(name, seed, _episode(env, policy, seed)) for seed in seeds]
    finally:
        env.close()


def _episode(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> dict[str, float]:
    shown, _ = env.reset(seed=seed)
    episode: Episode = env.unwrapped.episode  # type: ignore[attr-defined]
    policy.begin(Briefing.of(episode, shown), np.random.default_rng([seed, 1]))
    sums = dict.fromkeys(MEASURES, 0.0)
    over, count = False, 0
    while not over:
        shown, reward, terminated, truncated, info = env.step(policy.act(Briefing.of(episode, shown)))
        over, count = terminated or truncated, count + 1
        for name in TERMS:
            sums[name] += info[name]
        sums["reward"] += float(reward)
    means = {name: value / count for name, value in sums.items()}
    return means if episode.tracking is None else means | episode.tracking.scores()


def table(outcomes: Sequence[Outcome], measures: Sequence[str] = ()) -> dict[str, dict[str, Interval]]:
    """policy → measure → its mean over seeds with its 95 % interval."""
    out: dict[str, dict[str, Interval]] = {}
    for name in dict.fromkeys(outcome.policy for outcome in outcomes):
        rows = [outcome.values for outcome in outcomes if outcome.policy == name]
        out[name] = {measure: mean_interval([row[measure] for row in rows], bounds=bounds_of(measure)) for measure in (measures or rows[0])}
    return out
