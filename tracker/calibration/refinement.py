"""A given calibration refined: which cameras have moved, and by how much. What the data do not say stays as it is.

All cameras stay at first. Each camera in turn is found anew among the others. The one whose parameters then differ most from what was given is let
free, then the next one, as long as Wald's test is significant. Its covariance is that of clusters. A test at what was given would not find great
errors: there, boxes of that camera are outliers, or its errors of boxes seem large. Parameters within their errors of what was given go back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from tracker.calibration.adjustment import Adjusted, Prior, Problem, adjust
from tracker.calibration.body import FOCAL, HEIGHT, NAMES, OFFSET, PITCH, ROLL, YAW, X, Y
from tracker.calibration.people import Observations, observations
from tracker.calibration.registration import CameraBoxes
from tracker.calibration.single_view import single_view
from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Camera
from tracker.recordings import Recording
from tracker.recordings.calibration_errors import swapped_cameras
from tracker.recordings.calibration_feet import CalibrationCase

SIGNIFICANCE = 1e-4
"""Probability of a test that finds something where nothing has moved, if errors are as they are modelled."""
TESTED = 7
"""Parameters of a camera that are tested: focal length, angles, place."""
SIGMAS = 3.0
"""Deviations within which a parameter of a camera that has moved goes back to what was given."""
ROUNDS = 12
TIGHTER, FEW_ROUNDS, MOST = (2.0, 1.0), 8, 1200
"""Factors of the errors within which tracklets are joined, steps of an adjustment, and most boxes, where a camera is found anew."""
LIKE_OTHERS = 1.5
"""Errors of edges over those of the usual camera, below which no other start is tried."""


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


def moved_cameras(views: Mapping[str, CameraBoxes], steps: int, rows: Array, free: Prior, lost: Mask) -> tuple[Array, Mask]:
    """Parameters (cameras, 11) near the best ones, and which cameras (cameras,) have moved: at most half of them, as the others define the world.

    rows: as given. free: prior of all parameters, if they were free. lost (cameras,): cameras that are not known at all.
    """
    found, moved = rows.copy(), lost.copy()
    most = max(len(rows) // 2, 1)
    while moved.sum() < most + lost.sum() and not moved.all():
        tests = {int(k): _found_anew(views, steps, found, _alone(free, moved, int(k)), int(k)) for k in np.flatnonzero(~moved)}
        worst = max(tests, key=lambda k: tests[k][0])
        # Calibrations have errors of their own, and so have models of boxes: by these all cameras differ from what was given.
        usual = max(float(np.quantile([one for one, _ in tests.values()], 0.5, method="lower")), 1.0) if len(tests) > 2 else 1.0
        if tests[worst][0] <= usual * float(chi2.isf(SIGNIFICANCE, TESTED) / TESTED):
            break
        found, moved[worst] = tests[worst][1], True
    return found, moved


def _free(prior: Prior, moved: Mask) -> Mask:
    """Parameters (cameras, 11) that are free where these cameras (cameras,) have moved: all of theirs, and the clocks of all but the first.

    Where all have moved, the first one defines the world.
    """
    free = moved[:, None] & (prior.sigma > 0)
    free[1:, OFFSET] = True
    if moved.all():
        free[0, [X, Y, YAW]] = False
    free[0, OFFSET] = False
    return free


def _alone(prior: Prior, moved: Mask, k: int) -> Prior:
    """The prior where cameras stay as they are but for those that have moved, and for camera k."""
    return replace(prior, sigma=np.where(_free(prior, moved | (np.arange(len(moved)) == k)), prior.sigma, 0.0))


def _found_anew(views: Mapping[str, CameraBoxes], steps: int, rows: Array, prior: Prior, k: int) -> tuple[float, Array]:
    """Wald's statistic of the parameters of camera k but its clock, over their number, and the parameters (cameras, 11) with it found anew."""
    names, cameras = list(views), [view.camera for view in views.values()]
    view = list(views.values())[k]
    best: tuple[Adjusted, Observations] | None = None
    for start in (rows[k], _by_itself(view, rows[k])):
        tried = rows.copy()
        tried[k] = start
        for tight in TIGHTER:
            seen = observations(views, dict(zip(names, tried, strict=True)), steps, tight, MOST)
            adjusted = adjust(cameras, seen, tried, prior, FEW_ROUNDS, integrated=False)
            tried = adjusted.rows
        if best is None or adjusted.edges[k].max() < best[0].edges[k].max():
            best = adjusted, seen
        worst = best[0].edges.max(axis=1)
        if worst[k] < LIKE_OTHERS * np.median(worst):
            break
    assert best is not None
    found = adjust(cameras, best[1], best[0].rows, prior, FEW_ROUNDS)
    own = np.setdiff1d(np.flatnonzero(prior.sigma[k] > 0), [OFFSET])
    apart, at = (found.rows - rows)[k, own], k * len(NAMES) + own
    value = float(apart @ np.linalg.pinv(found.covariance[np.ix_(at, at)], hermitian=True) @ apart)
    return value / len(own), found.rows


