"""What a team remembers of people: how they move, where they must be once nobody tells of them, and when that is over."""

import numpy as np
import pytest

from sim.placement.tracker_in_loop import LASTING, TrackMemory

DT = 0.25
COVARIANCE = 0.04 * np.eye(2)[None]


def walked(frames: int) -> TrackMemory:
    """Person 7 walks east at 1.2 m/s from the origin, and is told of in so many frames."""
    recall = TrackMemory()
    for k in range(frames):
        recall.take(np.array([7]), np.array([[1.2 * DT * k, 0.0]]), COVARIANCE, DT)
    return recall


def nobody(recall: TrackMemory, frames: int) -> None:
    for _ in range(frames):
        recall.take(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), DT)


def test_velocity_is_learnt() -> None:
    np.testing.assert_allclose(walked(20).velocity, [[1.2, 0.0]], atol=1e-3)


def test_who_is_told_of_no_more_goes_on_and_becomes_unsure() -> None:
    recall = walked(20)
    last = recall.position[0, 0]
    nobody(recall, 8)
    assert recall.number.tolist() == [7]
    assert recall.position[0, 0] == pytest.approx(last + 1.2 * 8 * DT, abs=0.02)
    # Twice the time is eight times the variance that was added.
    early = recall.covariance[0, 0, 0] - 0.04
    nobody(recall, 8)
    assert recall.covariance[0, 0, 0] - 0.04 == pytest.approx(8 * early)
    nobody(recall, round(LASTING / DT))
    assert len(recall.number) == 0


def test_a_new_number_where_somebody_must_be_takes_the_old_ones_place() -> None:
    recall = walked(20)
    nobody(recall, 4)
    recall.take(np.array([9, 8]), np.array([[recall.position[0, 0] + 0.5, 0.3], [9.0, 9.0]]), np.repeat(COVARIANCE, 2, axis=0), DT)
    assert recall.number.tolist() == [9, 8]
    np.testing.assert_array_equal(recall.unseen, 0)
