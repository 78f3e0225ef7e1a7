"""A room in which people walk, four cameras in its corners, with boxes of upright bodies; and errors that people make in such recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Pinhole
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.calibration_feet import Extrinsics
from tracker.recordings.degradation import BoxNoise, projected_boxes

SIZE = (12.0, 8.0)
"""m."""
CORNERS = ((0.0, 0.0, 2.4), (12.0, 0.3, 2.8), (11.7, 8.0, 2.2), (0.2, 7.7, 3.0))
"""m: places of the cameras C1 to C4, which look at points near the middle."""
FALSE = 0.2
"""False boxes of a camera and frame."""
LENS = Pinhole(1280, 720, 800.0, 800.0, 639.5, 359.5)


def camera_at(place: tuple[float, float, float], target: tuple[float, float, float], lens: Pinhole = LENS) -> RecordingCamera:
    """A camera at a place, m, that looks at a target, m."""
    ahead = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    left = np.cross([0.0, 0.0, 1.0], ahead)
    left /= np.linalg.norm(left)
    rotation = np.stack([ahead, left, np.cross(ahead, left)], axis=1)
    return RecordingCamera(lens, Pose(rotation, np.array(place)))


@cache
def walked_room(people: int = 8, frames: int = 160, seed: int = 0, speed: float = 1.1, lens: Pinhole = LENS) -> Recording:
    """4 frames/s; misses of 10 % and edges of 2 % of a box, and false boxes anywhere. speed: m/s; 0 for people who stand."""
    rng = np.random.default_rng(seed)
    rate = 4.0
    places, heading = rng.uniform([1.0, 1.0], np.subtract(SIZE, 1.0), (people, 2)), rng.uniform(-np.pi, np.pi, people)
    truth: dict[int, tuple[Ints, Array]] = {}
    for frame in range(frames):
        heading = heading + rng.normal(0.0, 0.3, people)
        step = places + speed / rate * np.column_stack([np.cos(heading), np.sin(heading)])
        out = ((step < 0.5) | (step > np.subtract(SIZE, 0.5))).any(axis=1)
        heading = np.where(out, np.arctan2(*(np.array(SIZE) / 2 - places).T[::-1]), heading)
        places = np.where(out[:, None], places, step)
        truth[frame] = np.arange(1, people + 1), np.column_stack([places, np.zeros(people)])
    cameras = {f"C{k + 1}": camera_at(place, (6.0 + k / 5, 4.0 - k / 5, 0.8), lens) for k, place in enumerate(CORNERS)}
    room = projected_boxes(Recording(rate, cameras, {}, truth, area=[[0, 0], list(SIZE)]), BoxNoise(0.1, 0.02), seed)
    return room.with_detections({name: _with_false_boxes(boxes, rng) for name, boxes in room.detections.items()})


def _with_false_boxes(boxes: FrameBoxes, rng: np.random.Generator) -> FrameBoxes:
    out = {}
    for frame, (box, confidence) in boxes.items():
        n = rng.poisson(FALSE)
        false = np.column_stack([rng.uniform(0, 1100, n), rng.uniform(0, 400, n), rng.uniform(40, 150, n), rng.uniform(80, 280, n)])
        out[frame] = np.concatenate([box, false]), np.concatenate([confidence, rng.uniform(0, 1, n)])
    return out


def with_extrinsics(recording: Recording, change: Callable[[Extrinsics], Extrinsics], names: tuple[str, ...] = ()) -> Recording:
    """The recording whose entries R and t of the named cameras, or of all, are replaced."""
    cameras = {
        name: RecordingCamera.of_opencv(camera.camera, *change(camera.opencv_extrinsics)) if not names or name in names else camera
        for name, camera in recording.cameras.items()
    }
    return replace(recording, cameras=cameras)


def with_frames(recording: Recording, change: Callable[[int], int], names: tuple[str, ...] = ()) -> Recording:
    """The recording whose detections of the named cameras, or of all, have other frame numbers."""
    detections = {
        name: {change(frame): box for frame, box in boxes.items()} if not names or name in names else boxes
        for name, boxes in recording.detections.items()
    }
    return replace(recording, detections=detections, frames=0)


def swapped(recording: Recording, a: str, b: str) -> Recording:
    """The recording with the detections of two cameras exchanged."""
    return replace(recording, detections={**recording.detections, a: recording.detections[b], b: recording.detections[a]})


def with_truth(recording: Recording, scale: float = 1.0, change: Callable[[int], int] = lambda frame: frame) -> Recording:
    """The recording with true places in another unit, and with other frame numbers."""
    assert recording.truth is not None
    return replace(recording, truth={change(frame): (ids, places * scale) for frame, (ids, places) in recording.truth.items()}, frames=0)


@cache
def planted(recording: Recording) -> dict[str, tuple[str, Recording, bool]]:
    """Name of a planted error → kind of the finding that tells of it, the recording with the error, and whether it can be seen without truth."""
    first, second, third = list(recording.cameras)[:3]
    area = None if recording.area is None else np.asarray(recording.area)
    out = {
        "mm": ("units-mm", with_extrinsics(recording, lambda e: (e[0], e[1] * 1000)), True),
        "cm": ("units-cm", with_extrinsics(recording, lambda e: (e[0], e[1] * 100)), True),
        "cm in one camera": ("units-cm", with_extrinsics(recording, lambda e: (e[0], e[1] * 100), (second,)), True),
        "R transposed": ("rotation-transposed", with_extrinsics(recording, lambda e: (e[0].T, e[1])), True),
        "R transposed in one camera": ("rotation-transposed", with_extrinsics(recording, lambda e: (e[0].T, e[1]), (third,)), True),
        "t is the centre": ("translation-is-centre", with_extrinsics(recording, lambda e: (e[0], -e[0].T @ e[1])), True),
        "t is the centre in one camera": ("translation-is-centre", with_extrinsics(recording, lambda e: (e[0], -e[0].T @ e[1]), (first,)), True),
        "camera to world": ("camera-to-world", with_extrinsics(recording, lambda e: (e[0].T, -e[0].T @ e[1])), True),
        "two cameras swapped": ("cameras-swapped", swapped(recording, first, third), True),
        "frames + 1 of all": ("frames-shifted-all", with_frames(recording, lambda frame: frame + 1), False),
        "truth in mm": ("truth-mm", with_truth(recording, 1000.0), False),
        "truth in every 5th frame": ("frames-stretched", with_truth(recording, change=lambda frame: 5 * frame), False),
        "detections in every 3rd frame": ("frames-stretched", with_frames(recording, lambda frame: 3 * frame), False),
        "one camera in every 10th frame": ("frames-stretched", with_frames(recording, lambda frame: 10 * frame, (second,)), True),
    }
    for name in recording.cameras:
        out[f"frames + 1 in {name}"] = ("frames-shifted", with_frames(recording, lambda frame: frame + 1, (name,)), True)
    if area is not None:
        out["area in mm"] = ("area-mm", replace(recording, area=area * 1000), True)
    return out
