"""One tracking run on real or simulated boxes: its scores, and its errors by cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sim.stress.error_causes import count_causes, find_mistakes, gather_evidence
from sim.stress.sweeps import RECORDED, Case, default_scenario
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.recordings import Recording
from tracker.types.truth import evaluated_people

FIGURES = ("mota", "idf1", "hota", "misses", "false_positives", "switches", "motp_m", "truths")
"""Names of the scores of a run."""


@dataclass(frozen=True)
class Outcome:
    """Scores by name (FIGURES; NaN where undefined), and counts of errors: kind → cause → number, as `stress` has them."""

    figures: dict[str, float]
    causes: dict[str, dict[str, int]]


def outcome(recording: Recording, tracker: TrackerUnderTest, run: str) -> Outcome:
    """Track a recording with truth and score it as `pilsim score` does. run: NAME/SEED, by which tracks made elsewhere are found."""
    sequence = recording.sequence()
    assert sequence.truth is not None
    ticks = list(sequence.ticks)[: len(sequence.truth)]
    results = tracker.results_of(sequence.setup, ticks, run)
    people = {t.index: (t.person_id, t.feet) for t in sequence.truth}
    found: dict[str, Any] = score(matching_frames(people, results.tracks, evaluated_people(sequence.truth, sequence.setup.period))).to_dict()
    figures = {name: float("nan") if found[name] is None else float(found[name]) for name in FIGURES}
    case = Case("prediction", "prediction", "seed", run[1], default_scenario(), source=RECORDED)
    data = TrialData(case, sequence.setup, ticks, sequence.truth, [{} for _ in ticks], sequence.setup, ticks, {})
    return Outcome(figures, count_causes(find_mistakes(gather_evidence(data, results))))
