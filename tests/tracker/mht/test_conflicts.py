"""Conflicts between leaves, the max-marginal loss of a leaf, and the best leaves of a tree."""

import numpy as np

from tracker.mht.conflicts import ConflictRows, Conflicts, conflicts_of, k_best_per_tree, max_marginal_losses

LIMITS = 1.0, 2.0, 0.8


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


def test_loss_is_the_weight_that_the_best_hypothesis_loses_to_hold_a_leaf() -> None:
    # Trees 0, 1, 2 with leaves a b, c d, e. Best: a, c, e = 9 + 8 + 5. b excludes c: b, d, e = 7 + 6 + 5. d excludes e: a, d = 9 + 6.
    weight, tree = np.array([9.0, 7.0, 8.0, 6.0, 5.0]), np.array([0, 0, 1, 1, 2])
    conflict = tree[:, None] == tree[None, :]
    np.fill_diagonal(conflict, False)
    conflict[1, 2] = conflict[2, 1] = conflict[3, 4] = conflict[4, 3] = True
    loss = max_marginal_losses(weight, conflict, tree, np.array([0, 2, 4]))
    np.testing.assert_allclose(loss, [0, (9 - 7) + (8 - 6), 0, (8 - 6) + 5, 0])


def test_the_best_leaves_of_a_tree_are_kept_without_near_duplicates() -> None:
    state = np.array([[0.0, 0, 0, 0], [0.01, 0, 0, 0], [1.0, 0, 0, 0], [2.0, 0, 0, 0], [0.0, 0, 0, 0]])
    box = np.zeros((5, 1), dtype=np.int64)
    keep = k_best_per_tree(np.array([1, 1, 1, 1, 2]), box, state, np.array([0.0, 1.0, 2.0, 3.0, 0.0]), np.full(5, 2))
    assert keep.tolist() == [True, False, True, False, True]
