"""Detection and clutter rates: true rates are estimated, and prior counts fade."""

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
from tracker.tracks.detection_rates import DetectionRateParameters, DetectionRates, StandingClutter
from tracker.tracks.parameters import MhtParameters

GROUND_AREA = 300.0


def taught(share: float, false: float, ticks: int = 600) -> DetectionRates:
    """People are found at `share`, with `false` boxes of the highest confidence a tick."""
    rng, rates = np.random.default_rng(0), DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(ticks):
        found = np.full(rng.binomial(10, share), 0.99)
        other = np.full(rng.poisson(false), 0.99)
        rates.learn("c", found, 10.0, other, np.ones(len(other)))
    return rates


def test_rates_are_estimated() -> None:
    rates = taught(0.6, 2.0)
    assert abs(rates.detection("c") - 0.6) < 0.05
    expected = np.log(0.6 / (2.0 / GROUND_AREA))
    assert abs(rates.log_ratio("c", np.array([0.99]))[0] - expected) < 0.3
    assert rates.detection("other") == DetectionRates(DetectionRateParameters(), GROUND_AREA).detection("c"), "of this view alone"


def test_rates_stay_within_bounds() -> None:
    rates = taught(1.0, 0.0, 5000)
    assert rates.detection("c") <= DetectionRateParameters().max_detection
    assert np.isfinite(rates.log_ratio("c", np.array([0.0, 0.6, 0.85, 0.93, 1.0]))).all()


def test_weighted_boxes_count_by_their_weight() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(2000):
        rates.learn("c", np.full(9, 0.99), 10.0, np.full(2, 0.99), np.full(2, 0.5))
    expected = np.log(0.9 / (1.0 / GROUND_AREA))
    assert abs(rates.log_ratio("c", np.array([0.99]))[0] - expected) < 0.1


def covered_by(things: float, people: float = 0.0) -> np.ndarray:
    return np.array([[things, people]])


def test_relative_detection_rates_of_covered_people_are_estimated() -> None:
    rng, rates = np.random.default_rng(1), taught(0.9, 0.1)
    for _ in range(4000):
        cover = np.array([[0.3, 0.0], [0.9, 0.0], [0.0, 0.5]])
        rates.learn_partly_visible("c", cover, rng.random(3) < 0.9 * np.array([0.8, 0.1, 0.25]))
    assert abs(rates.relative_detection("c", covered_by(0.3))[0] - 0.8) < 0.05
    assert abs(rates.relative_detection("c", covered_by(0.9))[0] - 0.1) < 0.05
    assert abs(rates.relative_detection("c", covered_by(0.0, 0.5))[0] - 0.25) < 0.05
    assert rates.relative_detection("c", covered_by(0.0))[0] == 1
    assert (
        rates.relative_detection("other", covered_by(0.9))[0]
        == DetectionRates(DetectionRateParameters(), GROUND_AREA).relative_detection("c", covered_by(0.9))[0]
    )


def test_relative_detection_rates_do_not_increase_with_cover() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(500):
        rates.learn_partly_visible("c", covered_by(0.7), np.ones(1, dtype=bool))
    share = rates.relative_detection("c", np.column_stack([np.linspace(0, 1, 30), np.zeros(30)]))
    assert (np.diff(share) <= 1e-12).all()


def test_people_covered_by_objects_and_people_are_left_out() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    before = rates.relative_detection("c", covered_by(0.5, 0.5))
    for _ in range(500):
        rates.learn_partly_visible("c", covered_by(0.5, 0.5), np.zeros(1, dtype=bool))
    assert rates.relative_detection("c", covered_by(0.5, 0.5)) == before


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
