"""Simulated detections of a recording: its true people seen by a detector model, in place of its own boxes."""

from __future__ import annotations

import zlib

import numpy as np

from tracker.datasets.projected_boxes import pose_at
from tracker.detector_models.bodies import bodies_in_view
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.sampler import Place, ViewSampler
from tracker.geometry import Array
from tracker.recordings import Recording

Simulated = dict[str, dict[int, tuple[Array, Array]]]


def simulated_detections(recording: Recording, truth: TruePeople, model: DetectorModel, seed: int, cameras: list[str] | None = None) -> Simulated:
    """Camera → frame → boxes (n, 4) left, top, width, height px and confidences (n,), in all frames with truth.

    cameras: names, None for all with detections. Each has a random stream of its own, by its name and `seed`.
    """
    persons = sorted({int(person) for ids, _ in truth.places.values() for person in ids})
    names = list(recording.detections) if cameras is None else cameras
    return {name: _view(recording, truth, model, name, (persons, seed)) for name in names}


def _view(recording: Recording, truth: TruePeople, model: DetectorModel, name: str, run: tuple[list[int], int]) -> dict[int, tuple[Array, Array]]:
    persons, seed = run
    camera, known = recording.cameras[name], truth.boxes.get(name, {})
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    sampler = ViewSampler(model, camera.camera, 1 / recording.rate, persons, rng)
    out = {}
    for frame, (person, feet) in sorted(truth.places.items()):
        pose = pose_at(recording, camera, frame)
        if pose is None or not 0 <= frame < recording.frames:
            continue
        ground = float(recording.ground.height_at(pose.translation[None])[0])
        made = sampler.step(bodies_in_view((camera.camera, pose), person, feet, recording.pillars, known.get(frame)), Place(pose, ground))
        out[frame] = made.boxes, made.confidence
    return out
