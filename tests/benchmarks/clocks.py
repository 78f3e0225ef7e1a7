"""Cameras with clocks of their own: MOTA / IDF1 of a synthetic room and hall where a camera has a fault, less those of the same people without it.

Four cameras in the corners see walking people by the error model of FairMOT; the last camera has the fault. "as frames" takes its frames for those
of the others, as where nothing says when they were taken; "by times" has times.csv; "auto" has estimated offsets instead.
Means of paired seeds, with standard errors.

`python -m tests.benchmarks.clocks --seeds 0 4 --faults late`
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed

from sim.cameras.view_clock import ViewClock, parse_view_clocks
from sim.tuning.kinds import corner_cameras
from sim.tuning.population import STATURE, STATURES
from sim.tuning.walks import STEPS, Habits, Walkers, floor, furniture, walks
from tracker.detector_models.model import named_model
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.simulation import simulated_detections
from tracker.geometry import Array, Ints
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.recordings import FrameBoxes, Recording
from tracker.recordings.clock_offsets import estimated_offsets, with_offsets
from tracker.recordings.clocks import CameraClock
from tracker.sequence.results import Results

PLACES = {"room": ((7.7, 3.4), 6), "hall": ((18.0, 12.0), 12)}
"""Length and width, m, and people."""
FAULTS = {
    "none": "",
    "rate": "C4:rate=7",
    "late": "C4:offset=0.13",
    "lost": "C4:lost=0.1",
    "freeze": "C4:freeze=8+3",
    "all late": "C2:offset=0.06;C3:offset=0.19;C4:offset=0.13",
}
WAYS = ("as frames", "by times", "auto")
SECONDS, DELAY, WALK = 20, 0.4, 0.2
"""s: of a recording, by which estimates are late, and between the frames of the walks, which have STEPS steps."""


def simulated(place: str, fault: str, seed: int, rate: float) -> Recording:
    """A recording of 20 s with exact stamps. rate: frames/s of cameras without a fault."""
    size, people = PLACES[place]
    rng = np.random.default_rng([seed, people])
    around = floor(np.array([(0.0, 0.0), size]), furniture(size, 0.01, rng), 2, rng)
    cameras = {f"C{k}": camera for k, camera in enumerate(corner_cameras(size, 4, rng), 1)}
    walkers = Walkers.of(around, Habits(0.2, 0.0, 0.0, 5.0, 1.1, (0.4, 1.0)), (people, people, 0), SECONDS + 1, rng)
    walked, heights = walks(walkers, round((SECONDS + 1) / WALK), WALK).place, np.clip(rng.normal(*STATURE, people), *STATURES)
    clocks = parse_view_clocks(FAULTS[fault], rate) if FAULTS[fault] else {}

    def people_at(times: Array) -> dict[int, tuple[Ints, Array]]:
        step = times / WALK * STEPS
        low = step.astype(np.int64)
        share = (step - low)[:, None, None]
        floor_places = (1 - share) * walked[low] + share * walked[low + 1]
        return {k: (np.arange(1, people + 1), np.column_stack([one, np.zeros(people)])) for k, one in enumerate(floor_places)}

    detections, stamps = dict[str, FrameBoxes](), dict[str, CameraClock]()
    for name, camera in cameras.items():
        clock = clocks.get(name, ViewClock())
        pictures = clock.pictures(SECONDS - 1 / rate, rate, np.random.default_rng([seed, 1]))
        places = people_at(np.array([picture.time for picture in pictures]))
        alone = Recording(clock.rate or rate, {name: camera}, {name: {}}, places, frames=len(pictures), pillars=around.pillars)
        truth = TruePeople(places, {}, heights={k + 1: float(height) for k, height in enumerate(heights)})
        found = simulated_detections(alone, truth, named_model("fairmot"), seed)[name]
        detections[name] = {picture.number: found[picture.number] for picture in pictures if picture.arrives}
        if name in clocks:
            stamps[name] = CameraClock(stamps={picture.number: picture.time for picture in pictures if picture.arrives})
    true, frames = people_at(np.arange(round(SECONDS * rate)) / rate), round(SECONDS * rate)
    area = np.array([(0.0, 0.0), size])
    return Recording(rate, cameras, detections, true, frames, area, pillars=around.pillars, clocks=stamps)


def outcome(recording: Recording) -> Array:
    """MOTA and IDF1 (2,) of a recording."""
    sequence = recording.sequence()
    results = Results.of(track(sequence.setup, sequence.ticks, Parameters(delay=round(DELAY * recording.rate))), run={})
    scores = evaluate(sequence, results)["targets"]
    return np.array([scores["mota"], scores["idf1"]])


def outcomes(place: str, fault: str, seed: int, rate: float) -> Array:
    """MOTA and IDF1 (ways, 2) of a fault, and of none where `fault` is "none"."""
    recording = simulated(place, fault, seed, rate)
    untold = replace(recording, clocks={})
    auto = estimated_offsets(untold)
    return np.array([outcome(untold), outcome(recording), outcome(with_offsets(untold, auto) if auto else untold)])


def lines(options: argparse.Namespace) -> Iterator[str]:
    """A line for each place and fault, as it is done."""
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    yield f"{options.rate:g} frames/s, seeds {seeds[0]} to {seeds[-1]}; less the recording without fault: MOTA / IDF1"
    yield f"| place | fault | {' | '.join(WAYS)} |\n|---|---|---|---|---|"
    faults = ["none", *(fault for fault in options.faults if fault != "none")]
    jobs = [delayed(outcomes)(place, fault, seed, options.rate) for place in options.places for fault in faults for seed in seeds]
    found, right = Parallel(n_jobs=options.workers, return_as="generator")(jobs), np.zeros((len(seeds), len(WAYS), 2))
    for place in options.places:
        for fault in faults:
            here = np.array([next(found) for _ in seeds])
            right = here if fault == "none" else right
            less = here - (0 if fault == "none" else right[:, 1:2])
            error = less.std(axis=0, ddof=1) / np.sqrt(len(seeds)) if len(seeds) > 1 else np.full(less.shape[1:], np.nan)
            cells = [" / ".join(f"{m:+.3f} ± {e:.3f}" for m, e in zip(*way, strict=True)) for way in zip(less.mean(axis=0), error, strict=True)]
            yield f"| {place} | {fault} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", nargs="+", choices=PLACES, default=list(PLACES))
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS)[1:5])
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 2), metavar=("FIRST", "LAST"))
    parser.add_argument("--rate", type=float, default=25.0, help="frames/s of the cameras without a fault")
    parser.add_argument("--workers", type=int, default=1)
    for line in lines(parser.parse_args()):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
