"""The prediction of a tracker's scores on a recording: twins of its second part by models fitted to its first, beside the real boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim.parallel.pool import Pool
from sim.prediction.halves import FittedViews, Halves, fit_views, open_halves, twin
from sim.prediction.prediction import FIGURES, Forecast, Frames, Outcome, Prediction
from sim.stress.error_causes import count_causes, find_mistakes, gather_evidence
from sim.stress.sweeps import RECORDED, Case, default_scenario
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData
from tracker.detector_models.fitting import Source
from tracker.detector_models.model import model_of
from tracker.formats.source_options import SourceOptions
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.recordings import Recording
from tracker.types.truth import evaluated_people

FITTED = "fitted"
"""The detector whose models are fitted to the recording."""
Progress = Callable[..., Iterable[Any]]


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


def predict(plan: PredictionPlan, pool: Pool | None = None, progress: Progress | None = None) -> Prediction:
    """Fit, make the twins, and track them and the real boxes with the same tracker.

    pool: None runs in this process. progress: wraps the iteration over runs. Results do not depend on the number of workers.
    Raises ValueError, in one line, as `open_halves` and `fit_views`.
    """
    if not plan.seeds:
        raise ValueError("seeds are none, needs at least one")
    halves = open_halves(plan.path, plan.options, plan.fit_frames, FITTED in plan.detectors.values())
    calls, names = list[tuple[Source, FittedViews | None, TrackerUnderTest, int]](), list[str]()
    errors: dict[str, Any] | None = None
    for name, choice in plan.detectors.items():
        models = _models(choice, halves, plan.path)
        errors = errors or (None if models.shared is None else models.shared.to_dict())
        calls += [(halves.tried, models, plan.tracker, seed) for seed in plan.seeds]
        names += [name] * len(plan.seeds)
    if halves.real:
        calls.append((halves.tried, None, plan.tracker, 0))
    done = (_outcome(*call) for call in calls) if pool is None else pool.results(_outcome, calls)
    found = list(done if progress is None else progress(done, total=len(calls)))
    forecasts = {name: Forecast.of([one for one, other in zip(found, names, strict=False) if other == name]) for name in plan.detectors}
    persons = {int(person) for ids, _ in (halves.tried.recording.truth or {}).values() for person in ids}
    cameras = tuple(halves.tried.recording.detections) or tuple(halves.tried.recording.cameras)
    return Prediction(forecasts, found[-1] if halves.real else None, halves.fit_frames, halves.try_frames, len(persons), cameras, errors)


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
