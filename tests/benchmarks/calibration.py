"""Calibration from people alone, against the exact truth: rooms, halls and squares with 2 to 8 cameras, none of them calibrated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.tuning.cameras import corner_cameras, mast_cameras
from sim.tuning.places import floor, furniture
from sim.tuning.population import STATURE, STATURES
from sim.tuning.walks import STEPS, Habits, Walkers, walks
from tracker.detector_models.model import named_model
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.simulation import simulated_detections
from tracker.recordings import Recording, RecordingCamera

KINDS = {"room": ((6.0, 10.0), (4.0, 6.0)), "hall": ((14.0, 26.0), (9.0, 16.0)), "square": ((16.0, 30.0), (12.0, 24.0))}


@dataclass(frozen=True, eq=False)
class Synthetic:
    """A recording without calibration, its true cameras, and by how many s the clock of each is late."""

    recording: Recording
    cameras: dict[str, RecordingCamera]
    offsets: dict[str, float]


def synthetic(kind: str, cameras: int, seed: int, seconds: float = 90.0, model: str = "fairmot", people: int | None = None) -> Synthetic:
    """A case: people who walk, stand in groups, come and go, seen by a fitted detector; clocks off by up to a second."""
    rng = np.random.default_rng([seed, cameras, list(KINDS).index(kind)])
    size = tuple(float(rng.uniform(*bounds)) for bounds in KINDS[kind])
    rate = float(rng.choice([4.0, 5.0, 10.0]))
    frames = round(seconds * rate)
    around = floor(np.array([(0.0, 0.0), size]), furniture(size, 0.01, rng), 2, rng)
    at_once = people or {"room": int(rng.integers(4, 11)), "hall": int(rng.integers(6, 20)), "square": int(rng.integers(6, 24))}[kind]
    true = mast_cameras(around, cameras, rng) if kind == "square" else corner_cameras(size, cameras, rng)
    habits = Habits(rng.uniform(0.1, 0.4), 0.0, 0.0, rng.uniform(3.0, 10.0), rng.uniform(0.8, 1.3), (0.4, 1.0))
    total = at_once + int(rng.integers(0, at_once + 1))
    walkers = Walkers.of(around, habits, (at_once, total, 0), frames / rate, rng)
    slack = round(rate) + 1
    walked = walks(walkers, frames + 2 * slack, 1 / rate)
    stature = np.clip(rng.normal(*STATURE, total), *STATURES)
    named = {f"C{k}": camera for k, camera in enumerate(true, 1)}
    late = {name: 0 if k == 0 else int(rng.integers(-round(rate) * STEPS, round(rate) * STEPS + 1)) for k, name in enumerate(named)}
    heights = {k + 1: float(one) for k, one in enumerate(stature)}
    detections: dict[str, Any] = {}
    for name, camera in named.items():
        places = {}
        for frame in range(frames):
            step = STEPS * (frame + slack) + late[name]
            here = np.flatnonzero(np.isfinite(walked.place[step]).all(axis=1))
            places[frame] = here + 1, np.column_stack([walked.place[step, here], np.zeros(len(here))])
        seen = Recording(rate, {name: camera}, {name: {}}, places, frames=frames, pillars=around.pillars)
        detections |= simulated_detections(seen, TruePeople(places, {}, heights=heights), named_model(model), seed)
    blind = {name: unknown(camera) for name, camera in named.items()}
    return Synthetic(Recording(rate, blind, detections, frames=frames), named, {name: k / STEPS / rate for name, k in late.items()})


def unknown(camera: RecordingCamera) -> RecordingCamera:
    """The camera of which the size of the image alone is known."""
    return RecordingCamera.uncalibrated(camera.camera.width, camera.camera.height)
