"""Episodes of policies over many seeds: means of their measures, and paired differences from the first policy, with confidence intervals."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sim.confidence_intervals import Interval, bounds_of, difference_bounds_of, mean_interval, paired
from sim.parallel.pool import Pool
from sim.placement.config import SEEDS_PER_MAP, TRAVELLED
from sim.placement.episode import Episode
from sim.placement.information import TERMS
from sim.policies.planning import Greedy, Predictive
from sim.policies.policy import Lloyd, Policy, Random, Static, TeamKnowledge
from tracker.io.atomic import new_file

BUILT_IN_POLICIES: dict[str, Callable[[], Policy]] = {"random": Random, "static": Static, "lloyd": Lloyd, "greedy": Greedy, "predictive": Predictive}
"""Policies that need no file, by name."""
LEARNED = "learned"
"""Name of the learned policy in the package."""
MEASURES = ("reward", *TERMS)
MEASURES_SHOWN = ("information", "hota", "idf1", "mota", "seen", "seen_twice", "ate_m", "way_m", "collisions", "near_misses")
"""Measures in the printed tables, where available."""
DIGITS = 3
"""Decimals in the printed tables."""
TITLES = {
    "information": "information [nats]",
    "hota": "HOTA of the tracker",
    "idf1": "IDF1 of the tracker",
    "mota": "MOTA of the tracker",
    "seen": "share seen by one",
    "seen_twice": "share seen by two",
}
"""Measures of the picture, where available."""


@dataclass(frozen=True)
class EpisodeResult:
    """The result of an episode. values: means of MEASURES over its decisions, and the tracker's scores where it is in the loop.

    way_m: mean distance that a robot drove. act_ms: processor time of the policy per decision, which comparisons ignore.
    """

    policy: str
    seed: int
    values: dict[str, float]
    act_ms: float = field(default=math.nan, compare=False)


def policy_of(name: str) -> Policy:
    """The policy of a name, or of ppo:FILE. Raises ValueError for an unknown name and as Learned.read."""
    if name in BUILT_IN_POLICIES:
        return BUILT_IN_POLICIES[name]()
    kind, _, file = name.partition(":")
    if name == LEARNED or (kind == "ppo" and file):
        from sim.policies.learned import Learned, shipped_policy

        return Learned.read(file or str(shipped_policy()))
    raise ValueError(f"policy is {name!r}, needs one of {', '.join((*BUILT_IN_POLICIES, LEARNED))} or ppo:FILE")


def run_episodes(name: str, seeds: Sequence[int], options: dict[str, Any], steps: int) -> list[EpisodeResult]:
    """Run a policy on these seeds. options: of sim.placement.env.Placement except `action`, which the policy sets. steps: decisions."""
    return [_result(name, seed, options, steps) for seed in seeds]


def play(name: str, seed: int, options: Mapping[str, Any], steps: int) -> Iterator[Episode]:
    """Yield the episode of a policy and a seed, at its start and after each decision. Its `decided` is the policy's last processor time, s."""
    policy = policy_of(name)
    env = gymnasium.make("pilsim/Placement-v0", **options, action=policy.action, max_episode_steps=steps)
    try:
        observation, _ = env.reset(seed=seed)
        episode: Episode = env.unwrapped.episode  # type: ignore[attr-defined]
        policy.begin(TeamKnowledge.of(episode, observation), np.random.default_rng([seed, 1]))
        ended = False
        yield episode
        while not ended:
            knowledge, began = TeamKnowledge.of(episode, observation), time.process_time()
            action = policy.act(knowledge)
            episode.decided = time.process_time() - began
            observation, reward, terminated, truncated, info = env.step(action)
            episode.terms = dict(info) | {"reward": float(reward)}
            ended = terminated or truncated
            yield episode
    finally:
        env.close()


def _result(name: str, seed: int, options: Mapping[str, Any], steps: int) -> EpisodeResult:
    sums, count, acting = dict.fromkeys(MEASURES, 0.0), 0, 0.0
    for k, episode in enumerate(play(name, seed, options, steps)):
        if k:
            count, acting = count + 1, acting + episode.decided
            for measure in MEASURES:
                sums[measure] += episode.terms[measure]
    means = {measure: value / count for measure, value in sums.items()}
    means["way_m"] = float(episode.now.team[:, TRAVELLED].mean())
    scores = {} if episode.tracking is None else episode.tracking.scores()
    return EpisodeResult(name, seed, means | scores, 1000.0 * acting / count)


