"""Who leaves the area and comes back has a new id; who only seems to does not."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.tracks.track_ids import EXIT_DISTANCE, EXIT_TIME, TrackIds
from tracker.tracks.tracks import Tracks

EDGE = 2.3


def told(x: list[float | None]) -> set[int]:
    """Ids of one person, tree 7, who is so many m along the x axis tick by tick; the area ends at EDGE. None: nobody sees them."""
    names, out = TrackIds(synthetic_crowd.setup(area=np.array([[-10.0, -10.0], [EDGE, 10.0]]))), set()
    for place in x:
        n, one = int(place is not None), np.ones(int(place is not None), dtype=np.int64)
        state = np.zeros((n, 5))
        state[:, 0] = place or 0.0
        ids, feet, _ = names.report(Tracks(7 * one, state, np.tile(np.eye(5), (n, 1, 1)), 1.0 * one, one, 0 * one, one))
        assert len(ids) == len(feet) == int(place is not None and place <= EDGE)
        out |= set(ids.tolist())
    return out


SECOND = round(synthetic_crowd.RATE)


@pytest.mark.parametrize("seconds", [0, 1, 2])
def test_who_walks_along_the_edge_keeps_the_id(seconds: int) -> None:
    assert told([2.0, *[EDGE + 0.8 * EXIT_DISTANCE] * (seconds * SECOND), 2.0]) == {1}


def test_who_is_unseen_in_the_area_keeps_the_id() -> None:
    assert told([2.0, *[None] * (10 * SECOND), 2.0]) == {1}


def test_who_went_far_has_a_new_id() -> None:
    assert told([2.0, EDGE + 1.1 * EXIT_DISTANCE, 2.0]) == {1, 2}


@pytest.mark.parametrize("place", [EDGE + 0.5 * EXIT_DISTANCE, None])
def test_who_was_outside_for_long_has_a_new_id_seen_or_not(place: float | None) -> None:
    assert told([2.0, EDGE + 0.5 * EXIT_DISTANCE, *[place] * (round(EXIT_TIME) * SECOND), 2.0]) == {1, 2}


def test_nobody_is_told_of_before_they_come_in() -> None:
    assert told([EDGE + 0.1, EDGE + 3.0, 2.0, 1.0]) == {1}
