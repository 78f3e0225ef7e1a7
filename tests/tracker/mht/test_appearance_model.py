"""Whose box it is by its looks: who was seen is told from others, within one camera alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.tracker.detections.test_ground_points import seen
from tracker.detections.appearance import SIZE
from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array
from tracker.mht.appearance_model import AppearanceModel
from tracker.mht.track_trees import TrackHypotheses, initiated
from tracker.tracks.tracks import MotionParameters


def look(person: int, rng: np.random.Generator, noise: float = 0.02) -> Array:
    """Somebody's look: their own part of the numbers, and a little of the others."""
    out = np.full(SIZE, 0.01)
    out[person * 12 : person * 12 + 12] = 1.0
    out = np.abs(out + noise * rng.normal(size=SIZE))
    return out / np.linalg.norm(out)


def boxes(camera: str, looks: list[Array]) -> GroundDetections:
    feet = seen([(0.3 * k, 6.0) for k in range(len(looks))])
    return replace(feet, camera=camera, appearance=np.array(looks).reshape(-1, SIZE))


def leaves(count: int, cameras: int = 2) -> TrackHypotheses:
    feet = seen([(0.3 * k, 6.0) for k in range(count)])
    groups = [CrossViewGroup(((0, k),), feet.point[k, :2], feet.spread[k]) for k in range(count)]
    return initiated(1, groups, MotionParameters(), 3, cameras)


def dressed(likeness: AppearanceModel, rng: np.random.Generator, ticks: int = 20) -> TrackHypotheses:
    """Two people who were seen by camera a."""
    people = leaves(2)
    for _ in range(ticks):
        view = boxes("a", [look(0, rng), look(1, rng)])
        people = likeness.dressed(people, [view], np.array([[0], [1]]), np.ones(2, dtype=bool))
    return people


def test_the_same_look_speaks_for_and_another_against() -> None:
    rng, likeness = np.random.default_rng(0), AppearanceModel(0.7, 0.1, ["a", "b"])
    people = dressed(likeness, rng)
    worth = likeness.worth(people, [boxes("a", [look(1, rng), look(0, rng), look(3, rng)])])
    assert worth.shape == (2, 3)
    assert worth[0, 1] > 1
    assert worth[1, 0] > 1
    assert (worth[[0, 1, 0, 1], [0, 1, 2, 2]] < -1).all()


def test_what_one_camera_saw_says_nothing_in_another() -> None:
    rng, likeness = np.random.default_rng(1), AppearanceModel(0.7, 0.1, ["a", "b"])
    people = dressed(likeness, rng)
    worth = likeness.worth(people, [seen([(0.0, 6.0)]), boxes("b", [look(0, rng)])])
    assert worth.shape == (2, 2)
    assert not worth.any()


def test_without_images_nobody_is_dressed() -> None:
    likeness, people = AppearanceModel(0.7, 0.1, ["a", "b"]), leaves(2, cameras=0)
    assert likeness.dressed(people, [seen([(0.0, 6.0)])], np.array([[0], [-1]]), np.ones(2, dtype=bool)) is people
    assert not likeness.worth(people, [seen([(0.0, 6.0)])]).any()


def test_a_look_that_is_not_known_changes_nothing() -> None:
    rng, likeness = np.random.default_rng(2), AppearanceModel(0.7, 0.1, ["a", "b"])
    people = dressed(likeness, rng)
    after = likeness.dressed(people, [boxes("a", [np.full(SIZE, np.nan)] * 2)], np.array([[0], [1]]), np.ones(2, dtype=bool))
    np.testing.assert_array_equal(after.appearance, people.appearance)
    assert not likeness.worth(people, [boxes("a", [np.full(SIZE, np.nan)])]).any()


def test_a_look_follows_what_somebody_looks_like_now() -> None:
    rng, likeness = np.random.default_rng(3), AppearanceModel(0.7, 0.1, ["a"])
    people = leaves(1, cameras=1)
    for person in [0] * 10 + [5] * 60:
        people = likeness.dressed(people, [boxes("a", [look(person, rng)])], np.array([[0]]), np.ones(1, dtype=bool))
    assert likeness.worth(people, [boxes("a", [look(5, rng)])])[0, 0] > 1
    assert likeness.worth(people, [boxes("a", [look(0, rng)])])[0, 0] < -1


def test_where_people_change_from_image_to_image_less_is_made_of_it() -> None:
    rng = np.random.default_rng(4)
    calm, wild = AppearanceModel(0.7, 0.1, ["a", "b"]), AppearanceModel(0.7, 0.1, ["a", "b"])
    people = dressed(calm, rng)
    for _ in range(100):
        view = boxes("a", [look(0, rng, 0.12), look(1, rng, 0.12)])
        people = wild.dressed(people, [view], np.array([[0], [1]]), np.ones(2, dtype=bool))
    other = 0.6 * look(0, rng) + 0.4 * look(1, rng)
    view = boxes("a", [other / np.linalg.norm(other)])
    assert wild.worth(people, [view])[0, 0] > calm.worth(people, [view])[0, 0]
