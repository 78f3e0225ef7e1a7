"""Tracks of things: told from people by how often and how surely they are found, beside people who have moved."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.geometry import Array
from tracker.tracks.standing_things import StandingThings

VIEWS, PERIOD = 3, 0.2


def judged(rank: Array, found: Array, walks: Array, ticks: int = 60) -> StandingThings:
    """The odds after some ticks of tracks 1 to t. rank, found (t,): of boxes, and share of the views with one. walks (t,): at 1 m/s along x."""
    rng, things = np.random.default_rng(3), StandingThings()
    start = np.column_stack([np.zeros(len(rank)), 3.0 * np.arange(len(rank))])
    for k in range(ticks):
        place = start + np.column_stack([walks * PERIOD * k, np.zeros(len(rank))]) + rng.normal(0.0, 0.03, start.shape)
        ranks = np.clip(rank[:, None] + rng.normal(0.0, 0.1, (len(rank), VIEWS)), 0.0, 1.0)
        ranks[rng.random(ranks.shape) >= found[:, None]] = np.nan
        things.learn(PERIOD, np.arange(1, len(rank) + 1), (place, np.full(len(rank), 0.05)), ranks, np.ones(ranks.shape), set())
    return things


def test_what_stands_and_is_found_seldom_and_unsurely_is_a_thing() -> None:
    things = judged(np.array([0.7, 0.75, 0.7, 0.3]), np.array([0.95, 0.9, 0.95, 0.5]), np.array([1.0, 1.0, 0.0, 0.0]))
    assert things.likely(np.arange(1, 5), 0.8).tolist() == [False, False, False, True]


@pytest.mark.parametrize("found", [0.5, 0.9])
def test_people_who_all_stand_are_people_whatever_the_detector(found: float) -> None:
    """As in a meeting before a weak detector: one walks in, and nobody is found less often than others."""
    things = judged(np.full(6, 0.5), np.full(6, found), np.array([1.0, 0, 0, 0, 0, 0]))
    assert not things.likely(np.arange(1, 7), 0.8).any()


def test_a_thing_is_told_among_many() -> None:
    """More things than people, as a detector with a low threshold has them in a furnished room."""
    rank, found = np.append(np.full(4, 0.8), np.full(10, 0.4)), np.append(np.full(4, 0.95), np.full(10, 0.6))
    things = judged(rank, found, np.append(np.ones(4), np.zeros(10)))
    assert things.likely(np.arange(1, 15), 0.8).tolist() == [False] * 4 + [True] * 10


def nobody(things: StandingThings, alive: set[int]) -> None:
    """A tick at which no track is in the hypothesis."""
    things.learn(PERIOD, np.zeros(0, dtype=np.int64), (np.zeros((0, 2)), np.zeros(0)), np.zeros((0, VIEWS)), np.zeros((0, VIEWS)), alive)


def test_a_hidden_thing_is_remembered_while_its_track_lives() -> None:
    things = judged(np.array([0.7, 0.75, 0.7, 0.3]), np.array([0.95, 0.9, 0.95, 0.5]), np.array([1.0, 1.0, 0.0, 0.0]))
    for _ in range(10):
        nobody(things, {1, 2, 3, 4})
    assert things.likely(np.arange(1, 5), 0.8).tolist() == [False, False, False, True]
    nobody(things, set())
    assert not things.likely(np.arange(1, 5), 0.8).any()


def test_unknown_tracks_are_no_things() -> None:
    things = StandingThings()
    assert not things.likely(np.array([1, 2]), 0.8).any()
    nobody(things, set())
    assert not things.likely(np.array([1]), 0.8).any()
