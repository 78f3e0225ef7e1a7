"""Paths and statures integrated out of an adjustment, by Laplace's approximation (MacKay 1992).

If paths are estimated jointly with a few cameras, they absorb noise, and the cameras' estimates are biased (Neyman and Scott 1948).
The marginal density of the cameras contains the determinant of the information of paths and statures, which removes the bias.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from tracker.geometry import Array, Ints


class PeoplesPaths(NamedTuple):
    """Indices of people's unknowns. Of each observation: person (n,), knot (n,), share (n,) of the next knot; of people: first knot, counts."""

    person: Ints
    at: Ints
    share: Array
    first: Ints
    counts: Ints


class _Inverse:
    """The inverse of the information of knots near its diagonal. Two knots are a block of four: x, y, x, y. A path is block tridiagonal."""

    def __init__(self, paths: PeoplesPaths, information: sparse.csc_matrix) -> None:
        knots = int(paths.counts.sum())
        self.person = np.repeat(np.arange(len(paths.first)), paths.counts)
        self.local = np.arange(knots) - np.repeat(paths.first, paths.counts)
        people, most = len(paths.first), int((paths.counts.max() + 1) // 2)
        diagonal, beside = np.tile(np.eye(4), (people, most, 1, 1)), np.zeros((people, most, 4, 4))
        entries = information.tocoo()
        (p, b, i), (_, c, j) = self._places(entries.row, knots), self._places(entries.col, knots)
        same, after = b == c, b + 1 == c
        diagonal[p[same], b[same], i[same], j[same]] = entries.data[same]
        beside[p[after], b[after], i[after], j[after]] = entries.data[after]
        whole, follow = np.empty_like(diagonal), np.empty_like(diagonal)
        S = diagonal[:, 0]
        for k in range(most):
            whole[:, k] = np.linalg.inv(S)
            follow[:, k] = whole[:, k] @ beside[:, k]
            if k + 1 < most:
                S = diagonal[:, k + 1] - beside[:, k].transpose(0, 2, 1) @ follow[:, k]
        self.beside = np.zeros_like(diagonal)
        for k in range(most - 2, -1, -1):
            self.beside[:, k] = -follow[:, k] @ whole[:, k + 1]
            whole[:, k] -= self.beside[:, k] @ follow[:, k].transpose(0, 2, 1)
        self.whole = whole

    def _places(self, index: Ints, knots: int) -> tuple[Ints, Ints, Ints]:
        """Person, block, and place in it, of the unknowns `index`: x of all knots, then y."""
        axis, knot = index // knots, index % knots
        return self.person[knot], self.local[knot] // 2, 2 * (self.local[knot] % 2) + axis

    def pairs(self, at: Ints) -> Array:
        """Covariances (n, 4, 4) of knots `at` (n,) and the next ones: x, y, x, y."""
        p, b = self.person[at], self.local[at] // 2
        out = self.whole[p, b].copy()
        odd = np.flatnonzero(self.local[at] % 2)
        p, b = p[odd], b[odd]
        across = self.beside[p, b][:, 2:, :2]
        ends = self.whole[p, b][:, 2:, 2:], self.whole[p, np.minimum(b + 1, self.whole.shape[1] - 1)][:, :2, :2]
        out[odd] = np.block([[ends[0], across], [across.transpose(0, 2, 1), ends[1]]])
        return out

    def trace(self, matrix: sparse.spmatrix, knots: int) -> float:
        """Trace of the inverse times a symmetric matrix (knots, knots) for each axis, of bandwidth two."""
        entries, total = matrix.tocoo(), 0.0
        for axis in (0, 1):
            (p, b, i), (_, c, j) = (self._places(one + axis * knots, knots) for one in (entries.row, entries.col))
            same, after = b == c, b + 1 == c
            total += float((self.whole[p[same], b[same], i[same], j[same]] * entries.data[same]).sum())
            total += 2 * float((self.beside[p[after], b[after], i[after], j[after]] * entries.data[after]).sum())
        return total


def local_covariances(paths: PeoplesPaths, information: sparse.csc_matrix, smooth: sparse.csr_matrix) -> tuple[Array, float]:
    """Posterior covariances (n, 3, 3) of stature and place at each observation; and the degrees of freedom of all paths that the data determine.

    information: of statures, then x, then y of all knots. smooth: second differences of the knots of one axis over their standard deviation.
    """
    people, knots = len(paths.first), int(paths.counts.sum())
    of_paths, own = information[people:, people:].tocsc(), information.diagonal()[:people]
    inverse = _Inverse(paths, of_paths)
    # Columns of the border have disjoint rows, so one solve serves all.
    border = np.asarray(information[:people, people:].sum(axis=0)).ravel()
    along = splu(of_paths).solve(border)
    owner = np.tile(inverse.person, 2)
    variance = 1 / np.maximum(own - np.bincount(owner, border * along, people), 1e-9)
    rough = smooth @ along.reshape(2, -1).T
    of_smooth = inverse.person[np.asarray(abs(smooth).argmax(axis=1)).ravel()]
    prior = inverse.trace(smooth.T @ smooth, knots) + float((np.bincount(of_smooth, (rough**2).sum(axis=1), people) * variance).sum())
    mix = np.zeros((len(paths.at), 2, 4))
    mix[:, [0, 1], [0, 1]], mix[:, [0, 1], [2, 3]] = (1 - paths.share)[:, None], paths.share[:, None]
    away = np.column_stack([along[paths.at], along[paths.at + knots], along[paths.at + 1], along[paths.at + 1 + knots]])
    lean = (mix @ away[:, :, None])[:, :, 0]
    out, v = np.empty((len(paths.at), 3, 3)), variance[paths.person]
    out[:, 0, 0] = v
    out[:, 0, 1:] = out[:, 1:, 0] = -v[:, None] * lean
    out[:, 1:, 1:] = mix @ inverse.pairs(paths.at) @ mix.transpose(0, 2, 1) + v[:, None, None] * lean[:, :, None] * lean[:, None, :]
    return out, 2.0 * knots - prior
