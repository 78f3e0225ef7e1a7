"""Simulated detections of a recording: boxes of its true people by a detector model, in place of its own boxes."""

from __future__ import annotations

from collections.abc import Mapping

from tracker.detector_models.bodies import Place, bodies_in_view
from tracker.detector_models.independent import IndependentErrors, IndependentSampler
from tracker.detector_models.model import Model
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.sampler import ViewSampler
from tracker.geometry import Array
from tracker.recordings import Recording
from tracker.recordings.degradation import stream

Simulated = dict[str, dict[int, tuple[Array, Array]]]


def simulated_detections(
    recording: Recording, truth: TruePeople, model: Model | Mapping[str, Model], seed: int, cameras: list[str] | None = None
) -> Simulated:
    """Camera → frame → boxes (n, 4) left, top, width, height px and confidences (n,), in all frames with truth.

    model: of all cameras, or of each by its name. cameras: names, None for all with detections.
    Each has a random stream of its own, by its name and `seed`.
    """
    persons = sorted({int(person) for ids, _ in truth.places.values() for person in ids})
    names = list(recording.detections) if cameras is None else cameras
    models = model if isinstance(model, Mapping) else dict.fromkeys(names, model)
    return {name: _view(recording, truth, models[name], name, (persons, seed)) for name in names}


def _view(recording: Recording, truth: TruePeople, model: Model, name: str, run: tuple[list[int], int]) -> dict[int, tuple[Array, Array]]:
    persons, seed = run
    camera, known, rng = recording.cameras[name], truth.boxes.get(name, {}), stream(seed, name)
    sampler: IndependentSampler | ViewSampler
    if isinstance(model, IndependentErrors):
        sampler = IndependentSampler(model, camera.camera, rng)
    else:
        sampler = ViewSampler(model, camera.camera, 1 / recording.rate, persons, rng)
    out = {}
    for frame, (person, feet) in sorted(truth.places.items()):
        pose = recording.pose_at(camera, frame)
        if pose is None or not 0 <= frame < recording.frames:
            continue
        ground = float(recording.ground.height_at(pose.translation[None])[0])
        bodies = bodies_in_view((camera.camera, pose), person, feet, recording.pillars, known.get(frame), truth.heights)
        made = sampler.step(bodies, Place(pose, ground))
        out[frame] = made.boxes, made.confidence
    return out
