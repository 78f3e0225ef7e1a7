"""Whether the population of `pilsim tune` ranks parameters as real recordings do, and how fast it is.

    python -m tests.benchmarks.tuning rank --sets 60 --cases 100 --workers 2 --out runs/rank
    python -m tests.benchmarks.tuning speed --cases 40

`rank` draws parameter sets at random from a space. Each is scored on the population and on the first parts of real rows: PETS 2009, WILDTRACK, and
CMC in the area with complete truth. It prints Spearman's correlation of both: of all rows, of each, and of each kind of case.
Intervals of 95 % come from a bootstrap over the sets. What is done is kept in --out, and the same command goes on.
It takes some 60 x (100 cases x 3 s + 6 min) of one core.
`speed` prints seconds to draw and to track a case, by kind.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import spearmanr

from sim.tuning.case_file import VERSION
from sim.tuning.population import drawn_case, kind_of
from sim.tuning.scoring import Candidate, CaseSource, evaluate, score_case
from sim.tuning.space import OWN_SPACE, own_defaults, read_space
from tests.benchmarks.one_tracker import DELAY, Source, all_rows, outcome
from tracker.io.progress import progress_bar
from tracker.io.resume import Journal
from tracker.options import parameters_from
from tracker.parameter_file import Value

ROWS = ("pets-157", "pets-low", "pets-1", "pets-det", "cmc1-fairmot", "cmc2-fairmot", "cmc1-rcnn", "cmc2-rcnn", "wildtrack-0.1", "wildtrack-0.5")
RESAMPLES = 2000


def real_score(row: str, values: dict[str, Value]) -> float:
    """Mean of MOTA and IDF1 of the first part of a real row."""
    found = next(one for one in all_rows(True, range(0), Source()) if one.name == row)
    parameters = parameters_from({"parameters": values, "delay": DELAY if found.delay is None else found.delay})
    scores = []
    for source in found.runs.values():
        result = outcome(source, None, parameters, None)
        figures = result.parts.get("area", result.whole)
        scores.append((figures["mota"] + figures["idf1"]) / 2)
    return float(np.mean(scores))


def population_score(case: int, seed: int, folder: Path, values: dict[str, Value]) -> float:
    """HOTA of a case; NaN where nobody counts, or where the tracker fails."""
    return float(score_case(CaseSource(folder, seed), case, Candidate("", values)).get("hota", np.nan))


def correlation(first: np.ndarray, second: np.ndarray) -> tuple[float, float, float]:
    """Spearman's correlation of values (n,), and its lowest and highest value (95 %) over resampled sets."""
    rng, n = np.random.default_rng(0), len(first)
    drawn_rows = rng.integers(n, size=(RESAMPLES, n))
    values = [float(spearmanr(first[rows], second[rows]).statistic) for rows in drawn_rows]
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(spearmanr(first, second).statistic), float(low), float(high)


def rank(options: argparse.Namespace) -> None:
    """Score the sets, then print the correlations."""
    options.out.mkdir(parents=True, exist_ok=True)
    space, rng = read_space(options.space), np.random.default_rng(options.seed)
    own_defaults(space, str(options.space))
    sets = [{one.name: one.draw(rng) for one in space} for _ in range(options.sets)]
    population = options.population or options.out / "cases"
    jobs: list[tuple[str, Any]] = []
    for k, values in enumerate(sets):
        jobs += [(f"{k} {row}", delayed(real_score)(row, values)) for row in options.rows]
        jobs += [(f"{k} {case}", delayed(population_score)(case, options.seed, population, values)) for case in range(options.cases)]
    # Scores of other sets, or of another seed or version of the cases, are not those of these.
    journal = Journal(options.out / "scores.jsonl", {"seed": options.seed, "population": VERSION, "space": options.space.read_text()})
    done = {entry["name"]: entry["score"] for entry in journal.entries}
    left = [(name, job) for name, job in jobs if name not in done]
    found = Parallel(n_jobs=options.workers, return_as="generator")(job for _, job in left)
    with journal:
        for (name, _), score in progress_bar(zip(left, found, strict=True), total=len(left), desc="runs"):
            done[name] = score
            journal.add({"name": name, "score": score})
    real = np.array([[done[f"{k} {row}"] for row in options.rows] for k in range(options.sets)])
    made = np.array([[done[f"{k} {case}"] for case in range(options.cases)] for k in range(options.sets)])
    print_correlations(options, real, made)


def print_correlations(options: argparse.Namespace, real: np.ndarray, made: np.ndarray) -> None:
    """The table: real rows against the population, and all rows against each kind of case. real (sets, rows), made (sets, cases)."""
    whole = np.nanmean(made, axis=1)
    kinds = defaultdict[str, list[int]](list)
    for case in range(options.cases):
        kinds[kind_of(case, options.seed)].append(case)
    print(f"{'all rows':16} {shown(correlation(whole, real.mean(axis=1)))}")
    # Scores of single runs have noise: two noisy means correlate less than what they measure does.
    noise = reliability(made), reliability(real)
    print(f"reliability of the means: cases {noise[0]:.2f}, rows {noise[1]:.2f}; the most they can correlate is {np.sqrt(noise[0] * noise[1]):.2f}")
    for column, row in enumerate(options.rows):
        print(f"{row:16} {shown(correlation(whole, real[:, column]))}")
    for kind, cases in sorted(kinds.items()):
        print(f"{kind + ', all rows':16} {shown(correlation(np.nanmean(made[:, cases], axis=1), real.mean(axis=1)))}")


def reliability(scores: np.ndarray) -> float:
    """Rank correlation of the mean of scores (sets, n) with that of n others of their kind, by random halves (Spearman 1910, Brown 1910)."""
    rng, n = np.random.default_rng(0), scores.shape[1]
    halves = []
    for _ in range(RESAMPLES // 10):
        order = rng.permutation(n)
        halves.append(spearmanr(*(np.nanmean(scores[:, part], axis=1) for part in (order[: n // 2], order[n // 2 :]))).statistic)
    found = max(float(np.mean(halves)), 0.0)
    return 2 * found / (1 + found)


def shown(found: tuple[float, float, float]) -> str:
    return f"{found[0]:+.2f} ({found[1]:+.2f} to {found[2]:+.2f})"


def speed(options: argparse.Namespace) -> None:
    """Processor time of drawing and of tracking, by kind: median and greatest."""
    seconds: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for number in progress_bar(range(options.cases), desc="cases"):
        began = time.process_time()
        case = drawn_case(number, options.seed)
        drawing = time.process_time() - began
        seconds[case.kind].append((drawing, evaluate(case)["seconds"]))
    for kind, rows in [*sorted(seconds.items()), ("all", [row for of in seconds.values() for row in of])]:
        made, tracked = np.array(rows).T
        text = [f"{name} {np.median(of):5.1f} s (most {of.max():5.1f})" for name, of in (("drawn", made), ("tracked", tracked))]
        print(f"{kind:10} {len(rows):4} {', '.join(text)}")


def main(words: Iterable[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("rank", "speed"))
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", nargs="+", default=list(ROWS))
    parser.add_argument("--space", type=Path, default=OWN_SPACE)
    parser.add_argument("--population", type=Path, help="folder of cases that are drawn already (default: in --out)")
    parser.add_argument("--out", type=Path, default=Path("runs/rank"))
    options: Any = parser.parse_args(None if words is None else list(words))
    {"rank": rank, "speed": speed}[options.what](options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
