"""The best set of leaves by branch and bound against all sets, and the cost of holding a leaf."""

from itertools import product

import numpy as np
import pytest

from tracker.bonds import heaviest, leaders, parts, regrets


def problem(rng: np.random.Generator, trees: int, leaves: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, conflicts and trees; within a tree the heaviest comes first."""
    tree = np.repeat(np.arange(trees), leaves)
    weight = -np.sort(-rng.uniform(1, 10, (trees, leaves)), axis=1).ravel()
    conflict = rng.random((len(tree), len(tree))) < 0.4
    conflict = conflict | conflict.T | (tree[:, None] == tree[None, :])
    np.fill_diagonal(conflict, False)
    return weight, conflict, tree


@pytest.mark.parametrize("seed", range(20))
def test_branch_and_bound_finds_the_heaviest_set(seed: int) -> None:
    weight, conflict, _ = problem(np.random.default_rng(seed), 5, 3)
    best, proved = heaviest(weight, conflict, np.arange(0, 16, 3), np.zeros(15, dtype=bool), 100_000)
    assert proved
    assert not conflict[np.ix_(best, best)].any()
    most = 0.0
    for choice in product(range(4), repeat=5):
        rows = [3 * t + k for t, k in enumerate(choice) if k < 3]
        if not conflict[np.ix_(rows, rows)].any():
            most = max(most, float(weight[rows].sum()))
    assert weight[best].sum() == pytest.approx(most)


def test_a_cap_leaves_what_was_known() -> None:
    weight, conflict, _ = problem(np.random.default_rng(0), 5, 3)
    known = np.zeros(15, dtype=bool)
    known[4] = True
    best, proved = heaviest(weight, conflict, np.arange(0, 16, 3), known, 1)
    assert not proved
    np.testing.assert_array_equal(best, known)


def test_regret_is_what_a_leaf_costs_the_best() -> None:
    # Trees 0, 1, 2 with leaves a b, c d, e. Best: a, c, e = 9 + 8 + 5. b excludes c: b, d, e = 7 + 6 + 5. d excludes e: a, d = 9 + 6.
    weight, tree = np.array([9.0, 7.0, 8.0, 6.0, 5.0]), np.array([0, 0, 1, 1, 2])
    conflict = tree[:, None] == tree[None, :]
    np.fill_diagonal(conflict, False)
    conflict[1, 2] = conflict[2, 1] = conflict[3, 4] = conflict[4, 3] = True
    regret = regrets(weight, conflict, tree, np.array([0, 2, 4]))
    np.testing.assert_allclose(regret, [0, (9 - 7) + (8 - 6), 0, (8 - 6) + 5, 0])


def test_leaders_are_the_best_of_a_tree_and_differ() -> None:
    state = np.array([[0.0, 0, 0, 0], [0.01, 0, 0, 0], [1.0, 0, 0, 0], [2.0, 0, 0, 0], [0.0, 0, 0, 0]])
    box = np.zeros((5, 1), dtype=np.int64)
    keep = leaders(np.array([1, 1, 1, 1, 2]), box, state, np.array([0.0, 1.0, 2.0, 3.0, 0.0]), np.full(5, 2))
    assert keep.tolist() == [True, False, True, False, True]


def test_parts_are_what_conflicts_connect() -> None:
    conflict = np.zeros((6, 6), dtype=bool)
    for a, b in ((0, 3), (3, 5), (1, 2)):
        conflict[a, b] = conflict[b, a] = True
    assert parts(conflict, np.arange(6)).tolist() == [0, 1, 1, 0, 2, 0]
    assert parts(conflict, np.array([0, 5, 1])).tolist() == [0, 1, 2]
    assert not len(parts(conflict, np.zeros(0, dtype=np.int64)))
