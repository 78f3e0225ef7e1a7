"""Ten real rows, predicted by twins and tracked: MOTA and IDF1 of the fitted detectors, of the independent one, and of the real boxes.

    python -m tests.benchmarks.prediction [--rows pets-1 cmc2 ...] [--seeds 3] [--tuning] [--trackers] [--distances]

Models are fitted to the first half, and the second half is predicted. `--tuning` halves the first half in the same way, so that
choices see nothing of the second. `--trackers` adds two other trackers and the rank correlation; `--distances` adds statistics of boxes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau, spearmanr

from sim.prediction import FITTED, Prediction, PredictionPlan, fit_views, open_halves, predict, twin
from sim.stress.tracker_under_test import TrackerUnderTest
from tests.conftest import DATA
from tracker.detector_models.comparison import distances
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import INDEPENDENT
from tracker.detector_models.samples import joined
from tracker.detector_models.simulation import simulated_detections
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.io.json_files import json_text

BOUNDS = {"mota": 0.03, "idf1": 0.05}
"""Greatest differences of predicted and real figures of a row that counts as predicted."""
DETECTORS = (FITTED, INDEPENDENT)
NEAREST = "tests.benchmarks.nearest_neighbour:nearest_neighbour"
PETS, CMC = DATA / "pets2009" / "S2.L1", DATA / "cmc"
WHOLE = (1.0, 1.0)
"""Errors of edges are measured from the whole body, for both detectors alike."""


@dataclass(frozen=True, eq=False)
class Row:
    """A row of the table: folder, options, the number of frames that are for tuning, and the delay of the default tracker, frames."""

    path: Path
    tuned: int
    delay: int
    cameras: str = ""
    detections: str = ""

    def options(self, tuning: bool) -> SourceOptions:
        camera, equals, file = self.detections.rpartition("=")
        given = [f"{camera}{equals}{self.path / file}"] if self.detections else []
        return SourceOptions.parse(given, cameras=self.cameras, frames=f"0:{self.tuned}" if tuning else "")


ROWS = {
    "pets-1": Row(PETS, 400, 10, "1"),
    "pets-157": Row(PETS, 400, 10, "1,5,7"),
    "pets-5678": Row(PETS, 400, 10, "5,6,7,8"),
    "pets-all": Row(PETS, 400, 10),
    "pets-1-det": Row(PETS, 400, 10, "1", "1=mot15/det.txt"),
    "cmc1-fairmot": Row(CMC / "CMC1", 130, 5),
    "cmc2-fairmot": Row(CMC / "CMC2", 130, 5),
    "cmc1-rcnn": Row(CMC / "CMC1", 130, 5, detections="detections-faster-rcnn"),
    "cmc2-rcnn": Row(CMC / "CMC2", 130, 5, detections="detections-faster-rcnn"),
    "wildtrack-5": Row(DATA / "wildtrack", 180, 5, "5"),
}


def trackers(row: Row, others: bool) -> dict[str, TrackerUnderTest]:
    """Trackers by name: the default one, and with `others` the same without delay and hypotheses, and a nearest neighbour."""
    own = TrackerUnderTest(options={"delay": row.delay})
    return {"default": own} | ({"n-scan 0": TrackerUnderTest(options={"n_scan": 0}), "nearest": TrackerUnderTest(NEAREST)} if others else {})


def within(found: Prediction, detector: str) -> bool:
    """Whether a detector predicts a row within BOUNDS."""
    assert found.real is not None
    predicted = found.forecasts[detector].figures
    return all(abs(predicted[name].mean - found.real.figures[name]) <= bound for name, bound in BOUNDS.items())


def line(name: str, found: Prediction) -> str:
    """A row of the table, in Markdown: real, then each detector, with a star where it is within BOUNDS."""
    assert found.real is not None
    cells = ["{mota:.3f} / {idf1:.3f}".format(**found.real.figures)]
    for detector in found.forecasts:
        predicted = found.forecasts[detector].figures
        cells.append(f"{predicted['mota'].mean:.3f} / {predicted['idf1'].mean:.3f}" + (" *" if within(found, detector) else ""))
    return f"| {name} | " + " | ".join(cells) + " |"


def errors(found: Prediction) -> str:
    """Misses, false positives and switches: real, then of each detector."""
    assert found.real is not None
    of = [found.real.figures, *({k: v.mean for k, v in of.figures.items()} for of in found.forecasts.values())]
    return "; ".join(f"{f['misses']:.0f} {f['false_positives']:.0f} {f['switches']:.0f}" for f in of)


def ranks(table: Mapping[str, Mapping[str, Prediction]], detector: str, figure: str) -> str:
    """Rank correlations of predicted and real figures, of row → tracker → prediction, and how often two trackers of a row are in the right order."""
    real, predicted, right, pairs = list[list[float]](), list[list[float]](), 0, 0
    for of in table.values():
        real.append([one.real.figures[figure] for one in of.values() if one.real is not None])
        predicted.append([one.forecasts[detector].figures[figure].mean for one in of.values()])
        for a, b in combinations(range(len(of)), 2):
            if real[-1][a] != real[-1][b]:
                right += (real[-1][a] - real[-1][b]) * (predicted[-1][a] - predicted[-1][b]) > 0
                pairs += 1
    x, y = np.array(real), np.array(predicted)
    rows, both = correlations(x[:, 0], y[:, 0]), correlations(x.ravel(), y.ravel())
    return f"| {detector} | {figure} | {rows} | {both} | {right} of {pairs} |"


def correlations(first: Array, second: Array) -> str:
    """Kendall's and Spearman's rank correlation of two samples (n,)."""
    return " / ".join(f"{of(first, second)[0]:.2f}" for of in (kendalltau, spearmanr)) if len(first) > 1 else "-"


def box_distances(row: Row, tuning: bool, seeds: Iterable[int]) -> dict[str, dict[str, float]]:
    """Detector → statistic → distance of simulated from real boxes, of the part that is predicted."""
    halves = open_halves(row.path, row.options(tuning))
    assert halves.fitted is not None
    models, tried = fit_views(halves.fitted, row.path), halves.tried
    recording, truth, real = tried.recording, tried.truth, tried.samples()
    own = joined([tried.samples(dict(twin(tried, models, seed).detections)) for seed in seeds])
    plain = joined([tried.samples(simulated_detections(recording, truth, IndependentErrors(), seed)) for seed in seeds])
    return {FITTED: distances(real, own, WHOLE), INDEPENDENT: distances(real, plain, WHOLE)}


def distance_table(rows: Iterable[str], tuning: bool, seeds: range) -> list[str]:
    """A line for each statistic, a column for each row: the fitted detectors, then the independent one."""
    found = {name: box_distances(ROWS[name], tuning, seeds) for name in rows}
    lines = ["| statistic | " + " | ".join(found) + " |", "|---" * (1 + len(found)) + "|"]
    for statistic in next(iter(found.values()))[FITTED]:
        cells = [" / ".join("-" if np.isnan(of[d][statistic]) else f"{of[d][statistic]:.2f}" for d in DETECTORS) for of in found.values()]
        lines.append(f"| {statistic} | " + " | ".join(cells) + " |")
    return lines


def run(rows: Iterable[str], seeds: range, tuning: bool, others: bool, as_json: bool) -> None:
    """Print the table row by row, and the counts of rows that are predicted."""
    table, right, done = dict[str, dict[str, Prediction]](), dict.fromkeys(DETECTORS, 0), 0
    if not as_json:
        print("| row | real | " + " | ".join(DETECTORS) + " | misses, false positives, switches |\n" + "|---" * 5 + "|", flush=True)
    for name in rows:
        row, table[name] = ROWS[name], {}
        for title, tracker in trackers(row, others).items():
            plan = PredictionPlan(row.path, row.options(tuning), tracker, {d: d for d in DETECTORS}, seeds=tuple(seeds))
            found = table[name][title] = predict(plan)
            shown = name if title == "default" else f"{name}, {title}"
            print(json_text({"row": shown} | found.to_dict()) if as_json else f"{line(shown, found)} {errors(found)} |", flush=True)
        done += 1
        right = {d: right[d] + within(table[name]["default"], d) for d in DETECTORS}
    if not as_json:
        print(f"\nwithin {BOUNDS['mota']} MOTA and {BOUNDS['idf1']} IDF1: " + ", ".join(f"{d} {n} of {done} rows" for d, n in right.items()))
    if others and not as_json:
        print("\n| detector | figure | over rows, Kendall / Spearman | over rows and trackers | order of two trackers |\n" + "|---" * 5 + "|")
        for detector in DETECTORS:
            print("\n".join(ranks(table, detector, figure) for figure in BOUNDS))


def main() -> int:
    # Called by name of `tests.benchmarks` without options, too.
    given = sys.argv[1:] if Path(sys.argv[0]).name == Path(__file__).name else []
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", default=list(ROWS), metavar="ROW", help=f"of {', '.join(ROWS)}, or how their names begin")
    parser.add_argument("--seeds", type=int, default=3, help="number of twins")
    parser.add_argument("--tuning", action="store_true", help="the first halves alone, in two parts")
    parser.add_argument("--trackers", action="store_true", help="two other trackers, too, and rank correlations")
    parser.add_argument("--distances", action="store_true", help="distances of simulated from real boxes, and no tracking")
    parser.add_argument("--json", action="store_true", help="a JSON object a row")
    options = parser.parse_args(given)
    rows = [name for name in ROWS if any(name.startswith(text) for text in options.rows)]
    unknown = [text for text in options.rows if not any(name.startswith(text) for name in ROWS)]
    if unknown or options.seeds < 1:
        what = f"row is {', '.join(unknown)}, needs one of {', '.join(ROWS)}" if unknown else f"--seeds is {options.seeds}, needs at least 1"
        print(f"error: {what}", file=sys.stderr)
        return 2
    missing = [name for name in rows if not ROWS[name].path.is_dir()]
    if missing:
        print(f"{missing[0]}: needs {ROWS[missing[0]].path}")
        return 0
    seeds = range(options.seeds)
    if options.distances:
        print("\n".join(distance_table(rows, options.tuning, seeds)))
    else:
        run(rows, seeds, options.tuning, options.trackers, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
