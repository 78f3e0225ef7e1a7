"""Cases of the user's cameras: people on simulated paths before them, seen by detectors that are fitted to their recording, or drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.prediction.predict import fit_views
from sim.tuning.case_file import PopulationCase
from sim.tuning.detectors import DrawnDetector
from sim.tuning.kinds import CaseScene
from sim.tuning.population import PopulationKey, case_of, kept_case
from sim.tuning.walks import Habits, floor
from tracker.detector_models.fitting import Source
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import true_people
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.recordings import Recording

KIND = "yours"
MARGIN = 0.3
"""m by which the area reaches beyond true places, where the recording names no area."""
SEEN_WITHIN = 20.0
"""m: farthest ground before a camera that belongs to the area, where neither area nor truth is known."""
NUMBERS = (0.6, 1.4)
"""Bounds of the number of people of a case, over that of the recording."""


@dataclass(frozen=True, eq=False)
class UserCameras:
    """Cameras of a user: name, recording without boxes and truth, area (2, 2) m, people at once, and fitted models, () where they are drawn."""

    name: str
    recording: Recording
    area: Array
    people: int
    models: tuple[DetectorModel, ...] = ()


def open_cameras(path: Path, options: SourceOptions, people: int | None) -> UserCameras:
    """The cameras of a recording. people: at once; None for the mean of its truth.

    Models are fitted where there are boxes and truth. Raises ValueError, in one line with the path, for cameras on robots and too little truth.
    It also raises it for a number of people that is missing or out of bounds.
    """
    recording = open_recording(path, options)
    if moving := [name for name, camera in recording.cameras.items() if camera.robot is not None]:
        raise ValueError(f"{path}: camera {moving[0]} is on a robot, needs cameras that stand still; --cameras chooses some")
    known = [feet for _, feet in (recording.truth or {}).values() if len(feet)]
    if people is None and not known:
        raise ValueError(f"{path}: has no truth, needs the number of people at once: --people")
    count = people if people is not None else max(1, round(float(np.mean([len(feet) for feet in known]))))
    if not 1 <= count <= 100:
        raise ValueError(f"--people is {count}, needs 1 to 100")
    models: tuple[DetectorModel, ...] = ()
    if known and recording.detections:
        recording = recording.choose(recording.detections)
        views = fit_views(Source(recording, true_people(path, recording), {}), path)
        models = tuple(model for name in recording.cameras if isinstance(model := views.models[name], DetectorModel))
    bare = Recording(recording.rate, recording.cameras, frames=1, ground=recording.ground, height=recording.height, pillars=recording.pillars)
    name = f"{path.resolve().name}, {count} people, {', '.join(recording.cameras)}"
    return UserCameras(name, bare, _area(path, recording, known), count, models)


def user_case(number: int, seed: int, folder: Path, user: UserCameras) -> PopulationCase:
    """Case `number` of the user's cameras, from its file or drawn. Raises ValueError as population.population."""
    return kept_case(folder, number, seed, lambda number, seed: _drawn(number, seed, user))


def _drawn(number: int, seed: int, user: UserCameras) -> PopulationCase:
    rng, recording = np.random.default_rng([seed, number, 3]), user.recording
    around = floor(user.area, recording.pillars, int(rng.integers(1, 5)), rng, recording.ground)
    at_once = max(1, round(user.people * float(rng.uniform(*NUMBERS))))
    habits = Habits(rng.uniform(0.1, 0.7), 0.0, rng.uniform(0.0, 0.1), rng.uniform(3.0, 15.0), rng.uniform(0.7, 1.3), (0.35, 0.9))
    people = at_once + int(rng.integers(0, at_once + 1))
    made = CaseScene(around, at_once, people, habits, list(recording.cameras.values()), 0, recording.rate)
    return case_of(PopulationKey(number, seed, KIND), made, [DrawnDetector.fitted(model) for model in user.models])


def _area(path: Path, recording: Recording, known: Sequence[Array]) -> Array:
    """Lowest and highest x, y m (2, 2) where people walk: of the recording, of its true places, or of the ground that two cameras see."""
    if recording.area is not None:
        return np.asarray(recording.area, dtype=np.float64)
    if known:
        places = np.concatenate(known)[:, :2]
        return np.array([places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN])
    eyes = np.array([camera.pose.translation for camera in recording.cameras.values()])
    low, high = eyes[:, :2].min(axis=0) - SEEN_WITHIN, eyes[:, :2].max(axis=0) + SEEN_WITHIN
    places = np.stack(np.meshgrid(*(np.arange(a, b, 0.5) for a, b in zip(low, high, strict=True))), axis=-1).reshape(-1, 2)
    chests = np.column_stack([places, recording.ground.height_at(places) + 1.0])
    views = np.zeros(len(chests), dtype=np.int64)
    for camera in recording.cameras.values():
        away = camera.pose.inverse().apply(chests)
        distance = np.linalg.norm(away, axis=1)
        pixels, inside = camera.camera.pixels_from_bearings(away / np.maximum(distance, 1e-6)[:, None])
        views += inside & np.isfinite(pixels).all(axis=1) & (distance < SEEN_WITHIN)
    seen = places[views >= min(2, len(eyes))]
    if not len(seen) or (np.ptp(seen, axis=0) < 2.0).any():
        raise ValueError(f"{path}: no ground of 2 m is seen by {'two cameras' if len(eyes) > 1 else 'the camera'}, needs `area` in recording.json")
    return np.array([seen.min(axis=0), seen.max(axis=0)])
