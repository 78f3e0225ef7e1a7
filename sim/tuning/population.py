"""The population: synthetic cases, each a recording in memory with exact truth. A case is drawn once and kept on disk.

A case depends on the seed and on its number alone. Nothing is rendered: bodies are cylinders, occluded by each other, by furniture and by walls.
A random detector model makes boxes of the visible bodies (detectors.py). Calibration and clocks that the tracker gets have errors.
Cases of a user's cameras have people on simulated paths. Their detectors are fitted to the user's recording, or random.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim.prediction import fit_views
from sim.tuning.case_file import PopulationCase, case_path, read_case, rows_of, true_robot, write_case
from sim.tuning.detectors import BODY_WIDTH, CameraErrors, DrawnDetector, drawn_detector
from sim.tuning.kinds import BLOCK, CaseScene, rover_camera, rover_poses, scene
from sim.tuning.look_alikes import LookAlikes, LookAlikesInView
from sim.tuning.walks import STEPS, Habits, Surroundings, Walkers, Walks, floor, reached, walks
from tracker.detector_models.bodies import Place, TrueBodies, bodies_in_view
from tracker.detector_models.fitting import Source
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import true_people
from tracker.detector_models.sampler import ViewSampler
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Grid
from tracker.io.json_files import json_text
from tracker.io.resume import json_value
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.camera_json import camera_to

KIND = "yours"
MARGIN = 0.3
"""m by which the area extends beyond true positions, where the recording names no area."""
SEEN_WITHIN = 20.0
"""m: largest distance of the area from a camera, where neither area nor truth is known."""
NUMBERS = (0.6, 1.4)
"""Bounds of the number of people of a case, relative to that of the recording."""
DELAY = 1.3
"""s by which estimates may be late."""
STATURE, STATURES = (1.72, 0.09), (1.5, 2.0)
"""m: mean and standard deviation, and bounds, of statures."""
SITTING = 0.74
"""Height of a sitting person, as a share of the stature."""
LEVELS, SIDES = (0.1, 0.3, 0.5, 0.7, 0.9), (-0.6, 0.0, 0.6)
"""Sample points of a body that may be occluded: shares of its height, and of its half width."""
MOST_RATE = 10.0
"""Hz: cases of a user's cameras have every n-th frame of faster recordings, so that the frames of a case last for some seconds."""
Progress = Callable[..., Iterable[Any]]


@dataclass(frozen=True, eq=False)
class UserCameras:
    """Cameras of a user: name, recording without boxes and truth, area (2, 2) m, people at once, and fitted models, () where they are drawn."""

    name: str
    recording: Recording
    area: Array
    people: int
    models: tuple[DetectorModel, ...] = ()

    @cached_property
    def key(self) -> str:
        """A checksum of all that the cases depend on."""
        recording = self.recording
        cameras = {name: camera_to(camera) for name, camera in recording.cameras.items()}
        ground = vars(recording.ground) if isinstance(recording.ground, Grid) else {}
        content = [cameras, recording.rate, ground, recording.height, recording.pillars, self.area, self.people, self.models]
        return hashlib.sha256(json_text(json_value(content)).encode()).hexdigest()[:8]


def open_cameras(path: Path, options: SourceOptions, people: int | None) -> UserCameras:
    """The cameras of a recording. people: at once; None for the mean of its truth.

    Models are fitted where there are boxes and truth. Raises ValueError, in one line with the path, for cameras on robots and too little truth.
    It also raises it for a number of people that is missing or out of bounds.
    """
    recording = open_recording(path, options).in_step()
    recording.check_calibrated()
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
    """Case `number` of the user's cameras, from its file or drawn. Raises ValueError as `population`."""
    return kept_case(case_path(folder, number, seed, user.key), (number, seed), lambda number, seed: _drawn(number, seed, user))


def _drawn(number: int, seed: int, user: UserCameras) -> PopulationCase:
    rng, recording = np.random.default_rng([seed, number, 3]), user.recording
    around = floor(user.area, recording.pillars, int(rng.integers(1, 5)), rng, recording.ground)
    at_once = max(1, round(user.people * float(rng.uniform(*NUMBERS))))
    habits = Habits(rng.uniform(0.1, 0.7), 0.0, rng.uniform(0.0, 0.1), rng.uniform(3.0, 15.0), rng.uniform(0.7, 1.3), (0.35, 0.9))
    people = at_once + int(rng.integers(0, at_once + 1))
    rate = recording.rate / max(1, math.ceil(recording.rate / MOST_RATE))
    made = CaseScene(around, at_once, people, habits, list(recording.cameras.values()), 0, rate)
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


def population(number: int, seed: int, folder: Path, first: int = 0, progress: Progress | None = None) -> list[PopulationCase]:
    """Cases `first` to `first` + number − 1 of a seed; those that `folder` lacks are drawn and kept there.

    progress: wraps the iteration over cases. Raises ValueError, in one line, for a file that is no case of this version and seed.
    """
    numbers = range(first, first + number)
    return [population_case(k, seed, folder) for k in (numbers if progress is None else progress(numbers, total=number))]


