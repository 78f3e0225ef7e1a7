"""The prediction of a tracker's scores on a recording: twins of its second part by models fitted to its first, beside the real boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

from sim.parallel.pool import Pool
from sim.prediction.halves import FittedViews, Frames, Halves, fit_views, open_halves, twin
from sim.stress.error_causes import count_causes, find_mistakes, gather_evidence
from sim.stress.sweeps import RECORDED, Case, default_scenario
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData
from tracker.detector_models.fitting import Source
from tracker.detector_models.model import model_of
from tracker.detector_models.shared_errors import SharedErrors
from tracker.formats.source_options import SourceOptions
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.recordings import Recording
from tracker.types.truth import evaluated_people

FIGURES = ("mota", "idf1", "hota", "misses", "false_positives", "switches", "motp_m", "truths")
"""Names of the scores of a run."""
BOUNDS: dict[str, tuple[float, float]] = {"mota": (-np.inf, 1.0), "idf1": (0.0, 1.0), "hota": (0.0, 1.0)}
"""Least and greatest value of figures; others are counts and distances of at least 0."""
FITTED = "fitted"
"""The detector whose models are fitted to the recording."""
Progress = Callable[..., Iterable[Any]]


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
    case = Case("prediction", "prediction", "seed", run, default_scenario(), source=RECORDED)
    data = TrialData(case, sequence.setup, ticks, sequence.truth, [{} for _ in ticks], sequence.setup, ticks, {})
    return Outcome(figures, count_causes(find_mistakes(gather_evidence(data, results))))


@dataclass(frozen=True)
class PredictionPlan:
    """What is predicted.

    path, options: the recording. fit_frames: of the fit, None for the first half. detectors: FITTED, INDEPENDENT, or a model as `chosen_model` gives
    it, by the name shown. The first is the prediction. seeds: of the twins.
    """

    path: Path
    options: SourceOptions
    tracker: TrackerUnderTest
    detectors: Mapping[str, str] = field(default_factory=lambda: {FITTED: FITTED})
    fit_frames: Frames | None = None
    seeds: tuple[int, ...] = tuple(range(5))


@dataclass(frozen=True)
class Predicted:
    """The mean of a figure over the seeds, and the interval in which the figure of one more run lies with 95 %; None for one seed."""

    mean: float
    low: float | None
    high: float | None

    @staticmethod
    def of(values: Sequence[float], bounds: tuple[float, float] = (0.0, np.inf)) -> Predicted:
        """By Student's t for a new value: mean ± t s √(1 + 1/n), within the bounds of the figure."""
        known = np.array([value for value in values if np.isfinite(value)])
        if not len(known):
            return Predicted(float("nan"), None, None)
        mean, n = float(known.mean()), len(known)
        if n < 2:
            return Predicted(mean, None, None)
        wide = float(stdtrit(n - 1, 0.975) * known.std(ddof=1) * np.sqrt(1 + 1 / n))
        return Predicted(mean, max(mean - wide, bounds[0]), min(mean + wide, bounds[1]))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Outcomes by detector, one a seed, and the real one, None without real boxes.

    frames: of the fit (None without one) and of the twins. people: number of true persons in the twins.
    shared: errors of the truth on which the views agree, where they are known.
    """

    twins: Mapping[str, tuple[Outcome, ...]]
    real: Outcome | None
    fit_frames: Frames | None
    frames: Frames
    people: int
    cameras: tuple[str, ...]
    shared: SharedErrors | None = None

    def predicted(self, detector: str) -> dict[str, Predicted]:
        """Figures by name, of the twins of a detector."""
        return {name: Predicted.of([one.figures[name] for one in self.twins[detector]], BOUNDS.get(name, (0.0, np.inf))) for name in FIGURES}

    def causes(self, detector: str) -> dict[str, dict[str, Predicted]]:
        """Kind of error → cause → number, of the twins of a detector."""
        first = self.twins[detector][0].causes
        return {kind: {cause: Predicted.of([one.causes[kind][cause] for one in self.twins[detector]]) for cause in of} for kind, of in first.items()}

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        real = None if self.real is None else {"figures": self.real.figures, "causes": self.real.causes}
        twins = {}
        for name, runs in self.twins.items():
            figures = {key: vars(value) for key, value in self.predicted(name).items()}
            causes = {kind: {cause: vars(value) for cause, value in of.items()} for kind, of in self.causes(name).items()}
            twins[name] = {"figures": figures, "causes": causes, "runs": [one.figures for one in runs]}
        return {
            "fit_frames": self.fit_frames and list(self.fit_frames),
            "frames": list(self.frames),
            "people": self.people,
            "cameras": list(self.cameras),
            "truth_errors": self.shared and self.shared.to_dict(),
            "real": real,
            "predicted": twins,
        }


def predict(plan: PredictionPlan, pool: Pool | None = None, progress: Progress | None = None) -> Prediction:
    """Fit, make the twins, and track them and the real boxes with the same tracker.

    pool: None runs in this process. progress: wraps the iteration over runs. Results do not depend on the number of workers.
    Raises ValueError, in one line, as `open_halves` and `fit_views`.
    """
    if not plan.seeds:
        raise ValueError("seeds are none, needs at least one")
    halves = open_halves(plan.path, plan.options, plan.fit_frames, FITTED in plan.detectors.values())
    calls, names = list[tuple[Source, FittedViews | None, TrackerUnderTest, int]](), list[str]()
    shared: SharedErrors | None = None
    for name, choice in plan.detectors.items():
        models = _models(choice, halves, plan.path)
        shared = shared or models.shared
        calls += [(halves.tried, models, plan.tracker, seed) for seed in plan.seeds]
        names += [name] * len(plan.seeds)
    if halves.real:
        calls.append((halves.tried, None, plan.tracker, 0))
    done = (_outcome(*call) for call in calls) if pool is None else pool.results(_outcome, calls)
    found = list(done if progress is None else progress(done, total=len(calls)))
    twins = {name: tuple(one for one, other in zip(found, names, strict=False) if other == name) for name in plan.detectors}
    persons = {int(person) for ids, _ in (halves.tried.recording.truth or {}).values() for person in ids}
    cameras = tuple(halves.tried.recording.detections) or tuple(halves.tried.recording.cameras)
    return Prediction(twins, found[-1] if halves.real else None, halves.fit_frames, halves.try_frames, len(persons), cameras, shared)


def _models(choice: str, halves: Halves, path: Path) -> FittedViews:
    if choice == FITTED:
        assert halves.fitted is not None
        return fit_views(halves.fitted, path)
    recording = halves.tried.recording
    return FittedViews(dict.fromkeys(list(recording.detections) or list(recording.cameras), model_of(choice)))


def _outcome(source: Source, views: FittedViews | None, tracker: TrackerUnderTest, seed: int) -> Outcome:
    """One run, of a twin or with views None of the real boxes, perhaps in another process."""
    if views is None:
        return outcome(source.recording, tracker, f"real/{seed}")
    return outcome(twin(source, views, seed), tracker, f"twin/{seed}")
