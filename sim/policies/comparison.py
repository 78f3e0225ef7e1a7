"""Policies side by side on the same episodes: run by several processes, told as means, and as paired differences to the first of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval, paired
from sim.parallel.pool import Pool
from sim.placement.config import SEEDS_A_MAP
from sim.policies.rollouts import Outcome, try_out
from tracker.io.atomic import new_file

SHOWN = ("seen_twice", "seen", "gospa", "mota", "reward", "collisions", "near_misses")
"""Measures that are told in words, where they were taken."""
DIGITS = 3


def contest(policies: Sequence[str], seeds: range, options: dict[str, Any], steps: int, workers: int = 1) -> Iterator[list[Outcome]]:
    """Every policy on every seed, some episodes at a time, in the order of policies and seeds whatever the number of workers.

    options as in placement_trial.try_out, steps: decisions of an episode; one worker is this process. Raises ValueError as Workforce does.
    """
    force = Pool(workers)
    orders = [(name, group, options, steps) for name in dict.fromkeys(policies) for group in _groups(seeds)]
    if workers == 1:
        yield from (try_out(*order) for order in orders)
        return
    yield from force.results(_try_out, orders)


def _groups(seeds: range) -> list[range]:
    """Seeds that share a map, together: it is built once."""
    cuts = [seeds.start, *(seed for seed in seeds[1:] if seed % SEEDS_A_MAP == 0), seeds.stop]
    return [range(a, b) for a, b in pairwise(cuts)]


def _try_out(name: str, seeds: range, options: dict[str, Any], steps: int) -> list[Outcome]:
    """In another process, where the environment has not been registered yet."""
    import sim  # noqa: F401

    return try_out(name, seeds, options, steps)


def differences(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Interval]]:
    """policy → measure → by how much it is more than under the first policy, seed by seed: the mean with its 95 % interval."""
    first, *others = dict.fromkeys(outcome.policy for outcome in outcomes)
    by_policy = {name: {o.seed: o.values for o in outcomes if o.policy == name} for name in (first, *others)}
    out: dict[str, dict[str, Interval]] = {}
    for name in others:
        out[name] = {}
        for measure in next(iter(by_policy[name].values())):
            one, other = ({seed: values[measure] for seed, values in by_policy[which].items()} for which in (first, name))
            difference = paired(one, other)
            if difference is not None:
                out[name][measure] = difference
    return out


def text(means: dict[str, dict[str, Interval]], less: dict[str, dict[str, Interval]]) -> str:
    """Both tables, a policy a row."""
    shown = [measure for measure in SHOWN if measure in next(iter(means.values()))]
    width = max(12, *(len(short(name)) for name in means)) + 1
    lines = [f"{'policy':{width}s}" + "".join(f"{measure:>27s}" for measure in shown)]
    lines += [f"{short(name):{width}s}" + "".join(f"{row[measure].text(DIGITS):>27s}" for measure in shown) for name, row in means.items()]
    if less:
        lines += ["", f"less {short(next(iter(means)))}, seed by seed"]
        cells = {name: "".join(f"{row[measure].text(DIGITS, signed=True):>27s}" for measure in shown) for name, row in less.items()}
        lines += [f"{short(name):{width}s}{cell}" for name, cell in cells.items()]
    return "\n".join(lines)


def short(name: str) -> str:
    """A policy's name without the folder of its file."""
    kind, _, file = name.partition(":")
    return f"{kind}:{Path(file).parent.name or Path(file).name}" if file else kind


def draw(means: dict[str, dict[str, Interval]], title: str, file: Path) -> None:
    """The means of what is told in shares, with their intervals, as a PNG; written under another name first."""
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
        axes.set_yticks(range(len(means)), [short(name) for name in means])
        axes.set_ylim(len(means) - 0.4, -0.7)
        axes.grid(axis="x", alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    with new_file(file) as part:
        figure.savefig(part)


TITLES = {"seen_twice": "seen by two, share", "seen": "seen by one, share", "gospa": "GOSPA, less is better", "mota": "MOTA of the tracker"}
