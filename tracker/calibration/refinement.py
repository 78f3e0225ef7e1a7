"""A given calibration refined: which cameras have moved, and by how much. What the data do not say stays as it is.

All cameras stay at first. The camera against which the data speak most is let free, then the next one, as long as a test is significant. It is the
score test (Rao 1948) with the covariance of clusters (Boos 1992). Of a camera that is free, parameters within their errors of what was given go back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from tracker.calibration.adjustment import Adjusted, Prior, Problem
from tracker.calibration.body import GLOBALS, HEIGHT, NAMES, PITCH, ROLL, YAW
from tracker.calibration.people import Observations
from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Camera

SIGNIFICANCE = 1e-4
"""Probability of a test that finds something where nothing has moved, if errors are as they are modelled."""
SIGMAS = 3.0
"""Deviations within which a parameter of a camera that has moved goes back to what was given."""
ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Refined:
    """The adjusted state, and which parameters (cameras, 11) have moved."""

    adjusted: Adjusted
    moved: Mask


def refine(cameras: Sequence[Camera], seen: Observations, rows: Array, prior: Prior, free: Mask) -> Refined:
    """Let those cameras move that have moved. prior: of all parameters, if they were free. free (cameras,): cameras that are not known at all."""
    moved = np.zeros(rows.shape, dtype=bool)
    usable = prior.sigma > 0
    moved[free] = usable[free]
    problem = Problem(cameras, seen, rows, prior)
    problem.solve(ROUNDS // 2, ~moved.ravel()[problem.free])
    problem.rescale()
    while True:
        _solved(problem, moved)
        name = _worst(problem, moved, usable)
        if name is None:
            break
        moved[name] = usable[name]
    found = _settled(problem, rows, moved, free)
    return Refined(found, moved)


def _solved(problem: Problem, moved: Mask) -> None:
    """Bring what may move to its best state."""
    problem.solve(ROUNDS, ~moved.ravel()[problem.free])
    problem.integrate(held=~moved.ravel()[problem.free])


def _worst(problem: Problem, moved: Mask, usable: Mask) -> int | None:
    """The camera against whose parameters the data speak most, of those that stay; None where none is significant."""
    gradient, information, covariance = problem.information(marginal=True)
    flat = moved.ravel()[problem.free]
    out = np.append(flat, np.ones(len(GLOBALS), dtype=bool))
    best: tuple[float, int] | None = None
    for k in range(len(usable)):
        own = np.flatnonzero((problem.free // len(NAMES) == k) & ~flat)
        if moved[k].any() or not len(own):
            continue
        # What is free follows: the gradient is that after its step.
        follow = np.linalg.solve(information[np.ix_(out, out)], information[np.ix_(out, own)])
        T = np.zeros((len(gradient), len(own)))
        T[own, np.arange(len(own))] = 1.0
        T[out] = -follow
        score = T.T @ gradient
        value = float(score @ np.linalg.pinv(T.T @ covariance @ T, hermitian=True) @ score)
        excess = value / float(chi2.isf(SIGNIFICANCE, len(own)))
        if excess > 1 and (best is None or excess > best[0]):
            best = excess, k
    return None if best is None else best[1]


def _settled(problem: Problem, rows: Array, moved: Mask, free: Mask) -> Adjusted:
    """The state after parameters of moved cameras that are within their errors went back; `moved` is changed."""
    for _ in range(int(moved.sum())):
        sigma = _sigmas(problem, moved)
        ratio = np.where(moved & ~free[:, None], np.abs(problem.rows - rows) / np.maximum(sigma, 1e-12), np.inf)
        if ratio.min() >= SIGMAS:
            break
        back = np.unravel_index(int(np.argmin(ratio)), ratio.shape)
        moved[back] = False
        problem.rows[back] = rows[back]
        # What stays moves little, as that parameter was within its error.
        problem.integrate(2, ~moved.ravel()[problem.free])
    return replace(problem.result(), covariance=_covariance(problem, moved))


def _covariance(problem: Problem, moved: Mask) -> Array:
    """Covariance (cameras · 11, same) of the parameters that move, where the others are known."""
    _, information, meat = problem.information()
    own = np.flatnonzero(np.append(moved.ravel()[problem.free], np.ones(len(GLOBALS), dtype=bool)))
    inverse = np.linalg.pinv(information[np.ix_(own, own)], hermitian=True)
    covariance = inverse @ meat[np.ix_(own, own)] @ inverse
    out, at = np.zeros((moved.size, moved.size)), problem.free[own[: -len(GLOBALS)]]
    out[np.ix_(at, at)] = covariance[: -len(GLOBALS), : -len(GLOBALS)]
    return out


def _sigmas(problem: Problem, moved: Mask) -> Array:
    return np.asarray(np.sqrt(np.diag(_covariance(problem, moved))).reshape(moved.shape))


def changes(names: Sequence[str], rows: Array, refined: Refined) -> list[str]:
    """A line for each parameter that has moved: from, to, and its deviation."""
    out = []
    sigma = np.sqrt(np.abs(np.diag(refined.adjusted.covariance))).reshape(rows.shape)
    for k, p in zip(*(part.tolist() for part in np.nonzero(refined.moved)), strict=True):
        before, now, error = (_shown(p, value) for value in (rows[k, p], refined.adjusted.rows[k, p], sigma[k, p]))
        if p in (0, HEIGHT):
            out.append(f"{names[k]}: {NAMES[p]} is {np.expm1(refined.adjusted.rows[k, p] - rows[k, p]):+.1%} ± {sigma[k, p]:.1%} off")
        else:
            out.append(f"{names[k]}: {NAMES[p]} is {now:.3f} and not {before:.3f} ± {error:.3f} {'°' if p in (PITCH, ROLL, YAW) else ''}".rstrip())
    return out


def _shown(p: int, value: float) -> float:
    return float(np.degrees(value)) if p in (PITCH, ROLL, YAW) else float(value)
