"""Track ids: a person who leaves the area and comes back has a new id, and one who stays on its edge does not."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.tracks.tracks import EXIT_DISTANCE, EXIT_TIME, TrackIds, Tracks

EDGE = 2.3


def reported_ids(x: list[float | None]) -> set[int]:
    """Reported ids of one person, tree 7, at x (m) in each tick, None for no track; the area ends at EDGE."""
    track_ids, out = TrackIds(synthetic_crowd.setup(area=np.array([[-10.0, -10.0], [EDGE, 10.0]]))), set()
    for k, place in enumerate(x):
        n, one = int(place is not None), np.ones(int(place is not None), dtype=np.int64)
        state = np.zeros((n, 5))
        state[:, 0] = place or 0.0
        ids, feet, _ = track_ids.report(Tracks(7 * one, state, np.tile(np.eye(5), (n, 1, 1)), 1.0 * one, 0 * one), k / synthetic_crowd.RATE)
        assert len(ids) == len(feet) == int(place is not None and place <= EDGE)
        out |= set(ids.tolist())
    return out


SECOND = round(synthetic_crowd.RATE)


@pytest.mark.parametrize("seconds", [0, 1, 2])
def test_a_person_on_the_edge_keeps_the_id(seconds: int) -> None:
    assert reported_ids([2.0, *[EDGE + 0.8 * EXIT_DISTANCE] * (seconds * SECOND), 2.0]) == {1}


def test_an_undetected_person_in_the_area_keeps_the_id() -> None:
    assert reported_ids([2.0, *[None] * (10 * SECOND), 2.0]) == {1}


def test_a_person_who_goes_far_has_a_new_id() -> None:
    assert reported_ids([2.0, EDGE + 1.1 * EXIT_DISTANCE, 2.0]) == {1, 2}


@pytest.mark.parametrize("place", [EDGE + 0.5 * EXIT_DISTANCE, None])
def test_a_person_outside_for_long_has_a_new_id(place: float | None) -> None:
    assert reported_ids([2.0, EDGE + 0.5 * EXIT_DISTANCE, *[place] * (round(EXIT_TIME) * SECOND), 2.0]) == {1, 2}


def test_nobody_is_reported_outside_the_area() -> None:
    assert reported_ids([EDGE + 0.1, EDGE + 3.0, 2.0, 1.0]) == {1}