def table(results: Sequence[EpisodeResult]) -> dict[str, dict[str, Interval]]:
    """policy → measure → mean over seeds with its 95 % interval."""
    out: dict[str, dict[str, Interval]] = {}
    for name in dict.fromkeys(result.policy for result in results):
        rows = [result.values for result in results if result.policy == name]
        out[name] = {measure: mean_interval([row[measure] for row in rows], bounds=bounds_of(measure)) for measure in rows[0]}
    return out


def compare(policies: Sequence[str], seeds: range, options: dict[str, Any], steps: int, workers: int = 1) -> Iterator[list[EpisodeResult]]:
    """Run every policy on every seed. Yields batches of results, ordered by policy and seed for any number of workers.

    options: as in `run_episodes`. steps: decisions per episode. With one worker, this process runs them. Raises ValueError as Pool does.
    """
    pool = Pool(workers)
    calls = [(name, group, options, steps) for name in dict.fromkeys(policies) for group in _groups(seeds)]
    if workers == 1:
        yield from (run_episodes(*call) for call in calls)
        return
    yield from pool.results(run_episodes, calls)


def _groups(seeds: range) -> list[range]:
    """The seeds in groups that share a map, so that each map is built once."""
    cuts = [seeds.start, *(seed for seed in seeds[1:] if seed % SEEDS_PER_MAP == 0), seeds.stop]
    return [range(a, b) for a, b in pairwise(cuts)]


def differences(results: Sequence[EpisodeResult]) -> dict[str, dict[str, Interval]]:
    """policy → measure → mean paired difference from the first policy over seeds, with its 95 % interval."""
    first, *others = dict.fromkeys(result.policy for result in results)
    by_policy = {name: {o.seed: o.values for o in results if o.policy == name} for name in (first, *others)}
    out: dict[str, dict[str, Interval]] = {}
    for name in others:
        out[name] = {}
        for measure in next(iter(by_policy[name].values())):
            one, other = ({seed: values[measure] for seed, values in by_policy[which].items()} for which in (first, name))
            difference = paired(one, other, bounds=difference_bounds_of(measure))
            if difference is not None:
                out[name][measure] = difference
    return out


def text(means: dict[str, dict[str, Interval]], paired_differences: dict[str, dict[str, Interval]]) -> str:
    """The tables of means and of differences, one row per policy."""
    shown = [measure for measure in MEASURES_SHOWN if measure in next(iter(means.values()))]
    width = max(12, *(len(short_name(name)) for name in means)) + 1
    lines = [f"{'policy':{width}s}" + "".join(f"{measure:>27s}" for measure in shown)]
    lines += [f"{short_name(name):{width}s}" + "".join(f"{row[measure].text(DIGITS):>27s}" for measure in shown) for name, row in means.items()]
    if paired_differences:
        lines += ["", f"difference from {short_name(next(iter(means)))}, paired by seed"]
        cells = {name: "".join(f"{row[measure].text(DIGITS, signed=True):>27s}" for measure in shown) for name, row in paired_differences.items()}
        lines += [f"{short_name(name):{width}s}{cell}" for name, cell in cells.items()]
    return "\n".join(lines)


def short_name(name: str) -> str:
    """The name of a policy without the path of its file."""
    kind, _, file = name.partition(":")
    return f"{kind}:{Path(file).parent.name or Path(file).name}" if file else kind


def draw(means: dict[str, dict[str, Interval]], title: str, file: Path) -> None:
    """Plot the means of the measures of TITLES with their intervals as a PNG. The file is written under a temporary name first."""
    from matplotlib.figure import Figure

    shown = [measure for measure in TITLES if measure in next(iter(means.values()))]
    figure = Figure(figsize=(2.6 * len(shown) + 1.2, 0.45 * len(means) + 1.5), dpi=120, layout="constrained")
    panels = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, measure in zip(panels, shown, strict=True):
        for row, found in enumerate(found[measure] for found in means.values()):
            if found.low is not None and found.high is not None:
                axes.plot([found.low, found.high], [row, row], color="#1e69d6", linewidth=2.5, alpha=0.45, solid_capstyle="round")
            axes.plot(found.mean, row, "o", color="#1e69d6", markersize=5)
            axes.annotate(f"{found.mean:.2f}", (found.mean, row), (0, 6), textcoords="offset points", ha="center", fontsize=8)
        axes.set_title(TITLES[measure], fontsize=9, loc="left")
        axes.set_yticks(range(len(means)), [short_name(name) for name in means])
        axes.set_ylim(len(means) - 0.4, -0.7)
        axes.grid(axis="x", alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    with new_file(file) as part:
        figure.savefig(part)
