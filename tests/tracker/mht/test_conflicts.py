"""Conflicts between leaves: shared trees and boxes, inherited conflicts, and one person for two leaves."""

import numpy as np

from tracker.mht.conflicts import ConflictRows, Conflicts, MergeLimits, conflicts_of

LIMITS = MergeLimits(1.0, 2.0, 0.8)


def test_children_share_trees_and_boxes_and_inherit_conflicts() -> None:
    """Four leaves of trees 1, 1, 2, 3 in two views. The first two share a tree, the second and third a box; the fourth inherits a conflict with the
    third. The third and fourth are near each other, as were their parents, and no view has boxes of both."""
    old = Conflicts(np.array([[False, True], [True, False]]), np.array([[0, 1.5], [1.5, 0]]))
    box, place = np.array([[0, -1], [1, -1], [1, -1], [-1, 2]]), np.array([[0.0, 0], [5.0, 0], [9.0, 0], [9.5, 0]])
    rows = ConflictRows(np.array([1, 1, 2, 3]), box, place, np.zeros(4, dtype=bool), np.full((4, 2), -0.5))
    conflicts = conflicts_of(old, np.array([-1, -1, 0, 1]), rows, np.full(3, 4.0), LIMITS)
    assert np.argwhere(np.triu(conflicts.conflict)).tolist() == [[0, 1], [1, 2], [2, 3]]
    assert np.argwhere(np.triu(conflicts.same_person)).tolist() == [[2, 3]]
    assert conflicts.same_person[2, 3] == 1.5 + 2 * 0.5
    np.testing.assert_array_equal(conflicts.conflict, conflicts.conflict.T)


def test_two_boxes_in_one_view_count_against_one_person() -> None:
    """Two near leaves: the first view has boxes of both, the second of one. The same where one is deleted, which takes no part."""
    old, place = Conflicts(np.zeros((2, 2), dtype=bool), np.full((2, 2), 5.0)), np.array([[0.0, 0], [0.5, 0]])
    for deleted, expected in ((False, 5.0 + 0.3 - 0.8 * 4.0), (True, 0.0)):
        rows = ConflictRows(np.array([1, 2]), np.array([[0, 2], [1, -1]]), place, np.array([False, deleted]), np.array([[-0.3, -0.3], [-2.0, -2.0]]))
        same_person = conflicts_of(old, np.array([0, 1]), rows, np.array([6.0, 4.0, 6.0]), LIMITS).same_person
        np.testing.assert_allclose(same_person, [[0.0, expected], [expected, 0.0]])
