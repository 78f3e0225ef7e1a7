"""Episodes of policies over many seeds, and the means of their measures with confidence intervals."""

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
from sim.policies.policy import Policy, TeamKnowledge

BUILT_IN_POLICIES: dict[str, Callable[[], Policy]] = {"random": Random, "static": Static, "lloyd": Lloyd, "greedy": Greedy}
"""Policies that need no file, by name."""
MEASURES = ("reward", *TERMS)


@dataclass(frozen=True)
class EpisodeResult:
    """The result of an episode. values: means of MEASURES over its decisions, and the tracker's scores where it is in the loop."""

    policy: str
    seed: int
    values: dict[str, float]


def policy_of(name: str) -> Policy:
    """The policy of a name, or of ppo:FILE. Raises ValueError for an unknown name and for a missing file or stable-baselines3."""
    if name in BUILT_IN_POLICIES:
        return BUILT_IN_POLICIES[name]()
    kind, _, file = name.partition(":")
    if kind == "ppo" and file:
        from sim.policies.ppo import Learned

        return Learned.read(file)
    raise ValueError(f"policy is {name!r}, needs one of {', '.join(BUILT_IN_POLICIES)} or ppo:FILE")


def run_episodes(name: str, seeds: Sequence[int], options: dict[str, Any], steps: int) -> list[EpisodeResult]:
    """Run a policy on these seeds. options: of sim.placement.env.Placement except `action`, which the policy sets. steps: decisions."""
    policy = policy_of(name)
    env = gymnasium.make("pilsim/Placement-v0", **options, action=policy.action, max_episode_steps=steps)
    try:
        return [EpisodeResult(name, seed, _episode(env, policy, seed)) for seed in seeds]
    finally:
        env.close()


def _episode(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> dict[str, float]:
    observation, _ = env.reset(seed=seed)
    episode: Episode = env.unwrapped.episode  # type: ignore[attr-defined]
    policy.begin(TeamKnowledge.of(episode, observation), np.random.default_rng([seed, 1]))
    sums = dict.fromkeys(MEASURES, 0.0)
    ended, count = False, 0
    while not ended:
        observation, reward, terminated, truncated, info = env.step(policy.act(TeamKnowledge.of(episode, observation)))
        ended, count = terminated or truncated, count + 1
        for name in TERMS:
            sums[name] += info[name]
        sums["reward"] += float(reward)
    means = {name: value / count for name, value in sums.items()}
    return means if episode.tracking is None else means | episode.tracking.scores()


def table(results: Sequence[EpisodeResult], measures: Sequence[str] = ()) -> dict[str, dict[str, Interval]]:
    """policy → measure → mean over seeds with its 95 % interval."""
    out: dict[str, dict[str, Interval]] = {}
    for name in dict.fromkeys(result.policy for result in results):
        rows = [result.values for result in results if result.policy == name]
        out[name] = {measure: mean_interval([row[measure] for row in rows], bounds=bounds_of(measure)) for measure in (measures or rows[0])}
    return out
