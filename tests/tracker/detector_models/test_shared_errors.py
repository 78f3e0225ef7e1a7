"""Errors of the truth on which all views agree are found back, and twins have them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.detector_models.test_fit import known_model
from tests.tracker.recordings.walked_room import walked_room
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.shared_errors import SharedErrors, agreed, drawn
from tracker.detector_models.simulation import simulated_detections

FIELD = np.array([[0.0, 0.0], [-0.2, 0.0], [0.05, -0.15], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
"""m: the room is smaller along both axes, and sheared."""


@pytest.fixture(scope="module")
def seen():
    """A room, its annotated people, and those that its views see."""
    room = walked_room(people=7, frames=240, seed=4)
    truth = TruePeople(room.truth, {})
    bounds = np.array([np.min([feet.min(axis=0)[:2] for _, feet in room.truth.values()], axis=0)] * 2)
    bounds[1] = np.max([feet.max(axis=0)[:2] for _, feet in room.truth.values()], axis=0)
    errors = SharedErrors(FIELD, bounds, 0.0, 0.05, 0.2, 2.0, 0.05)
    there = drawn(room, truth, errors, 3)
    boxes = {name: dict(of) for name, of in simulated_detections(room, there, known_model(), 2).items()}
    return room.with_detections(boxes), truth, there


def test_the_people_that_all_views_see_are_found(seen):
    room, truth, there = seen
    people, errors = agreed(room, truth)
    assert errors is not None

    def off(one: TruePeople) -> float:
        return float(np.sqrt(np.mean([((one.places[f][1] - there.places[f][1]) ** 2).sum(axis=1).mean() for f in truth.places])))

    assert off(people) < 0.4 * off(truth)
    spread = np.std([there.heights[p] for p in there.heights]) / 1.75
    assert errors.stature == pytest.approx(spread, rel=0.3)
    found, true = (np.array([one.heights[p] for p in sorted(people.heights)]) for one in (people, there))
    assert np.corrcoef(found, true)[0, 1] > 0.9


def test_exact_truth_has_small_errors(seen):
    room, truth, _ = seen
    exact = room.with_detections({name: dict(of) for name, of in simulated_detections(room, truth, known_model(), 2).items()})
    _, errors = agreed(exact, truth)
    assert errors is not None
    assert errors.by_place < 0.03
    assert errors.deviation < 0.03
    assert errors.stature < 0.02


def test_one_view_and_true_boxes_tell_nothing(seen):
    room, truth, _ = seen
    assert agreed(room.choose(["C1"]), truth) == (truth, None)
    known = replace(truth, boxes={"C1": {}})
    assert agreed(room, known) == (known, None)


def test_drawn_people_are_the_same_by_the_same_seed(seen):
    room, truth, _ = seen
    _, errors = agreed(room, truth)
    first, again, other = (drawn(room, truth, errors, seed) for seed in (1, 1, 2))
    frame = next(iter(truth.places))
    assert np.array_equal(first.places[frame][1], again.places[frame][1])
    assert not np.array_equal(first.places[frame][1], other.places[frame][1])
    assert first.heights == again.heights != other.heights
    shift = np.concatenate([first.places[f][1][:, :2] - truth.places[f][1][:, :2] - errors.displacement(truth.places[f][1]) for f in truth.places])
    assert np.std(shift) == pytest.approx(errors.deviation, rel=0.5)
