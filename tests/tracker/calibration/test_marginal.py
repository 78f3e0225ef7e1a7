"""Covariances of paths and statures are those of the inverse of the whole matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from tracker.calibration.marginal import PeoplesPaths, local_covariances


@pytest.mark.parametrize("count", [[6, 3, 9], [3, 8, 4]])
def test_covariances_at_observations_are_those_of_the_inverse(count: list[int]) -> None:
    rng = np.random.default_rng(3)
    first, knots, people = np.cumsum([0, *count[:-1]]), sum(count), len(count)
    person = rng.integers(0, people, 60)
    at = first[person] + rng.integers(0, np.array(count)[person] - 1)
    share = rng.uniform(0.0, 1.0, 60)
    middle = np.concatenate([f + np.arange(1, n - 1) for f, n in zip(first, count, strict=True)])
    smooth = sparse.csr_matrix(np.eye(knots)[middle - 1] - 2 * np.eye(knots)[middle] + np.eye(knots)[middle + 1])
    K, rows = np.zeros((3 * 60, people + 2 * knots)), np.arange(60)
    A = np.zeros((60, 3, people + 2 * knots))
    A[rows, 0, person] = 1.0
    for axis in (0, 1):
        A[rows, 1 + axis, people + axis * knots + at], A[rows, 1 + axis, people + axis * knots + at + 1] = 1 - share, share
    K = (rng.normal(size=(60, 3, 3)) @ A).reshape(180, -1)
    D = sparse.block_diag([3.0 * sparse.eye(people), smooth, smooth])
    information = sparse.csc_matrix(K.T @ K + D.T @ D + 1e-6 * np.eye(K.shape[1]))
    inverse = np.linalg.inv(information.toarray())
    found, decided = local_covariances(PeoplesPaths(person, at, share, first, np.array(count)), information, smooth)
    assert np.allclose(found, A @ inverse @ A.transpose(0, 2, 1), rtol=1e-6, atol=1e-8)
    rough = sparse.block_diag([smooth, smooth]).toarray()
    assert np.isclose(decided, 2 * knots - np.trace(rough.T @ rough @ inverse[people:, people:]))
