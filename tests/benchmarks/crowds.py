"""Crowds among moving robots: people by the tracker in `campus` and `ruins`, the robots' poses from SLAM, and beside it from the truth.

Four rovers, 20 s at 6 frames/s, the simulator's detector at its default, sightings of landmarks by rays in the place of pictures; told 10 frames
late. What is missed, imagined and mixed up is told by cause, as shares of all people who count.
`python -m tests.benchmarks.crowds --worlds ruins --people 10 43 --seeds 100 109`
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed

from sim.scenario import Scenario
from sim.stress import error_causes
from sim.stress.ablation import STAGES, replaced
from sim.stress.footage import simulate_case
from sim.stress.sweeps import Case
from sim.stress.trial import scored
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results

WORLDS, PEOPLE, SEEDS, FRAMES, DELAY = ("campus", "ruins"), (10, 43, 74), (100, 109), 120, 10
POSES = ("SLAM", "true")


@dataclass(frozen=True)
class Outcome:
    """Scores of one run, ATE in m (NaN with true poses), how many counted, and how often which cause."""

    mota: float
    idf1: float
    ate: float
    truths: int
    error_causes: dict[str, int]


def outcomes(scenario: Scenario, delay: int) -> dict[str, Outcome]:
    """By where the poses come from, of one simulated run."""
    footage, out = simulate_case(Case("crowd/0", "crowd", "people", scenario.people, scenario), rendered=False), {}
    for poses in POSES:
        setup, ticks, _ = replaced(footage, dict.fromkeys(STAGES, False) | {"poses": poses == "true"})
        results = Results.of(track(setup, ticks, Parameters(delay=delay)), {})
        scores = scored(footage, results)
        why = error_causes.counted(error_causes.mistakes(error_causes.gather(footage, results)))
        flat = {cause: count for counts in why.values() for cause, count in counts.items()}
        ate = scores["ate_m"] if poses == "SLAM" and scores["ate_m"] is not None else np.nan
        out[poses] = Outcome(scores["mota"], scores["idf1"], ate, scores["truths"], flat)
    return out


def row(found: Iterable[Outcome]) -> str:
    """Means over runs, the least in brackets, and the causes that cost a hundredth or more."""
    runs = list(found)
    truths, why = sum(r.truths for r in runs), Counter[str]()
    for r in runs:
        why.update(r.causes)
    worst = ", ".join(f"{cause} {count / truths:.3f}" for cause, count in why.most_common() if count >= 0.01 * truths)
    mota, idf1 = ([getattr(r, name) for r in runs] for name in ("mota", "idf1"))
    ate = f"{np.mean([r.ate for r in runs]):.3f}" if all(np.isfinite(r.ate) for r in runs) else ""
    return f"{np.mean(mota):.3f} ({min(mota):.3f}) | {np.mean(idf1):.3f} ({min(idf1):.3f}) | {ate} | {worst}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--people", nargs="+", type=int, default=PEOPLE)
    parser.add_argument("--seeds", nargs=2, type=int, default=SEEDS, metavar=("FIRST", "LAST"))
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--delay", type=int, default=DELAY)
    parser.add_argument("--workers", type=int, default=2)
    told = parser.parse_known_args()[0]
    seeds = range(told.seeds[0], told.seeds[1] + 1)
    print(f"{told.frames} frames, {told.delay} frames late, seeds {seeds[0]} to {seeds[-1]}, means, the least in brackets\n")
    print("| world | people | poses | MOTA | IDF1 | ATE, m | what it costs |\n|---|---|---|---|---|---|---|")
    for world in told.worlds:
        for people in told.people:
            start = Scenario(world=world, people=people, frames=told.frames)
            runs = Parallel(n_jobs=told.workers)(delayed(outcomes)(replace(start, seed=seed), told.delay) for seed in seeds)
            for poses in POSES:
                print(f"| {world} | {people} | {poses} | {row(run[poses] for run in runs)} |", flush=True)


if __name__ == "__main__":
    main()
