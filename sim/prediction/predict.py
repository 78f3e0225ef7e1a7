"""The prediction of a tracker's scores.

On a recording: twins of its second part by models fitted to its first, beside the real boxes. In a place: simulated people before its cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sim.datasets.generation_worker import SequenceTask
from sim.datasets.presets import Preset
from sim.parallel.pool import Pool
from sim.prediction.halves import FittedViews, Halves, fit_views, open_halves, twin
from sim.prediction.prediction import FIGURES, Forecast, Frames, Outcome, Prediction
from sim.recording.frames import raycast_frames
from sim.recording.tracker_setup import make_setup
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
from tracker.sequence.writer import ImageForm
from tracker.types import Setup, Tick, Truth
from tracker.types.truth import evaluated_people

FITTED = "fitted"
"""The detector whose models are fitted to the recording."""
Progress = Callable[..., Iterable[Any]]


def outcome(recording: Recording, tracker: TrackerUnderTest, run: str) -> Outcome:
    """Track a recording with truth and score it as `pilsim score` does. run: NAME/SEED, by which tracks made elsewhere are found."""
    sequence = recording.sequence()
    assert sequence.truth is not None
    return _tracked(sequence.setup, list(sequence.ticks)[: len(sequence.truth)], sequence.truth, (tracker, run))


def _tracked(setup: Setup, ticks: list[Tick], truth: tuple[Truth, ...], by: tuple[TrackerUnderTest, str]) -> Outcome:
    """Track ticks and score them. by: the tracker, and the name of the run."""
    tracker, run = by
    results = tracker.results_of(setup, ticks, run)
    people = {t.index: (t.person_id, t.feet) for t in truth}
    found: dict[str, Any] = score(matching_frames(people, results.tracks, evaluated_people(truth, setup.period))).to_dict()
    figures = {name: float("nan") if found[name] is None else float(found[name]) for name in FIGURES}
    case = Case("prediction", "prediction", "seed", run, default_scenario(), source=RECORDED)
    data = TrialData(case, setup, ticks, truth, [{} for _ in ticks], setup, ticks, {})
    return Outcome(figures, count_causes(find_mistakes(gather_evidence(data, results))))


@dataclass(frozen=True)
class PredictionPlan:
    """What is predicted.

    path, options: the recording. fit_frames: of the fit, None for the first half. detectors: FITTED, INDEPENDENT, or a model as `chosen_model` gives
    it, by the name shown. The first is the prediction. seeds: of the twins.
    place: in place of the recording, the place, its people, cameras and robots; each seed has other paths. FITTED is not possible there.
    """

    path: Path
    options: SourceOptions
    tracker: TrackerUnderTest
    detectors: Mapping[str, str] = field(default_factory=lambda: {FITTED: FITTED})
    fit_frames: Frames | None = None
    seeds: tuple[int, ...] = tuple(range(5))
    place: Preset | None = None


def predict(plan: PredictionPlan, pool: Pool | None = None, progress: Progress | None = None) -> Prediction:
    """Fit, make the twins, and track them and the real boxes with the same tracker.

    pool: None runs in this process. progress: wraps the iteration over runs. Results do not depend on the number of workers.
    Raises ValueError, in one line, as `open_halves` and `fit_views`.
    """
    if not plan.seeds:
        raise ValueError("seeds are none, needs at least one")
    if plan.place is not None:
        return _predict_place(plan, plan.place, pool, progress)
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
    found = _run(_outcome, calls, pool, progress)
    forecasts = _forecasts(plan, found, names)
    persons = {int(person) for ids, _ in (halves.tried.recording.truth or {}).values() for person in ids}
    cameras = tuple(halves.tried.recording.detections) or tuple(halves.tried.recording.cameras)
    return Prediction(forecasts, found[-1] if halves.real else None, halves.fit_frames, halves.try_frames, len(persons), cameras, errors)


def _predict_place(plan: PredictionPlan, place: Preset, pool: Pool | None, progress: Progress | None) -> Prediction:
    calls = [(place, choice, plan.tracker, seed) for choice in plan.detectors.values() for seed in plan.seeds]
    found = _run(_place_outcome, calls, pool, progress)
    names = [name for name in plan.detectors for _ in plan.seeds]
    forecasts = _forecasts(plan, [one for one, _ in found], names)
    return Prediction(forecasts, None, None, (0, place.scenario.frames), place.scenario.people, found[0][1])


def _place_outcome(place: Preset, detector: str, tracker: TrackerUnderTest, seed: int) -> tuple[Outcome, tuple[str, ...]]:
    """One run of a place without rendering, and the names of its cameras."""
    scenario = replace(place.scenario, seed=seed, detector_model=detector)
    made = SequenceTask(Path(), "place", replace(place, scenario=scenario), ImageForm()).simulated()
    setup = make_setup(made.simulation, made.fixed)
    frames = list(raycast_frames(made.simulation, setup))
    run = (tracker, f"place/{seed}")
    return _tracked(setup, [frame.tick for frame in frames], tuple(frame.truth for frame in frames), run), tuple(setup.mounts)


def _run(function: Callable[..., Any], calls: list[Any], pool: Pool | None, progress: Progress | None) -> list[Any]:
    """The results of all calls, in their order."""
    done = (function(*call) for call in calls) if pool is None else pool.results(function, calls)
    return list(done if progress is None else progress(done, total=len(calls)))


def _forecasts(plan: PredictionPlan, found: list[Outcome], names: list[str]) -> dict[str, Forecast]:
    return {name: Forecast.of([one for one, other in zip(found, names, strict=False) if other == name]) for name in plan.detectors}


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
