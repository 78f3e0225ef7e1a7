"""The motion of one camera's people into the frame of another one is found by the likelihood of pairs of tracklets."""

from __future__ import annotations

import numpy as np

from tracker.calibration.registration import guesses
from tracker.calibration.tracklet_pairs import GroundMotion, Paths, TrackletPairs, evidence


def walks(seed: int) -> Paths:
    """Ten people who walk for 20 of 80 steps."""
    rng = np.random.default_rng(seed)
    z, here = np.zeros((10, 80), dtype=np.complex128), np.zeros((10, 80))
    for k in range(10):
        begin = int(rng.integers(0, 60))
        step = 0.3 * np.exp(1j * (rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.3, 20))))
        z[k, begin : begin + 20], here[k, begin : begin + 20] = complex(*rng.uniform(-5, 5, 2)) + np.cumsum(step), 1.0
    return Paths(z, here, 5.0 * here, np.arange(10))


def seen_from(paths: Paths, turn: complex, shift: complex, late: int) -> Paths:
    """The same people in another frame, whose clock is `late` steps late."""
    z = (paths.z - shift) / turn * paths.here
    return Paths(np.roll(z, -late, axis=1), np.roll(paths.here, -late, axis=1), paths.range, paths.track)


def test_the_right_motion_is_likeliest_and_clear() -> None:
    turn, shift, late = complex(np.exp(0.8j)), 3.0 - 2.0j, 4
    first = walks(1)
    pairs = TrackletPairs(first, seen_from(first, turn, shift, late))
    tried = guesses(pairs, 6)[:50]
    best = max(tried, key=lambda motion: pairs.likelihood(motion)[0])
    assert best.steps == late
    assert abs(best.turn - turn) < 1e-3
    assert abs(best.shift - shift) < 1e-2
    assert evidence(first, pairs.b.placed(best)).clear
    for motion in tried:
        assert pairs.likelihood(motion)[0] <= pairs.bound(motion) + 1e-9


def test_other_people_at_the_same_places_are_no_evidence() -> None:
    """In a crowd, places agree by chance. People who walk elsewhere at other times do not."""
    first, others = walks(1), walks(2)
    assert not evidence(first, others).clear
    assert not evidence(first, first.rolled(30)).clear
    assert evidence(first, first).ratio > 5 * evidence(first, others).ratio


def test_a_tracklet_has_one_partner_at_a_time() -> None:
    """Two tracklets of one camera on one path share a partner of the other camera only where they do not overlap in time."""
    alone = walks(1).select(np.array([0]))
    middle = int(alone.here[0].argmax()) + 10
    early, late = alone.between(0, middle), alone.between(middle, alone.z.shape[1])

    def padded(before: np.ndarray, after: np.ndarray) -> np.ndarray:
        return np.concatenate([np.pad(before, ((0, 0), (0, after.shape[1]))), np.pad(after, ((0, 0), (before.shape[1], 0)))])

    halves = Paths(*(padded(getattr(early, name), getattr(late, name)) for name in ("z", "here", "range")), np.array([0, 1]))
    assert [TrackletPairs(alone, other).likelihood(GroundMotion())[1] for other in (alone, halves, alone.select(np.array([0, 0])))] == [20, 20, 20]
