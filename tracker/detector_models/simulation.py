"""Simulated detections of a recording: its true people seen by a detector model, in place of its own boxes."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np

from tracker.detector_models.bodies import bodies_in_view
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.sampler import Place, ViewSampler
from tracker.geometry import Array
from tracker.geometry.cameras import Camera
from tracker.recordings import Recording

MISSES, NOISE, LEAST_VISIBLE, CONFIDENCE = 0.1, np.radians(0.15), 0.2, (0.9, 0.08)
"""Of the independent detector, as a scenario has them by default."""
Simulated = dict[str, dict[int, tuple[Array, Array]]]


def simulated_detections(
    recording: Recording, truth: TruePeople, model: DetectorModel | Mapping[str, DetectorModel], seed: int, cameras: list[str] | None = None
) -> Simulated:
    """Camera → frame → boxes (n, 4) left, top, width, height px and confidences (n,), in all frames with truth.

    model: of all cameras, or of each by its name. cameras: names, None for all with detections.
    Each has a random stream of its own, by its name and `seed`.
    """
    persons = sorted({int(person) for ids, _ in truth.places.values() for person in ids})
    names = list(recording.detections) if cameras is None else cameras
    models = dict.fromkeys(names, model) if isinstance(model, DetectorModel) else model
    return {name: _view(recording, truth, models[name], name, (persons, seed)) for name in names}


def _view(recording: Recording, truth: TruePeople, model: DetectorModel, name: str, run: tuple[list[int], int]) -> dict[int, tuple[Array, Array]]:
    persons, seed = run
    camera, known = recording.cameras[name], truth.boxes.get(name, {})
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
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


def independent_detections(recording: Recording, truth: TruePeople, seed: int, cameras: list[str] | None = None) -> Simulated:
    """As simulated_detections, by a detector with independent errors, as a scenario has it by default, without false boxes."""
    out: Simulated = {}
    for name in list(recording.detections) if cameras is None else cameras:
        camera, known = recording.cameras[name], truth.boxes.get(name, {})
        rng, boxes = np.random.default_rng([seed, zlib.crc32(name.encode())]), {}
        for frame, (person, feet) in sorted(truth.places.items()):
            pose = recording.pose_at(camera, frame)
            if pose is None or not 0 <= frame < recording.frames:
                continue
            bodies = bodies_in_view((camera.camera, pose), person, feet, recording.pillars, known.get(frame), truth.heights)
            found = (rng.random(len(bodies.person)) >= MISSES) & (bodies.visible >= LEAST_VISIBLE)
            edges = bodies.seen + rng.normal(0.0, NOISE, bodies.seen.shape) / _pixel_angle(camera.camera, bodies.seen)
            sure = np.clip(rng.normal(*CONFIDENCE, len(edges)), 0.5, 1.0)
            boxes[frame] = np.column_stack([edges[:, :2], np.maximum(edges[:, 2:] - edges[:, :2], 1.0)])[found], sure[found]
        out[name] = boxes
    return out


def _pixel_angle(camera: Camera, edges: Array) -> Array:
    """Angle (n, 1) of a pixel, rad, at the middle of each box (n, 4) px."""
    middle = (edges[:, :2] + edges[:, 2:]) / 2
    above, below = (camera.bearings_from_pixels(middle + np.array([0.0, dv])) for dv in (-0.5, 0.5))
    angle = np.linalg.norm(above - below, axis=1)
    return np.asarray(np.where(np.isfinite(angle) & (angle > 0), angle, 1.0)[:, None])
