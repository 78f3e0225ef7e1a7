"""Crowds among moving robots: people tracked in `campus` and `ruins`, with robot poses from SLAM and with true ones.

Four rovers run for 20 s at 6 frames/s with the default detector. Sightings of landmarks come from ray casting, and output has a delay of 10 frames.
Errors are shown by cause, as shares of all true positions that count.

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
from sim.stress.ablation import STAGES, with_true_stages
from sim.stress.runner import trial_scores
from sim.stress.sweeps import Case
from sim.stress.trial_data import simulate_case
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results

WORLDS, PEOPLE, SEEDS, FRAMES, DELAY = ("campus", "ruins"), (10, 43, 74), (100, 109), 120, 10
POSES = ("SLAM", "true")


@dataclass(frozen=True)
class Outcome:
    """Scores of one run: ATE in m (NaN with true poses), number of true positions that count, and cause → count of errors."""

    mota: float
    idf1: float
    ate: float
    truths: int
    causes: dict[str, int]


def outcomes(scenario: Scenario, delay: int) -> dict[str, Outcome]:
    """The outcomes of one simulated run, by the source of the poses."""
    data, out = simulate_case(Case("crowd/0", "crowd", "people", scenario.people, scenario), rendered=False), {}
    for poses in POSES:
        setup, ticks, _ = with_true_stages(data, dict.fromkeys(STAGES, False) | {"poses": poses == "true"})
        results = Results.of(track(setup, ticks, Parameters(delay=delay)), {})
        scores = trial_scores(data, results)
        why = error_causes.count_causes(error_causes.find_mistakes(error_causes.gather_evidence(data, results)))
        flat = {cause: count for counts in why.values() for cause, count in counts.items()}
        ate = scores["ate_m"] if poses == "SLAM" and scores["ate_m"] is not None else np.nan
        out[poses] = Outcome(scores["mota"], scores["idf1"], ate, scores["truths"], flat)
    return out


def row(found: Iterable[Outcome]) -> str:
    """Means over runs with minima in brackets, and the causes with at least 0.01 errors per true position."""
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
    options = parser.parse_known_args()[0]
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    print(f"{options.frames} frames, delay {options.delay} frames, seeds {seeds[0]} to {seeds[-1]}, means with minima in brackets\n")
    print("| world | people | poses | MOTA | IDF1 | ATE, m | causes of errors |\n|---|---|---|---|---|---|---|")
    for world in options.worlds:
        for people in options.people:
            start = Scenario(world=world, people=people, frames=options.frames)
            runs = Parallel(n_jobs=options.workers)(delayed(outcomes)(replace(start, seed=seed), options.delay) for seed in seeds)
            for poses in POSES:
                print(f"| {world} | {people} | {poses} | {row(run[poses] for run in runs)} |", flush=True)


if __name__ == "__main__":
    main()
