"""Scores of a tracker on a synthetic case, on the ground: HOTA, MOTA, IDF1 and what they are made of."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from sim.stress.tracker_under_test import check_estimates
from sim.tuning.case_file import PopulationCase
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import Estimate, Setup, Tick
from tracker.types.truth import evaluated_people

Track = Callable[[Setup, Iterable[Tick]], Iterable[Estimate]]
FIGURES = ("hota", "mota", "idf1", "misses", "false_positives", "switches", "motp_m", "truths")


def evaluate(case: PopulationCase, tracker: Track | Parameters | None = None) -> dict[str, float]:
    """Track a case and score it as `pilsim score` does, with distances of at most 1 m: figures by FIGURES, and `seconds` of processor time.

    tracker: a function like tracker.pipeline.track, or parameters of pilsim's own, which is then as late as the case allows.
    People whom no camera sees do not count. A case in which nobody counts has figures of NaN.
    Raises the errors of the tracker, and ValueError where its estimates are not valid.
    """
    sequence = case.recording.sequence()
    assert sequence.truth is not None
    ticks, began = list(sequence.ticks), time.process_time()
    if tracker is None or isinstance(tracker, Parameters):
        estimates = track(sequence.setup, ticks, replace(tracker or Parameters(), delay=case.delay))
    else:
        estimates = tracker(sequence.setup, ticks)  # type: ignore[assignment]
    results = Results.of(check_estimates("under test", estimates, sequence.setup, ticks), {})
    seconds = time.process_time() - began
    people = {t.index: (t.person_id, t.feet) for t in sequence.truth}
    found = score(matching_frames(people, results.tracks, evaluated_people(sequence.truth, sequence.setup.period))).to_dict()
    figures = {name: math.nan if found[name] is None else float(found[name] or 0.0) for name in FIGURES}
    return figures | {"seconds": seconds}
