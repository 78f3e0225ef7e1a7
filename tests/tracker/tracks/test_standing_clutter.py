"""False boxes that stay: furniture that one view takes for a person, while others see nobody there."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracker.detections.test_ground_points import seen
from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole
from tracker.geometry.image_boxes import body_boxes
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.recordings import Recording, RecordingCamera
from tracker.sequence.results import Results
from tracker.tracks.detection_rates import StandingClutter
from tracker.tracks.parameters import MhtParameters

COAT_STAND = np.array([1.0, 1.0, 0.0])


def hall(frames: int, share: float) -> Recording:
    """Three cameras see two people walk. One of them also sees a coat stand as a person, in `share` of the frames."""
    lens, rng = Pinhole(1280, 720, 640.0, 640.0, 639.5, 359.5), np.random.default_rng(0)
    places = {"A": (-6.0, -6.0, 3.0), "B": (6.0, -6.0, 3.0), "C": (0.0, 7.0, 3.0)}
    cameras = {name: RecordingCamera.looking_at(lens, place, (0.0, 0.0, 1.0)) for name, place in places.items()}
    truth, boxes = {}, {name: dict[int, tuple[Array, Array]]() for name in cameras}
    for frame in range(frames):
        angle = 0.06 * frame + np.array([0.0, np.pi])
        people = np.column_stack([-1.5 + 1.5 * np.cos(angle), 1.5 * np.sin(angle), np.zeros(2)])
        truth[frame] = np.array([1, 2]), people
        for name, camera in cameras.items():
            shown = np.vstack([people, COAT_STAND]) if name == "A" and rng.random() < share else people
            found = np.concatenate([body_boxes(camera.camera, camera.pose, place, (1.7, 0.5)) for place in shown])
            boxes[name][frame] = found + rng.normal(0.0, 1.5, found.shape), np.full(len(found), 0.9)
    return Recording(10.0, cameras, boxes, truth, area=[[-5, -5], [5, 5]])


def false_positives(recording: Recording, enabled: bool) -> float:
    sequence = recording.sequence()
    targets = MhtParameters(standing_clutter=enabled)
    scores = evaluate(sequence, Results.of(track(sequence.setup, sequence.ticks, Parameters(targets=targets)), {}))["targets"]
    assert scores["misses"] < 20
    return float(scores["false_positives"])


@pytest.mark.soak
def test_what_one_view_keeps_seeing_now_and_then_is_no_person() -> None:
    recording = hall(200, 0.5).choose(["A", "B"])
    assert false_positives(recording, True) < 0.2 * false_positives(recording, False)


@pytest.mark.soak
def test_two_views_contradict_a_third() -> None:
    assert false_positives(hall(200, 1.0), True) == 0


def test_counts_grow_where_boxes_stay_and_fade_elsewhere() -> None:
    clutter = StandingClutter()
    boxes = seen([(0.0, 6.0), (2.0, 6.0)])
    assert not clutter.density(boxes).any()
    for _ in range(20):
        clutter.learn(boxes, np.array([1.0, 0.0]), np.zeros((0, 2)))
    there, beside = clutter.density(boxes)
    assert there > 0.05
    assert beside == 0
    for _ in range(20):
        clutter.learn(boxes, np.zeros(2), boxes.point[:1, :2])
    assert clutter.density(boxes)[0] < 0.1 * there
