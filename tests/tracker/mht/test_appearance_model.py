"""The appearance model: it tells people apart within one camera, and says nothing across cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.tracker.detections.test_ground_points import seen
from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.front_end import SIZE
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array
from tracker.mht.appearance_model import AppearanceModel
from tracker.mht.track_trees import TrackHypotheses, initiated
from tracker.tracks.tracks import MotionParameters


def appearance(person: int, rng: np.random.Generator, noise: float = 0.02) -> Array:
    """The appearance of a person: a block of features of their own, and a little of the others."""
    out = np.full(SIZE, 0.01)
    out[person * 12 : person * 12 + 12] = 1.0
    out = np.abs(out + noise * rng.normal(size=SIZE))
    return out / np.linalg.norm(out)


def boxes(camera: str, rows: list[Array]) -> GroundDetections:
    ground = seen([(0.3 * k, 6.0) for k in range(len(rows))])
    return replace(ground, camera=camera, appearance=np.array(rows).reshape(-1, SIZE))


def leaves(count: int, cameras: int = 2) -> TrackHypotheses:
    ground = seen([(0.3 * k, 6.0) for k in range(count)])
    groups = [CrossViewGroup(((0, k),), ground.point[k, :2], ground.spread[k]) for k in range(count)]
    return initiated(1, groups, MotionParameters(), (1.7, 0.1), (3, cameras, SIZE))


def after_ticks(model: AppearanceModel, rng: np.random.Generator, ticks: int = 20) -> TrackHypotheses:
    """Two leaves after boxes in camera a."""
    people = leaves(2)
    for _ in range(ticks):
        view = boxes("a", [appearance(0, rng), appearance(1, rng)])
        people = model.with_appearance(people, [view], np.array([[0], [1]]), np.ones(2, dtype=bool))
    return people


def test_the_same_appearance_has_a_positive_log_ratio_and_another_a_negative_one() -> None:
    rng, model = np.random.default_rng(0), AppearanceModel(["a", "b"])
    people = after_ticks(model, rng)
    ratio = model.log_ratio(people, [boxes("a", [appearance(1, rng), appearance(0, rng), appearance(3, rng)])])
    assert ratio.shape == (2, 3)
    assert ratio[0, 1] > 1
    assert ratio[1, 0] > 1
    assert (ratio[[0, 1, 0, 1], [0, 1, 2, 2]] < -1).all()


def test_the_appearance_in_one_camera_is_not_compared_in_another() -> None:
    rng, model = np.random.default_rng(1), AppearanceModel(["a", "b"])
    people = after_ticks(model, rng)
    ratio = model.log_ratio(people, [seen([(0.0, 6.0)]), boxes("b", [appearance(0, rng)])])
    assert ratio.shape == (2, 2)
    assert not ratio.any()


def test_without_images_leaves_have_no_appearance() -> None:
    model, people = AppearanceModel(["a", "b"]), leaves(2, cameras=0)
    assert model.with_appearance(people, [seen([(0.0, 6.0)])], np.array([[0], [-1]]), np.ones(2, dtype=bool)) is people
    assert not model.log_ratio(people, [seen([(0.0, 6.0)])]).any()


def test_boxes_of_unknown_appearance_change_nothing() -> None:
    rng, model = np.random.default_rng(2), AppearanceModel(["a", "b"])
    people = after_ticks(model, rng)
    after = model.with_appearance(people, [boxes("a", [np.full(SIZE, np.nan)] * 2)], np.array([[0], [1]]), np.ones(2, dtype=bool))
    np.testing.assert_array_equal(after.appearance, people.appearance)
    assert not model.log_ratio(people, [boxes("a", [np.full(SIZE, np.nan)])]).any()


def test_the_appearance_of_a_track_is_updated() -> None:
    rng, model = np.random.default_rng(3), AppearanceModel(["a"])
    people = leaves(1, cameras=1)
    for person in [0] * 10 + [5] * 60:
        people = model.with_appearance(people, [boxes("a", [appearance(person, rng)])], np.array([[0]]), np.ones(1, dtype=bool))
    assert model.log_ratio(people, [boxes("a", [appearance(5, rng)])])[0, 0] > 1
    assert model.log_ratio(people, [boxes("a", [appearance(0, rng)])])[0, 0] < -1


def test_where_the_appearance_of_people_varies_a_difference_counts_less() -> None:
    rng = np.random.default_rng(4)
    steady, variable = AppearanceModel(["a", "b"]), AppearanceModel(["a", "b"])
    people = after_ticks(steady, rng)
    for _ in range(100):
        view = boxes("a", [appearance(0, rng, 0.12), appearance(1, rng, 0.12)])
        people = variable.with_appearance(people, [view], np.array([[0], [1]]), np.ones(2, dtype=bool))
    other = 0.6 * appearance(0, rng) + 0.4 * appearance(1, rng)
    view = boxes("a", [other / np.linalg.norm(other)])
    assert variable.log_ratio(people, [view])[0, 0] > steady.log_ratio(people, [view])[0, 0]
