"""Silhouettes on synthetic streets: which people are detected, where, and behind which pillars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker import street
from tests.tracker.street import CAMERA, EYE, NAME, Street
from tracker.detections.ground_points import FusionParameters, GroundDetections, project_to_ground
from tracker.detections.silhouettes import FULL_SCORE, Silhouettes, explain_foreground
from tracker.geometry import Array
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Pinhole
from tracker.types import Detections

NOBODY = np.zeros((0, 2))
BOXES = FusionParameters(ahead=0.0)


def feet(where: Street, found: Detections) -> GroundDetections:
    return project_to_ground(where.setup, NAME, found, (EYE, np.zeros((6, 6))), BOXES)


def detector_of_empty(where: Street, ticks: int = 30) -> Silhouettes:
    """A detector that has seen the street without anybody."""
    out = Silhouettes(CAMERA, EYE, where.setup)
    for _ in range(ticks):
        assert not len(detected(out, where, NOBODY))
    return out


def detected(detector: Silhouettes, where: Street, people: Array, boxes: Array = NOBODY) -> Array:
    """Places (n, 2) m where it finds somebody."""
    given = street.detections(boxes)
    found = detector.step(where.image(people), given, feet(where, given))
    return feet(where, found).point[:, :2]


def unmatched(found: Array, people: Array, near: float = 1.3) -> tuple[int, int]:
    """How many people have nobody near, and how many of who is found."""
    apart = np.linalg.norm(found[:, None] - people[None], axis=2)
    return int((apart.min(axis=0, initial=np.inf) > near).sum()), int((apart.min(axis=1, initial=np.inf) > near).sum())


def test_everybody_is_detected_without_any_box() -> None:
    where, rng = Street(), np.random.default_rng(1)
    detector = detector_of_empty(where)
    people, speed = np.array([[-4.0, -3.0], [0.0, 1.0], [4.0, -1.0]]), np.array([[0.1, 0.12], [0.02, -0.15], [-0.12, 0.1]])
    missed = false = 0
    for _ in range(20):
        people = people + speed + rng.normal(0, 0.02, people.shape)
        m, f = unmatched(detected(detector, where, people), people)
        missed, false = missed + m, false + f
    # Two people merge while one is before the other.
    assert missed <= 5
    assert false <= 2


@pytest.mark.parametrize(
    ("camera", "width"),
    [
        (Pinhole(768, 576, 910.0, 905.0, 390.0, 280.0, (-0.2, 0.05, 0.001, -0.002, 0.0)), 384),
        (Fisheye(1000, 750, 760.0, 760.0, 495.0, 380.0, (0.02, -0.01, 0.002, 0.0)), 500),
        (Cylinder(3840, 400, 130.0, 3840 / (2 * np.pi)), 1920),
    ],
)
def test_people_are_detected_in_images_of_other_cameras(camera: Camera, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(street, "CAMERA", camera)
    where = Street()
    detector = Silhouettes(camera, EYE, where.setup, width)
    for _ in range(15):
        assert not len(detected(detector, where, NOBODY))
    for people in (np.array([[-6.0, -3.0], [0.0, 1.0], [2.0, -1.0]]), np.array([[-8.0, 3.0], [-2.0, -2.0]])):
        assert unmatched(detected(detector, where, people), people) == (0, 0)


def test_both_of_two_people_are_detected_though_one_covers_half_of_the_other() -> None:
    where = Street()
    people = np.array([[-4.0, 0.0], [-1.0, 0.45]])
    assert unmatched(detected(detector_of_empty(where), where, people), people) == (0, 0)


def test_a_known_post_is_no_evidence_against_a_person_behind_it() -> None:
    """A post hides the middle of somebody of whom both sides are to be seen."""
    streets = [Street(post=True, known=known) for known in (True, False)]
    detectors = [detector_of_empty(where) for where in streets]
    assert [detector.hidden.any() for detector in detectors] == [True, False]
    for y in (0.08, 0.12, -0.12):
        person, nothing = np.array([[2.0, y]]), Detections.none()
        known, unknown = (d.step(w.image(person), nothing, feet(w, nothing)) for d, w in zip(detectors, streets, strict=True))
        assert len(known) == 1
        assert known.confidence[0] > unknown.confidence.max(initial=0.0) + 0.02


def test_an_exact_body_is_explained_once_and_unknown_pixels_are_no_evidence() -> None:
    where = Street()
    detector = Silhouettes(CAMERA, EYE, where.setup)
    candidates = detector._candidate_bodies(1.75)
    place = int(np.argmin(np.abs(candidates.foot - [192, 200]).sum(axis=1)))
    foot, head = candidates.foot[place], candidates.head[place]
    body, tall = np.zeros(detector.shape, dtype=bool), foot[1] - head[1]
    for half, high, low in ((0.055, 0.02, 0.16), (0.115, 0.16, 0.5), (0.09, 0.5, 0.93)):
        u = head[0] + (foot[0] - head[0]) * (high + low) / 2
        body[round(head[1] + high * tall) : round(head[1] + low * tall), round(u - half * tall) : round(u + half * tall)] = True
    nothing = np.zeros(detector.shape, dtype=bool)
    found, score = explain_foreground(body, nothing, nothing, candidates)
    assert len(score) == 1
    assert score[0] == pytest.approx(FULL_SCORE, rel=0.1)
    assert np.abs(found.foot[0] - foot).max() <= 3
    assert len(explain_foreground(body, ~nothing, nothing, candidates)[1]) == 0
    assert len(explain_foreground(nothing, nothing, nothing, candidates)[1]) == 0


def test_the_mean_stature_is_learned_from_boxes() -> None:
    where = Street()
    detector = detector_of_empty(where)
    people = np.array([[0.0, 0.0], [4.0, 2.0]])
    for _ in range(40):
        detected(detector, where, people, people)
    assert abs(detector._stature_sum / detector._weight - street.TALL) < 0.02


def test_a_post_that_crosses_the_whole_image_hides_its_columns() -> None:
    setup = Street(post=True).setup
    tall = setup.pillars.copy()
    tall[:, 3:] = -20.0, 20.0
    hidden = Silhouettes(CAMERA, EYE, replace(setup, pillars=tall)).hidden
    assert 3 < hidden.all(axis=0).sum() == hidden.any(axis=0).sum() < 15
