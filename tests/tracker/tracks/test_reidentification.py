"""Re-identification: lost people keep their id where place, time and stature agree, and other people do not get it."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.geometry import Ints
from tracker.tracks.reidentification import Appearance, NewTargetModel, Reidentification, ReidentificationParameters
from tracker.tracks.tracks import Tracks

PERIOD = 1 / 6
Person = tuple[int, float, float, float, float, int]


def tracks(*people: Person) -> Tracks:
    """Rows of tree, x, y m, velocity m/s, and ticks without a box."""
    tree, x, y, vx, vy, misses = (np.array(column) for column in zip(*people, strict=True)) if people else np.zeros((6, 0))
    state, ids = np.stack([x, y, vx, vy, 1.72 + 0 * x], axis=1).astype(float), tree.astype(np.int64)
    covariance = np.tile(np.diag([0.03, 0.03, 0.2, 0.2, 0.01]), (len(ids), 1, 1))
    zero: Ints = np.zeros(len(ids), dtype=np.int64)
    return Tracks(ids, state, covariance, zero + 9.0, misses.astype(np.int64))


def compared(a: Appearance, b: Appearance) -> float:
    """Unlike vectors speak against one person."""
    return 12.0 * float(a.mean.ravel() @ b.mean.ravel()) - 12.0


def looks(count: int, axis: int = 0) -> Appearance:
    """The same unit vector of 2 numbers for `count` tracks, in one camera."""
    return Appearance(np.tile(np.eye(2)[axis], (count, 1, 1)), np.ones((count, 1)))


def nobody_lost() -> Reidentification:
    return Reidentification(ReidentificationParameters(), NewTargetModel(2e-4, 1.72, 0.12), compared)


def after(gap: int, back: list[Person], start: tuple[Person, ...], left: set[int] | None = None, axis: int = 0) -> Reidentification:
    """`start` are tracked, nobody is detected for `gap` ticks, then the tracks `back` are new. axis: of their vectors; that of `start` is 0."""
    reidentification, people = nobody_lost(), tracks(*start)
    confirmed = np.ones(len(people), dtype=bool)
    reidentification.step(0.0, people, (confirmed, confirmed), set(), looks(len(people)))
    none = np.zeros(0, dtype=bool)
    for tick in range(gap):
        reidentification.step((tick + 1) * PERIOD, tracks(), (none, none), left or set() if tick == 0 else set(), looks(0))
    fresh = np.ones(len(back), dtype=bool)
    reidentification.step((gap + 1) * PERIOD, tracks(*back), (fresh, fresh), set(), looks(len(back), axis))
    return reidentification


@pytest.mark.parametrize(("gap", "x", "same"), [(12, 2.0, True), (12, 8.0, False), (30, 3.0, True), (60, 2.0, False)])
def test_a_person_who_reappears_near_the_prediction_in_time_is_the_same(gap: int, x: float, same: bool) -> None:
    found = after(gap, [(7, x, 0.2, 1.0, 0.0, 0)], ((1, 0.0, 0.0, 1.2, 0.0, 0),))
    assert found.first_tree == ({7: 1} if same else {})


def test_a_person_of_another_appearance_is_not_the_same() -> None:
    start, back = ((1, 0.0, 0.0, 1.2, 0.0, 0),), [(7, 2.0, 0.2, 1.0, 0.0, 0)]
    assert after(12, back, start).first_tree == {7: 1}
    assert after(12, back, start, axis=1).first_tree == {}


def test_a_person_outside_all_views_is_not_re_identified() -> None:
    start = ((1, 0.0, 0.0, 1.2, 0.0, 0),)
    assert after(12, [(7, 2.0, 0.2, 1.0, 0.0, 0)], start, left={1}).first_tree == {}


def test_two_lost_people_are_assigned_one_to_one() -> None:
    start = ((1, 0.0, 0.0, 1.0, 0.0, 0), (2, 6.0, 0.0, -1.0, 0.0, 0))
    assert after(9, [(7, 4.9, 0.0, 0.0, 0.0, 0), (8, 1.1, 0.0, 0.0, 0.0, 0)], start).first_tree == {7: 2, 8: 1}
    assert len(after(9, [(7, 1.1, 0.3, 0.0, 0.0, 0), (8, 1.1, -0.6, 0.0, 0.0, 0)], start[:1]).first_tree) == 1


def test_a_track_with_boxes_is_not_lost() -> None:
    reidentification = nobody_lost()
    one, both = tracks((1, 0.0, 0.0, 0.0, 0.0, 0)), tracks((1, 0.0, 0.0, 0.0, 0.0, 0), (2, 5.0, 5.0, 0.0, 0.0, 0))
    reidentification.step(0.0, one, (np.ones(1, dtype=bool),) * 2, set(), looks(1))
    assert reidentification.step(PERIOD, both, (np.ones(2, dtype=bool), np.array([False, True])), set(), looks(2)) == set()
    assert reidentification.first_tree == {}
    # A coasting track is lost: it is deleted, and the new track gets its id.
    coasting = tracks((1, 1.5, 0.0, 0.0, 0.0, 5), (3, 0.4, 0.0, 0.0, 0.0, 0))
    assert reidentification.step(2 * PERIOD, coasting, (np.ones(2, dtype=bool), np.array([False, True])), set(), looks(2)) == {1}
    reported = reidentification.relabelled(coasting)
    assert reported.tree.tolist() == [1]
    assert reported.state[0, 0] == 0.4


def test_the_first_id_is_kept_over_several_losses() -> None:
    reidentification, confirmed = after(9, [(5, 1.0, 0.0, 1.0, 0.0, 0)], ((1, 0.0, 0.0, 1.0, 0.0, 0),)), np.ones(1, dtype=bool)
    for tick in range(11, 20):
        reidentification.step(tick * PERIOD, tracks(), (confirmed[:0], confirmed[:0]), set(), looks(0))
    reidentification.step(20 * PERIOD, tracks((9, 2.2, 0.0, 1.0, 0.0, 0)), (confirmed, confirmed), set(), looks(1))
    assert reidentification.first_tree == {5: 1, 9: 1}


def test_statures_tell_apart_two_people_who_were_lost_together() -> None:
    """They reappear in each other's places. Without known statures each is taken for the other."""
    for sigma, confirmed in ((0.03, True), (0.12, False)):
        start, back = (tracks((a, 0.0, 0.0, 0.0, 0.0, 0), (b, 0.8, 0.0, 0.0, 0.0, 0)) for a, b in ((1, 2), (7, 8)))
        for people, tall in ((start, (1.58, 1.88)), (back, (1.87, 1.57))):
            people.state[:, 4], people.covariance[:, 4, 4] = tall, sigma**2
        reidentification, all_of_them = nobody_lost(), np.ones(2, dtype=bool)
        reidentification.step(0.0, start, (all_of_them, all_of_them), set(), looks(2))
        for tick in range(1, 10):
            reidentification.step(tick * PERIOD, tracks(), (all_of_them[:0], all_of_them[:0]), set(), looks(0))
        reidentification.step(10 * PERIOD, back, (all_of_them, all_of_them), set(), looks(2))
        assert reidentification.first_tree == ({7: 2, 8: 1} if confirmed else {7: 1, 8: 2})
