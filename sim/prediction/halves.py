"""The two parts of a recording: one for the fit of detector models, one on which the tracker is tried, and predicted by twins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from sim.prediction.prediction import Frames
from tracker.detector_models.fit import fit
from tracker.detector_models.fitting import Source, at_its_places, fit_view
from tracker.detector_models.model import Model
from tracker.detector_models.observations import true_people
from tracker.detector_models.shared_errors import SharedErrors, agreed, drawn
from tracker.detector_models.simulation import simulated_detections
from tracker.formats.opening import open_recording, say_suspicion
from tracker.formats.source_options import SourceOptions
from tracker.recordings import Recording

LEAST_FRAMES = 2
"""Of each part."""


@dataclass(frozen=True, eq=False)
class Halves:
    """A recording in two parts: fitted, None without a fit, and tried, each with its frames. The boxes of `tried` are real where `real` is true."""

    fitted: Source | None
    tried: Source
    fit_frames: Frames | None
    try_frames: Frames
    real: bool


@dataclass(frozen=True, eq=False)
class FittedViews:
    """Detector models, camera → model, and the errors of the truth that the views share, None where these are not known."""

    models: Mapping[str, Model]
    shared: SharedErrors | None = None


def parse_frames(text: str, option: str) -> Frames:
    """Parse A:B, frames counted from 0, B left out of them. Raises ValueError that names the option."""
    first, colon, end = text.partition(":")
    try:
        frames = int(first or 0), int(end)
    except ValueError:
        frames = -1, -1
    if not colon or not 0 <= frames[0] < frames[1]:
        raise ValueError(f"{option} is {text!r}, needs FIRST:END as in 0:130, counted from 0, END left out of them")
    return frames


def open_halves(path: Path, options: SourceOptions, fit_frames: Frames | None = None, fitted: bool = True) -> Halves:
    """Open a recording with truth in two parts.

    fit_frames: of the fit, None for the first half; what follows is tried, or what comes before where nothing follows.
    fitted: False leaves the fit out, and all frames are tried.
    Raises ValueError, with the path, for a recording without truth, for cameras on robots, and for parts that are not there.
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
    begin, end = (0, total // 2) if fit_frames is None else (fit_frames[0] - first, min(fit_frames[1] - first, total))
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
    They hide each other, and pillars hide them.
    """
    recording = source.recording
    truth = source.truth if views.shared is None else drawn(recording, source.truth, views.shared, seed)
    return replace(recording, detections=simulated_detections(recording, truth, views.models, seed, list(views.models)))
