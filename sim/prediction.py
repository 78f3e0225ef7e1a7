"""The prediction of a tracker's scores, with errors by cause, tables, and the file of `pilsim predict --out`.

For a recording, models fitted to its first part simulate its second part (twins), beside the real boxes. For a place, people are simulated, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sim.confidence_intervals import AT_LEAST_ZERO, Interval, bounds_of, one_more_interval
from sim.datasets.generation import SequenceTask
from sim.datasets.presets import Preset
from sim.parallel.pool import Pool
from sim.recording.frames import raycast_frames
from sim.recording.tracker_setup import make_setup
from sim.stress.error_causes import count_causes, find_mistakes, gather_evidence
from sim.stress.sweeps import RECORDED, Case, default_scenario
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData
from tracker.detector_models.fit import fit
from tracker.detector_models.fitting import Source, at_its_places, fit_view
from tracker.detector_models.model import Model, model_of
from tracker.detector_models.observations import true_people
from tracker.detector_models.shared_errors import SharedErrors, agreed, drawn
from tracker.detector_models.simulation import simulated_detections
from tracker.formats.opening import open_recording, say_suspicion
from tracker.formats.source_options import SourceOptions
from tracker.io.json_files import JsonObject, read_json
from tracker.metrics.clear_mot import score
from tracker.recordings import Recording
from tracker.sequence.writer import ImageForm
from tracker.types import Setup, Tick, Truth

SCHEMA = 1
FIGURES = ("mota", "idf1", "hota", "misses", "false_positives", "switches", "motp_m", "truths")
"""Names of the scores of a run."""
KINDS = ("misses", "false positives", "switches")
"""Kinds of errors that have causes."""
SCORES = (("mota", "MOTA", 3), ("idf1", "IDF1", 3), ("hota", "HOTA", 3))
ERRORS = (("misses", "misses", 1), ("false_positives", "false positives", 1), ("switches", "switches", 1))
"""Name of a figure, its title in tables, and digits of a mean."""
OTHERS = (("motp_m", "MOTP [m]", 3), ("truths", "true positions", 1))
REAL = "real"
Frames = tuple[int, int]
"""First frame, and the frame after the last."""
Cells = tuple[str, ...]
LEAST_FRAMES = 2
"""Least number of frames of each part."""
FITTED = "fitted"
"""The detector whose models are fitted to the recording."""
Progress = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class Outcome:
    """Scores of a run by name (FIGURES; undefined ones are NaN or left out), and counts of errors: kind → cause → number, as `stress` counts them."""

    figures: Mapping[str, float]
    causes: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Forecast:
    """The prediction by the twins of a detector: figures by name, errors as kind → cause → number, and the figures of each twin.

    Intervals are 95 % prediction intervals of one more run.
    """

    figures: Mapping[str, Interval]
    causes: Mapping[str, Mapping[str, Interval]]
    runs: tuple[Mapping[str, float], ...]

    @staticmethod
    def of(runs: Sequence[Outcome]) -> Forecast:
        """The forecast from the outcomes of at least one twin."""
        figures = {name: one_more_interval([one.figures[name] for one in runs], bounds_of(name)) for name in FIGURES}
        causes = {
            kind: {cause: one_more_interval([one.causes[kind][cause] for one in runs], AT_LEAST_ZERO) for cause in of}
            for kind, of in runs[0].causes.items()
        }
        return Forecast(figures, causes, tuple(one.figures for one in runs))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        causes = {kind: {cause: _ends(value) for cause, value in of.items()} for kind, of in self.causes.items()}
        return {"figures": {name: _ends(value) for name, value in self.figures.items()}, "causes": causes, "runs": list(self.runs)}


def _ends(value: Interval) -> dict[str, float | None]:
    return {"mean": value.mean, "low": value.low, "high": value.high}


@dataclass(frozen=True)
class Prediction:
    """Forecasts by detector, and the real outcome, None without real boxes.

    frames: of the twins. fit_frames: of the fit, None without a fit. people: number of true persons in the twins.
    truth_errors: errors of the truth that all views share (SharedErrors as JSON values), None where unknown.
    """

    forecasts: Mapping[str, Forecast]
    real: Outcome | None
    fit_frames: Frames | None
    frames: Frames
    people: int
    cameras: tuple[str, ...]
    truth_errors: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "fit_frames": self.fit_frames and list(self.fit_frames),
            "frames": list(self.frames),
            "people": self.people,
            "cameras": list(self.cameras),
            "truth_errors": self.truth_errors,
            "real": self.real and vars(self.real),
            "predicted": {name: one.to_dict() for name, one in self.forecasts.items()},
        }

    def counts(self, kind: str) -> dict[str, list[float]]:
        """Cause → mean number by each detector, then the real number. Causes that never occur are left out."""
        every = [{cause: value.mean for cause, value in of.causes.get(kind, {}).items()} for of in self.forecasts.values()]
        every += [dict(self.real.causes.get(kind, {}))] if self.real else []
        out = {cause: [_finite(of.get(cause, 0.0)) for of in every] for cause in dict.fromkeys(cause for of in every for cause in of)}
        return {cause: numbers for cause, numbers in out.items() if any(numbers)}

    def head(self, first: str) -> Cells:
        """Titles of the columns of a table."""
        return first, *self.forecasts, *([REAL] if self.real else [])

    def score_lines(self) -> list[Cells]:
        """A line for each figure: its mean and interval for each detector, then the real value."""
        out = []
        for key, label, digits in (*SCORES, *ERRORS, *OTHERS):
            real = [number_text(self.real.figures.get(key, math.nan), 0 if digits == 1 else digits)] if self.real else []
            out.append((label, *(interval_text(of.figures.get(key), digits) for of in self.forecasts.values()), *real))
        return out

    def cause_lines(self) -> list[Cells]:
        """A line for each cause of errors that occurs."""
        out = []
        for kind in KINDS:
            for cause, numbers in self.counts(kind).items():
                cells = (interval_text(of.causes.get(kind, {}).get(cause), 1) for of in self.forecasts.values())
                out.append((f"{kind}: {cause}", *cells, *([f"{numbers[-1]:.0f}"] if self.real else [])))
        return out


@dataclass(frozen=True)
class PredictionRecord:
    """A prediction with its provenance: the source, the tracker and its options, seeds of the twins, the command line, and versions by part."""

    source: str
    tracker: str
    options: Mapping[str, Any]
    seeds: tuple[int, ...]
    command: str
    versions: Mapping[str, str]
    found: Prediction

    def to_dict(self) -> dict[str, Any]:
        """The file as JSON values."""
        about = {"schema": SCHEMA, "source": self.source, "tracker": {"name": self.tracker, "options": self.options}, "seeds": list(self.seeds)}
        return about | {"command": self.command, "versions": dict(self.versions)} | self.found.to_dict()


def read_prediction(path: Path) -> PredictionRecord:
    """Read the file of a prediction. Raises ValueError naming file and field for another or a damaged file."""
    file = JsonObject(read_json(path), str(path))
    file.check_schema(SCHEMA, ", as `pilsim predict --out` writes it")
    tracker, twins = file.part("tracker"), file.part("predicted")
    forecasts = {name: _forecast(twins.part(name)) for name in twins.values}
    if not forecasts:
        raise ValueError(f"{path}: predicted is empty, needs at least one detector")
    real = None
    if file.values.get("real") is not None:
        of = file.part("real")
        real = Outcome(of.part("figures").numbers(), {kind: of.part("causes").part(kind).numbers() for kind in KINDS})
    frames = {name: _frames(file, name) for name in ("frames", "fit_frames") if name == "frames" or file.values.get(name) is not None}
    found = Prediction(
        forecasts, real, frames.get("fit_frames"), frames["frames"], file.a("people", int), tuple(map(str, file.a("cameras", list))),
        file.maybe("truth_errors", dict),
    )  # fmt: skip
    return PredictionRecord(
        source=file.a("source", str),
        tracker=tracker.a("name", str),
        options=tracker.part("options").values,
        seeds=tuple(file.integers("seeds")),
        command=file.a("command", str),
        versions={name: str(version) for name, version in file.part("versions").values.items()},
        found=found,
    )


def _frames(file: JsonObject, name: str) -> Frames:
    first, end = file.integers(name, 2)
    return first, end


def _forecast(twins: JsonObject) -> Forecast:
    runs = tuple(JsonObject(run, f"{twins.where}: runs[{k}]").numbers() for k, run in enumerate(twins.a("runs", list)))
    figures, causes = twins.part("figures"), twins.part("causes")
    return Forecast(_intervals(figures, len(runs)), {kind: _intervals(causes.part(kind), len(runs)) for kind in KINDS}, runs)


def _intervals(of: JsonObject, count: int) -> dict[str, Interval]:
    found = {name: of.part(name).numbers() for name in of.values}
    return {name: Interval(one.get("mean", math.nan), one.get("low"), one.get("high"), count) for name, one in found.items()}


def interval_text(value: Interval | None, digits: int) -> str:
    """A mean with its interval; a dash where it is not known."""
    return "–" if value is None or not math.isfinite(value.mean) else value.text(digits)


def number_text(value: float, digits: int) -> str:
    """A number; a dash where it is not known."""
    return f"{value:.{digits}f}".replace("-", "−") if math.isfinite(value) else "–"


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


@dataclass(frozen=True, eq=False)
class Halves:
    """A recording in two parts, each with its frames: `fitted` (None without a fit), and `tried`. real: whether `tried` has real boxes."""

    fitted: Source | None
    tried: Source
    fit_frames: Frames | None
    try_frames: Frames
    real: bool


@dataclass(frozen=True, eq=False)
class FittedViews:
    """Detector models, camera → model, and the errors of the truth that the views share, None where unknown."""

    models: Mapping[str, Model]
    shared: SharedErrors | None = None


def open_halves(path: Path, options: SourceOptions, fit_frames: tuple[int, int | None] | None = None, fitted: bool = True) -> Halves:
    """Open a recording with truth in two parts.

    fit_frames: first frame and end of the fit, None for the first half. An end of None is the end of the recording.
    The frames after the fit are tried, or those before it where fewer than LEAST_FRAMES follow.
    fitted: False leaves the fit out, and all frames are tried.
    Raises ValueError, with the path, for a recording without truth, for cameras on robots, and for parts with fewer than LEAST_FRAMES.
    """
    whole = open_recording(path, options).in_step()
    say_suspicion(path, whole)
    if moving := [name for name, camera in whole.cameras.items() if camera.robot is not None]:
        raise ValueError(f"{path}: camera {moving[0]} is on a robot, needs cameras that stand still; --cameras chooses some")
    first = options.frames[0] if options.frames is not None else 0
    total, real = whole.frames, bool(whole.detections)
    if not fitted:
        return Halves(None, _source(path, whole), None, (first, first + total), real)
    if not real:
        raise ValueError(f"{path}: has no detections, which a fit needs; --detector-model names a detector to predict with")
    begin, end = (0, total // 2) if fit_frames is None else (fit_frames[0] - first, min((fit_frames[1] or first + total) - first, total))
    rest = (end, total) if total - end >= LEAST_FRAMES else (0, begin)
    for name, part in (("--fit", (begin, end)), ("the part that is tried", rest)):
        if part[0] < 0 or part[1] - part[0] < LEAST_FRAMES:
            shown = f"{part[0] + first}:{part[1] + first}"
            raise ValueError(f"{path}: {name} is {shown}, needs at least {LEAST_FRAMES} of frames {first} to {first + total - 1}, and as many left")
    opened = []
    for low, high in ((begin, end), rest):
        source = {**whole.source, "frames": [first + low, first + high]}
        opened.append(_source(path, replace(whole.cut(low, high), source=source)))
    return Halves(opened[0], opened[1], (first + begin, first + end), (first + rest[0], first + rest[1]), real)


def _source(path: Path, recording: Recording) -> Source:
    names = list(recording.detections) or list(recording.cameras)
    truth = true_people(path, recording, names)
    if recording.truth is None or not any(len(ids) for ids, _ in truth.places.values()):
        raise ValueError(f"{path}: no person is in the truth of frames {recording.source.get('frames', 'of the source')}, which a prediction needs")
    return Source(recording, truth, {})


def fit_views(source: Source, path: Path) -> FittedViews:
    """A detector model of each view, and the errors of the truth that views share.

    A view with too little truth has the model of all views together.
    Raises ValueError, with the path, where all views together have too little truth.
    """
    made = {"frames": list(source.recording.source.get("frames", [0, source.recording.frames]))}
    truth, errors = agreed(source.recording, source.truth)
    source = replace(source, truth=truth)
    kind, out, common = source.truth.kind, dict[str, Model](), None
    for name in source.recording.detections:
        alone = replace(source, recording=source.recording.choose([name]))
        try:
            out[name] = fit_view(alone, name, made | {"cameras": [name]})
        except ValueError:
            try:
                common = common or fit(source.samples(), "all views", kind, made, replicates=0)
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from None
            out[name] = at_its_places(common, alone.samples())
    return FittedViews(out, errors)


def twin(source: Source, views: FittedViews, seed: int) -> Recording:
    """The recording with simulated boxes in place of its own, without rendering. The same seed gives the same boxes.

    People walk their true paths, moved by the errors of the truth that all views share.
    Their bodies are the true boxes where these are known, and cylinders of one size elsewhere.
    Bodies occlude each other, and pillars occlude them.
    """
    recording = source.recording
    truth = source.truth if views.shared is None else drawn(recording, source.truth, views.shared, seed)
    return replace(recording, detections=simulated_detections(recording, truth, views.models, seed, list(views.models)))


def outcome(recording: Recording, tracker: TrackerUnderTest, run: str) -> Outcome:
    """Track a recording with truth and score it as `pilsim score` does. run: NAME/SEED, the name under which tracks made elsewhere are looked up."""
    sequence = recording.sequence()
    assert sequence.truth is not None
    return _tracked(sequence.setup, list(sequence.ticks)[: len(sequence.truth)], sequence.truth, (tracker, run))


def _tracked(setup: Setup, ticks: list[Tick], truth: tuple[Truth, ...], by: tuple[TrackerUnderTest, str]) -> Outcome:
    """Track ticks and score them. by: the tracker, and the name of the run."""
    tracker, run = by
    results = tracker.results_of(setup, ticks, run)
    case = Case("prediction", "prediction", "seed", run, default_scenario(), source=RECORDED)
    data = TrialData(case, setup, ticks, truth, [{} for _ in ticks], setup, ticks, {})
    found: dict[str, Any] = score(data.matching_frames(results)).to_dict()
    figures = {name: float("nan") if found[name] is None else float(found[name]) for name in FIGURES}
    return Outcome(figures, count_causes(find_mistakes(gather_evidence(data, results))))


@dataclass(frozen=True)
class PredictionPlan:
    """What is predicted.

    path, options: the recording. fit_frames: of the fit, None for the first half. detectors: name shown → FITTED, INDEPENDENT, or a model as
    `chosen_model` gives it. The first detector is the prediction. seeds: of the twins.
    place: a simulated place with people, cameras and robots in place of the recording; each seed has other paths. It excludes FITTED.
    """

    path: Path
    options: SourceOptions
    tracker: TrackerUnderTest
    detectors: Mapping[str, str] = field(default_factory=lambda: {FITTED: FITTED})
    fit_frames: tuple[int, int | None] | None = None
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
    calls = list[tuple[Source, FittedViews | None, TrackerUnderTest, int]]()
    errors: dict[str, Any] | None = None
    for choice in plan.detectors.values():
        models = _models(choice, halves, plan.path)
        errors = errors or (None if models.shared is None else models.shared.to_dict())
        calls += [(halves.tried, models, plan.tracker, seed) for seed in plan.seeds]
    if halves.real:
        calls.append((halves.tried, None, plan.tracker, 0))
    found = _run(_outcome, calls, pool, progress)
    persons = {int(person) for ids, _ in (halves.tried.recording.truth or {}).values() for person in ids}
    cameras = tuple(halves.tried.recording.detections) or tuple(halves.tried.recording.cameras)
    return Prediction(
        _forecasts(plan, found), found[-1] if halves.real else None, halves.fit_frames, halves.try_frames, len(persons), cameras, errors
    )


def _predict_place(plan: PredictionPlan, place: Preset, pool: Pool | None, progress: Progress | None) -> Prediction:
    calls = [(place, choice, plan.tracker, seed) for choice in plan.detectors.values() for seed in plan.seeds]
    found = _run(_place_outcome, calls, pool, progress)
    forecasts = _forecasts(plan, [one for one, _ in found])
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


def _forecasts(plan: PredictionPlan, found: list[Outcome]) -> dict[str, Forecast]:
    """Forecasts by detector. found: outcomes of all seeds of the first detector, then of the next one."""
    n = len(plan.seeds)
    return {name: Forecast.of(found[k * n : (k + 1) * n]) for k, name in enumerate(plan.detectors)}


def _models(choice: str, halves: Halves, path: Path) -> FittedViews:
    if choice == FITTED:
        assert halves.fitted is not None
        return fit_views(halves.fitted, path)
    recording = halves.tried.recording
    return FittedViews(dict.fromkeys(list(recording.detections) or list(recording.cameras), model_of(choice)))


def _outcome(source: Source, views: FittedViews | None, tracker: TrackerUnderTest, seed: int) -> Outcome:
    """One run of a twin, or of the real boxes where `views` is None. It may run in another process."""
    if views is None:
        return outcome(source.recording, tracker, f"real/{seed}")
    return outcome(twin(source, views, seed), tracker, f"twin/{seed}")
