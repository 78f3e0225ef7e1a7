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
from tracker.recordings import Recording
from tracker.recordings.calibration_errors import swapped_cameras
from tracker.recordings.calibration_feet import CalibrationCase

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


def unswapped(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording whose cameras have the calibration that their boxes fit, and a line where two were swapped, as `pilsim check` finds it."""
    if any(camera.unknown for camera in recording.fixed.values()):
        return recording, []
    found = swapped_cameras(CalibrationCase.of(replace(recording, truth=None)))
    if found is None:
        return recording, []
    first, second = found[0].cameras
    cameras = {**recording.cameras, first: recording.cameras[second], second: recording.cameras[first]}
    return replace(recording, cameras=cameras), [found[0].words]


def refine(cameras: Sequence[Camera], seen: Observations, rows: Array, prior: Prior, free: Mask) -> Refined:
    """Let those cameras move that have moved. prior: of all parameters, if they were free. free (cameras,): cameras that are not known at all."""
    moved = np.zeros(rows.shape, dtype=bool)
    usable = prior.sigma > 0
    moved[free] = usable[free]
    problem = Problem(cameras, seen, rows, prior)
    problem.solve(ROUNDS // 2, _held(problem, moved))
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
    problem.solve(ROUNDS, _held(problem, moved))
    problem.integrate(held=_held(problem, moved))


def _worst(problem: Problem, moved: Mask, usable: Mask) -> int | None:
    """The camera against whose parameters the data speak most, of those that stay; None where none is significant."""
    gradient, information, covariance, _ = problem.information(marginal=True)
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
        sigma = np.sqrt(np.diag(problem.covariance(_held(problem, moved)))).reshape(moved.shape)
        ratio = np.where(moved & ~free[:, None], np.abs(problem.rows - rows) / np.maximum(sigma, 1e-12), np.inf)
        if ratio.min() >= SIGMAS:
            break
        back = np.unravel_index(int(np.argmin(ratio)), ratio.shape)
        moved[back] = False
        problem.rows[back] = rows[back]
        # What stays moves little, as that parameter was within its error.
        problem.integrate(2, _held(problem, moved))
    return problem.result(problem.covariance(_held(problem, moved)))


def _held(problem: Problem, moved: Mask) -> Mask:
    """Which of the free parameters (free,) of a problem stay."""
    return np.asarray(~moved.ravel()[problem.free])


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
