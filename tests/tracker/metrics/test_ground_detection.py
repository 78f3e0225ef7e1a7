"""MODA, MODP, precision and recall as the evaluation kit of WILDTRACK has them, against every matching tried out."""

import itertools

import numpy as np
import pytest

from tracker.geometry import Array
from tracker.metrics.ground_detection import score_ground_detections
from tracker.metrics.matching import MatchingFrame

CELL = 0.025
ORIGIN = np.array([-3.0, -9.0])
"""m: WILDTRACK's grid."""


def frame(truth: Array, found: Array) -> MatchingFrame:
    """Positions in cells of the grid."""
    placed = [ORIGIN + CELL * np.asarray(cells, dtype=np.float64).reshape(-1, 2) for cells in (truth, found)]
    return MatchingFrame(np.arange(len(placed[0])), placed[0], np.arange(len(placed[1])), placed[1])


def best_matching(truth: Array, found: Array) -> tuple[int, float]:
    """The most pairs within 20 cells, and of those the largest Σ 1 − d/20, of all injections of the smaller set into the larger."""
    less, more = sorted((truth, found), key=len)
    best = (0, 0.0)
    for chosen in itertools.permutations(range(len(more)), len(less)):
        d = np.linalg.norm(less - more[list(chosen)], axis=1)
        near = d <= 20
        best = max(best, (int(near.sum()), float((1 - d[near] / 20).sum())))
    return best


def test_counts_equal_those_of_all_matchings() -> None:
    rng = np.random.default_rng(3)
    pairs = 0
    for _ in range(60):
        truth, found = (rng.integers(0, 50, (int(rng.integers(1, 6)), 2)) for _ in range(2))
        score = score_ground_detections([frame(truth, found)])
        number, closeness = best_matching(truth, found)
        assert (score["truths"], score["detections"], score["recall"]) == (len(truth), len(found), number / len(truth))
        assert (score["modp"] or 0.0) == pytest.approx(closeness / max(number, 1), abs=1e-6)
        pairs += number
    assert pairs > 60


def test_frames_without_detections_are_left_out_as_in_the_kit() -> None:
    whole = frame(np.array([[10, 10]]), np.array([[10, 10]]))
    empty = frame(np.array([[10, 10], [50, 50]]), np.zeros((0, 2)))
    alone = frame(np.zeros((0, 2)), np.array([[10, 10]]))
    score = score_ground_detections([whole, empty, alone])
    assert [score[name] for name in ("truths", "skipped", "precision", "recall", "moda")] == [1, 1, 0.5, 1.0, 0.0]


def test_nothing_is_undefined_not_zero() -> None:
    assert score_ground_detections([]) == {
        "moda": None, "modp": None, "precision": None, "recall": None, "truths": 0, "detections": 0, "skipped": 0,
    }  # fmt: skip
