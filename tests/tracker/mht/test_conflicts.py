"""Who excludes whom, and the cost of holding a leaf."""

import numpy as np

from tracker.mht.conflicts import ConflictRows, Conflicts, conflicts_of, k_best_per_tree, max_marginal_losses

LIMITS = 1.0, 2.0, 0.8


def test_bonds_of_children() -> None:
    """Four leaves of trees 1, 1, 2, 3 before two views: the first two share a tree, the second and third a box, and the fourth inherits what its
    parent had against the third's; the third and fourth are near, as were their parents, and each view shows but one of them."""
    old = Conflicts(np.array([[False, True], [True, False]]), np.array([[0, 1.5], [1.5, 0]]))
    box, place = np.array([[0, -1], [1, -1], [1, -1], [-1, 2]]), np.array([[0.0, 0], [5.0, 0], [9.0, 0], [9.5, 0]])
    rows = ConflictRows(np.array([1, 1, 2, 3]), box, place, np.zeros(4, dtype=bool), np.full((4, 2), -0.5))
    bonds = conflicts_of(old, np.array([-1, -1, 0, 1]), rows, np.full(3, 4.0), LIMITS)
    assert np.argwhere(np.triu(bonds.conflict)).tolist() == [[0, 1], [1, 2], [2, 3]]
    assert np.argwhere(np.triu(bonds.together)).tolist() == [[2, 3]]
    assert bonds.together[2, 3] == 1.5 + 2 * 0.5
    np.testing.assert_array_equal(bonds.conflict, bonds.conflict.T)


def test_two_whom_a_view_shows_at_once_are_two() -> None:
    """Two near leaves: seen by the first view both, by the second one of them; the same with one that has ended, of whom it is not asked."""
    old, place = Conflicts(np.zeros((2, 2), dtype=bool), np.full((2, 2), 5.0)), np.array([[0.0, 0], [0.5, 0]])
    for over, expected in ((False, 5.0 + 0.3 - 0.8 * 4.0), (True, 0.0)):
        rows = ConflictRows(np.array([1, 2]), np.array([[0, 2], [1, -1]]), place, np.array([False, over]), np.array([[-0.3, -0.3], [-2.0, -2.0]]))
        together = conflicts_of(old, np.array([0, 1]), rows, np.array([6.0, 4.0, 6.0]), LIMITS).together
        np.testing.assert_allclose(together, [[0.0, expected], [expected, 0.0]])


def test_regret_is_what_a_leaf_costs_the_best() -> None:
    # Trees 0, 1, 2 with leaves a b, c d, e. Best: a, c, e = 9 + 8 + 5. b excludes c: b, d, e = 7 + 6 + 5. d excludes e: a, d = 9 + 6.
    weight, tree = np.array([9.0, 7.0, 8.0, 6.0, 5.0]), np.array([0, 0, 1, 1, 2])
    conflict = tree[:, None] == tree[None, :]
    np.fill_diagonal(conflict, False)
    conflict[1, 2] = conflict[2, 1] = conflict[3, 4] = conflict[4, 3] = True
    regret = max_marginal_losses(weight, conflict, tree, np.array([0, 2, 4]))
    np.testing.assert_allclose(regret, [0, (9 - 7) + (8 - 6), 0, (8 - 6) + 5, 0])


def test_leaders_are_the_best_of_a_tree_and_differ() -> None:
    state = np.array([[0.0, 0, 0, 0], [0.01, 0, 0, 0], [1.0, 0, 0, 0], [2.0, 0, 0, 0], [0.0, 0, 0, 0]])
    box = np.zeros((5, 1), dtype=np.int64)
    keep = k_best_per_tree(np.array([1, 1, 1, 1, 2]), box, state, np.array([0.0, 1.0, 2.0, 3.0, 0.0]), np.full(5, 2))
    assert keep.tolist() == [True, False, True, False, True]