def _by_itself(view: CameraBoxes, row: Array) -> Array:
    """Parameters (11,) of a camera where it was given, which looks as its own boxes say."""
    single = single_view(view.camera, view.table, False)
    return row if single is None else np.where(np.isin(np.arange(len(row)), [FOCAL, PITCH, ROLL, HEIGHT]), single.row, row)


def refine(cameras: Sequence[Camera], seen: Observations, rows: tuple[Array, Array], prior: Prior, moved: tuple[Mask, Mask]) -> tuple[Adjusted, Mask]:
    """Adjust the cameras that have moved. Returns the adjusted state, and which parameters (cameras, 11) have moved.

    rows: parameters (cameras, 11) as given, and near the best ones. prior: as moved_cameras has it. moved: which cameras (cameras,) have, and which
    of them are not known at all.
    """
    free = _free(prior, moved[0])
    problem = Problem(cameras, seen, rows[1], prior)
    problem.solve(ROUNDS // 2, _held(problem, free))
    problem.rescale()
    problem.solve(ROUNDS, _held(problem, free))
    problem.integrate(held=_held(problem, free))
    return _settled(problem, rows[0], free, moved[1]), free


def _settled(problem: Problem, rows: Array, moved: Mask, lost: Mask) -> Adjusted:
    """The state after parameters of moved cameras that are within their errors went back; `moved` is changed."""
    for _ in range(int(moved.sum())):
        sigma = np.sqrt(np.diag(problem.covariance(_held(problem, moved)))).reshape(moved.shape)
        ratio = np.where(moved & ~lost[:, None], np.abs(problem.rows - rows) / np.maximum(sigma, 1e-12), np.inf)
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


def changes(names: Sequence[str], rows: Array, adjusted: Adjusted, moved: Mask) -> list[str]:
    """A line for each parameter that has moved: from, to, and its deviation."""
    out = []
    sigma = np.sqrt(np.abs(np.diag(adjusted.covariance))).reshape(rows.shape)
    for k, p in zip(*(part.tolist() for part in np.nonzero(moved)), strict=True):
        before, now, error = (_shown(p, value) for value in (rows[k, p], adjusted.rows[k, p], sigma[k, p]))
        if p in (0, HEIGHT):
            out.append(f"{names[k]}: {NAMES[p]} is {np.expm1(adjusted.rows[k, p] - rows[k, p]):+.1%} ± {sigma[k, p]:.1%} off")
        else:
            out.append(f"{names[k]}: {NAMES[p]} is {now:.3f} and not {before:.3f} ± {error:.3f} {'°' if p in (PITCH, ROLL, YAW) else ''}".rstrip())
    return out


def _shown(p: int, value: float) -> float:
    return float(np.degrees(value)) if p in (PITCH, ROLL, YAW) else float(value)
