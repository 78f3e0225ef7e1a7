"""Comparison of policies on the same episodes: means, and paired differences from the first policy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval, difference_bounds_of, paired
from sim.parallel.pool import Pool
from sim.placement.config import SEEDS_PER_MAP
from sim.policies.rollouts import EpisodeResult, run_episodes
from tracker.io.atomic import new_file

MEASURES_SHOWN = ("seen_twice", "seen", "gospa", "mota", "reward", "collisions", "near_misses")
"""Measures in the printed tables, where they were taken."""
DIGITS = 3
"""Decimals in the printed tables."""
TITLES = {"seen_twice": "share seen by two", "seen": "share seen by one", "gospa": "relative GOSPA (lower is better)", "mota": "MOTA of the tracker"}


def compare(policies: Sequence[str], seeds: range, options: dict[str, Any], steps: int, workers: int = 1) -> Iterator[list[EpisodeResult]]:
    """Run every policy on every seed. Yields batches of results, ordered by policy and seed for any number of workers.

    options: as in rollouts.run_episodes. steps: decisions per episode. One worker is this process. Raises ValueError as Pool does.
    """
    pool = Pool(workers)
    calls = [(name, group, options, steps) for name in dict.fromkeys(policies) for group in _groups(seeds)]
    if workers == 1:
        yield from (run_episodes(*call) for call in calls)
        return
    yield from pool.results(_run_episodes, calls)


def _groups(seeds: range) -> list[range]:
    """The seeds in groups that share a map, so that each map is built once."""
    cuts = [seeds.start, *(seed for seed in seeds[1:] if seed % SEEDS_PER_MAP == 0), seeds.stop]
    return [range(a, b) for a, b in pairwise(cuts)]


def _run_episodes(name: str, seeds: range, options: dict[str, Any], steps: int) -> list[EpisodeResult]:
    """Run episodes in a worker process, where the environment is not registered yet."""
    import sim  # noqa: F401

    return run_episodes(name, seeds, options, steps)


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
    """Plot the means of relative measures with their intervals as a PNG. The file is written under a temporary name first."""
    from matplotlib.figure import Figure

    shown = [measure for measure in ("seen_twice", "seen", "gospa", "mota") if measure in next(iter(means.values()))]
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