def population_case(number: int, seed: int, folder: Path) -> PopulationCase:
    """A case of the population, from its file or drawn. Raises ValueError as `population`."""
    return kept_case(case_path(folder, number, seed), (number, seed), drawn_case)


def kept_case(path: Path, key: tuple[int, int], draw: Callable[[int, int], PopulationCase]) -> PopulationCase:
    """A case from its file, or as `draw` draws it of key, its number and seed. Raises ValueError as `population`."""
    number, seed = key
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_case(path, draw(number, seed))
    # The file rounds numbers, so a drawn case is read back, too.
    found = read_case(path)
    if (found.number, found.seed) != (number, seed):
        raise ValueError(f"{path}: is case {found.number} of seed {found.seed}, needs case {number} of seed {seed}")
    return found


def kind_of(number: int, seed: int) -> str:
    """The kind of a case. Each block of 20 consecutive cases has the kinds of BLOCK in random order."""
    block, place = divmod(number, len(BLOCK))
    return str(np.random.default_rng([seed, block, 1]).permutation(BLOCK)[place])


def drawn_case(number: int, seed: int) -> PopulationCase:
    """The case, drawn anew."""
    kind = kind_of(number, seed)
    return case_of(PopulationKey(number, seed, kind), scene(kind, np.random.default_rng([seed, number, 2, 0])))


class PopulationKey(NamedTuple):
    """The values that determine a case: number, seed and kind."""

    number: int
    seed: int
    kind: str


def case_of(key: PopulationKey, made: CaseScene, fitted: Sequence[DrawnDetector] = ()) -> PopulationCase:
    """The case of a scene. fitted: a detector for each camera, in place of one that is drawn for all."""
    streams = [np.random.default_rng([key.seed, key.number, 2, k]) for k in range(1, 5)]
    walkers = Walkers.of(made.around, made.habits, (made.at_once, made.people, made.rovers), made.frames / made.rate, streams[0])
    walked = walks(walkers, made.frames, 1 / made.rate)
    diagonal = float(np.linalg.norm(made.around.area[1] - made.around.area[0]))
    detectors = fitted or [drawn_detector(diagonal, streams[1])] * (len(made.cameras) + made.rovers)
    things = LookAlikes.drawn(made.around, streams[3]) if not fitted else LookAlikes.none()
    recording = recorded(made, walked, detectors, things, streams[2])
    return PopulationCase(*key, recording, max(2, round(DELAY * made.rate)))


@dataclass(frozen=True, eq=False)
class PeopleAtStep:
    """The people at a step: ids (n,) from 1, feet (n, 3) m, heights by id, m."""

    ids: Ints
    feet: Array
    heights: dict[int, float]

    def joined(self, other: PeopleAtStep) -> PeopleAtStep:
        """The people of both, which have no id in common."""
        return PeopleAtStep(np.concatenate([self.ids, other.ids]), np.concatenate([self.feet, other.feet]), self.heights | other.heights)


def _standing(seen: LookAlikesInView, around: Surroundings) -> PeopleAtStep:
    """Things as if they were people, whose ids follow those of people."""
    ids, place = seen.people + 1 + np.arange(len(seen.things)), seen.things.place
    heights = dict(zip(ids.tolist(), seen.things.height.tolist(), strict=True))
    return PeopleAtStep(ids, np.column_stack([place, around.ground.height_at(place)]), heights)


class _Crowd:
    """People by step of their walks."""

    def __init__(self, made: CaseScene, walked: Walks, rng: np.random.Generator) -> None:
        self._place, self._sits, self._ground = walked.place[:, : made.people], walked.sits, made.around.ground
        self._stature = np.clip(rng.normal(*STATURE, made.people), *STATURES)

    def at(self, step: int) -> PeopleAtStep:
        rows = np.flatnonzero(np.isfinite(self._place[step]).all(axis=1))
        feet = np.column_stack([self._place[step, rows], self._ground.height_at(self._place[step, rows])])
        tall = self._stature[rows] * np.where(self._sits[step, rows], SITTING, 1.0)
        return PeopleAtStep(rows + 1, feet, dict(zip((rows + 1).tolist(), tall.tolist(), strict=True)))


