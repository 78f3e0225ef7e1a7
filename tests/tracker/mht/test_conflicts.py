"""Conflicts between leaves: shared trees and boxes, and inherited conflicts."""

from dataclasses import replace

import numpy as np

from tracker.detections.cross_view import CrossViewGroup
from tracker.mht.conflicts import conflicts_of, of_one_body
from tracker.mht.track_trees import TrackHypotheses, initiated
from tracker.tracks.tracks import MotionParameters


def test_children_share_trees_and_boxes_and_inherit_conflicts() -> None:
    """Four leaves of trees 1, 1, 2, 3 in two views. The first two share a tree, the second and third a box; the fourth inherits a conflict with the
    third."""
    old, box = np.array([[False, True], [True, False]]), np.array([[0, -1], [1, -1], [1, -1], [-1, 2]])
    conflict = conflicts_of(old, np.array([-1, -1, 0, 1]), np.array([1, 1, 2, 3]), box)
    assert np.argwhere(np.triu(conflict)).tolist() == [[0, 1], [1, 2], [2, 3]]
    np.testing.assert_array_equal(conflict, conflict.T)


def remembering(*paths: list[float]) -> TrackHypotheses:
    """A leaf of its own tree for each path: x (k,) m of the last ticks, the latest first."""
    groups = [CrossViewGroup(((0, k),), np.array([path[0], 0.0]), np.eye(2)) for k, path in enumerate(paths)]
    leaves = initiated(1, groups, MotionParameters(), (1.7, 0.1), (4, 0, 0))
    for k, path in enumerate(paths):
        leaves.states[k, : len(path), 0], leaves.age[k] = path, len(path)
    return leaves


def test_two_tracks_that_stay_too_near_each_other_are_of_one_person() -> None:
    walker, beside = [0.0, 1.0, 2.0, 3.0], [0.2, 1.2, 2.2, 3.2]
    arms_length, crossing, new = [0.4, 1.4, 2.4, 3.4], [0.1, -0.9, -1.9, -2.9], [0.25]
    one = of_one_body(remembering(walker, beside, arms_length, crossing, new), 0.3)
    assert np.argwhere(np.triu(one)).tolist() == [[0, 1], [0, 4], [1, 2], [1, 4], [2, 4], [3, 4]]
    np.testing.assert_array_equal(one, one.T)
    assert not of_one_body(remembering(walker, beside), 0.0).any()
    leaves = remembering(walker, beside)
    assert not of_one_body(replace(leaves, deleted=np.array([True, False])), 0.3).any()
