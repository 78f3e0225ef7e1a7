"""Conflicts between leaves: shared trees and boxes, and inherited conflicts."""

import numpy as np

from tracker.mht.conflicts import conflicts_of


def test_children_share_trees_and_boxes_and_inherit_conflicts() -> None:
    """Four leaves of trees 1, 1, 2, 3 in two views. The first two share a tree, the second and third a box; the fourth inherits a conflict with the
    third. Places play no part: people may stand as near each other as bodies can."""
    old, box = np.array([[False, True], [True, False]]), np.array([[0, -1], [1, -1], [1, -1], [-1, 2]])
    conflict = conflicts_of(old, np.array([-1, -1, 0, 1]), np.array([1, 1, 2, 3]), box)
    assert np.argwhere(np.triu(conflict)).tolist() == [[0, 1], [1, 2], [2, 3]]
    np.testing.assert_array_equal(conflict, conflict.T)