def recorded(made: CaseScene, walked: Walks, detectors: Sequence[DrawnDetector], things: LookAlikes, rng: np.random.Generator) -> Recording:
    """The recording of a scene: boxes by a detector for each camera, and the calibration that the tracker gets."""
    ids = range(1, made.people + len(things) + 1)
    crowd, names = _Crowd(made, walked, rng), [f"C{k}" for k in range(1, len(made.cameras) + made.rovers + 1)]
    robots = {f"r{k}": rover_poses(walked.place[:, made.people + k], made.around) for k in range(made.rovers)}
    true = dict(zip(names, [*made.cameras, *(rover_camera(robot, rng) for robot in robots)], strict=True))
    scale = float(rng.choice([0.0, rng.uniform(0.3, 1.0), rng.uniform(1.0, 2.0)], p=[0.2, 0.6, 0.2]))
    seen, detections, told = dict[int, Array](), dict[str, dict[int, tuple[Array, Array]]](), dict[str, RecordingCamera]()
    for (name, camera), detector in zip(true.items(), detectors, strict=True):
        errors = CameraErrors.drawn(scale, rng)
        told[name] = replace(camera, pose=camera.pose @ errors.pose)
        alike = LookAlikesInView(things, made.people, 1 / made.rate, len(told))
        view = _View(made.around, camera.camera, detector, ViewSampler(detector.model, camera.camera, 1 / made.rate, ids, rng), alike)
        detections[name] = {}
        for frame in range(made.frames):
            step = STEPS * frame + STEPS // 2
            late = step + errors.late
            pose = camera.pose if camera.robot is None else robots[camera.robot][late] @ camera.pose
            people = crowd.at(late)
            boxes, confidence, visible = view.boxes(pose, people)
            detections[name][frame] = boxes, confidence
            share = np.array([visible.get(int(one), 0.0) for one in crowd.at(step).ids])
            seen[frame] = np.maximum(seen.get(frame, np.zeros(len(share))), share)
    truth = {frame: (now.ids, now.feet) for frame in range(made.frames) for now in [crowd.at(STEPS * frame + STEPS // 2)]}
    around, knows = made.around, rng.random() < 0.5
    return Recording(
        made.rate,
        told,
        detections,
        truth,
        frames=made.frames,
        area=around.area,
        ground=around.ground,
        occluders=around.occluders if knows else None,
        pillars=around.pillars if knows else np.zeros((0, 5)),
        robots={name: true_robot(rows_of(poses[STEPS // 2 :: STEPS][: made.frames])) for name, poses in robots.items()},
        visible=seen,
        source={"source": "population"},
    )


class _View:
    """The boxes of a camera, frame by frame."""

    def __init__(self, around: Surroundings, camera: Camera, detector: DrawnDetector, sampler: ViewSampler, things: LookAlikesInView) -> None:
        self._around, self._camera, self._detector, self._sampler, self._things = around, camera, detector, sampler, things
        self._standing = _standing(things, around)

    def boxes(self, pose: Pose, people: PeopleAtStep) -> tuple[Array, Array, dict[int, float]]:
        """Boxes (n, 4) px, confidences (n,), and the visible share by person."""
        people = people.joined(self._standing)
        # The nearest point of the cylinder's foot is the lower edge of its box.
        toward = pose.translation[:2] - people.feet[:, :2]
        toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-6)
        feet = people.feet + (self._detector.feet_bias - BODY_WIDTH / 2) * np.column_stack([toward, np.zeros(len(toward))])
        bodies = bodies_in_view((self._camera, pose), people.ids, feet, self._around.pillars, None, people.heights)
        if self._around.occluders is not None and len(bodies.person):
            bodies = self._hidden(bodies, pose, people)
        ground = float(self._around.ground.height_at(pose.translation[None])[0])
        found, scale = self._things.weakened(self._sampler.step(bodies, Place(pose, ground))), self._detector.scale
        kept = scale.kept(found.confidence)
        visible = dict(zip(bodies.person.tolist(), bodies.visible.tolist(), strict=True))
        return found.boxes[kept], scale.said(found.confidence[kept]), visible

    def _hidden(self, bodies: TrueBodies, pose: Pose, people: PeopleAtStep) -> TrueBodies:
        """Bodies without the parts that the height map hides. The visible part of a body begins above them."""
        assert self._around.occluders is not None
        row = {person: k for k, person in enumerate(people.ids.tolist())}
        feet = people.feet[[row[person] for person in bodies.person.tolist()]]
        tall = np.array([people.heights[person] for person in bodies.person.tolist()])
        away = feet[:, :2] - pose.translation[:2]
        across = np.column_stack([-away[:, 1], away[:, 0]]) / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-6)
        points = np.array([[feet + np.column_stack([side * BODY_WIDTH / 2 * across, level * tall]) for side in SIDES] for level in LEVELS])
        free = reached(self._around.occluders, pose.translation, points.reshape(-1, 3)).reshape(len(LEVELS), len(SIDES), -1)
        lowest = np.where(free.any(axis=(0, 1)), np.argmax(free.any(axis=1), axis=0), len(LEVELS))
        bottom = bodies.whole[:, 3] - np.where(lowest > 0, (lowest / len(LEVELS)), 0.0) * bodies.height
        seen = bodies.seen.copy()
        seen[:, 3] = np.clip(bottom, seen[:, 1], seen[:, 3])
        visible = bodies.visible * free.mean(axis=(0, 1))
        seen[visible <= 0] = 0.0
        return replace(bodies, seen=seen, visible=visible)
