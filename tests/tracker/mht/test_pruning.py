"""Pruning of leaves: the loss of holding a leaf, and the best leaves of a tree."""

import numpy as np

from tracker.mht.pruning import k_best_per_tree, max_marginal_losses


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
