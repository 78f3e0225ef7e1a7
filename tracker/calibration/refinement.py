"""Refinement of a given calibration: which cameras have moved, and by how much. Other parameters keep their given values.

All cameras are held fixed at first. Each camera in turn is estimated anew. The camera that then differs most from its given values is freed. This
repeats while Wald's test with a clustered covariance is significant. A test at the given values would miss large errors, because the
camera's boxes are outliers there, or its box errors seem large. Parameters within their errors of the given values are reset to these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from tracker.calibration.adjustment import Adjusted, Prior, Problem, adjust
from tracker.calibration.body import FOCAL, HEIGHT, NAMES, OFFSET, PITCH, ROLL, YAW, X, Y
from tracker.calibration.people import Observations, observations
from tracker.calibration.registration import CameraBoxes, Timeline
from tracker.calibration.single_view import single_view
from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Camera
from tracker.recordings import Recording
from tracker.recordings.calibration_errors import swapped_cameras
from tracker.recordings.calibration_feet import CalibrationCase

SIGNIFICANCE = 1e-4
"""Significance level of the test: its rate of false positives if errors are as modelled."""
SIGMAS = 3.0
"""Standard deviations within which a parameter of a moved camera is reset to its given value."""
ROUNDS = 12
TIGHTER, FEW_ROUNDS, MOST = (2.0, 1.0), 8, 1200
"""Of a camera that is estimated anew: factors of the errors within which tracklets are joined, steps of an adjustment, and most boxes."""
LIKE_OTHERS = 1.5
"""Ratio of a camera's errors of edges to the median camera's, below which no second start is tried."""


def unswapped(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with the calibrations of two swapped cameras exchanged, and a line on it (as of `pilsim check`); unchanged without a swap."""
    if any(camera.unknown for camera in recording.fixed.values()):
        return recording, []
    found = swapped_cameras(CalibrationCase.of(replace(recording, truth=None)))
    if found is None:
        return recording, []
    first, second = found[0].cameras
    cameras = {**recording.cameras, first: recording.cameras[second], second: recording.cameras[first]}
    return replace(recording, cameras=cameras), [found[0].words]


def moved_cameras(views: Mapping[str, CameraBoxes], times: Timeline, rows: Array, free: Prior, lost: Mask) -> tuple[Array, Mask]:
    """Parameters (cameras, 11) near the optimum, and which cameras (cameras,) have moved: at most half, beside lost ones. The rest defines the world.

    rows: as given. free: prior of all parameters, if they were free. lost (cameras,): cameras without a usable pose.
    """
    found, moved = rows.copy(), lost.copy()
    most = max(len(rows) // 2, 1)
    while moved.sum() < most + lost.sum() and not moved.all():
        tests = {int(k): _found_anew(views, times, found, _alone(free, moved, int(k)), int(k)) for k in np.flatnonzero(~moved)}
        worst = max(tests, key=lambda k: tests[k][0])
        # Errors of the given calibration and of the box model make all cameras differ from the given values, so the median is the unit.
        usual = max(float(np.quantile([one[0] for one in tests.values()], 0.5, method="lower")), 1.0) if len(tests) > 2 else 1.0
        if tests[worst][0] <= usual * float(chi2.isf(SIGNIFICANCE, tests[worst][2]) / tests[worst][2]):
            break
        found, moved[worst] = tests[worst][1], True
    return found, moved


def _free(prior: Prior, moved: Mask) -> Mask:
    """Free parameters (cameras, 11) if the cameras `moved` (cameras,) have moved: all of theirs, and the clocks of all cameras but the first.

    If all have moved, the first one defines the world.
    """
    free = moved[:, None] & (prior.sigma > 0)
    free[1:, OFFSET] = True
    if moved.all():
        free[0, [X, Y, YAW]] = False
    free[0, OFFSET] = False
    return free


def _alone(prior: Prior, moved: Mask, k: int) -> Prior:
    """The prior with the free parameters of _free for the moved cameras and camera k; all others are held fixed."""
    return replace(prior, sigma=np.where(_free(prior, moved | (np.arange(len(moved)) == k)), prior.sigma, 0.0))


def _found_anew(views: Mapping[str, CameraBoxes], times: Timeline, rows: Array, prior: Prior, k: int) -> tuple[float, Array, int]:
    """Estimate camera k anew: Wald's statistic of its free parameters but the clock, over their number, all parameters (cameras, 11), and the number.

    Without boxes of people the statistic is 0.
    """
    names, cameras = list(views), [view.camera for view in views.values()]
    view = list(views.values())[k]
    best: tuple[Adjusted, Observations] | None = None
    for start in (rows[k], _by_itself(view, rows[k])):
        tried = rows.copy()
        tried[k] = start
        for tight in TIGHTER:
            seen = observations(views, dict(zip(names, tried, strict=True)), times, tight, MOST)
            if not len(seen.view):
                return 0.0, rows, 1
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
    return value / len(own), found.rows, len(own)


def _by_itself(view: CameraBoxes, row: Array) -> Array:
    """Parameters (11,) of a camera at its given x, y and yaw, with focal length, pitch, roll and height from its own boxes (single_view)."""
    single = single_view(view.camera, view.table, False)
    return row if single is None else np.where(np.isin(np.arange(len(row)), [FOCAL, PITCH, ROLL, HEIGHT]), single.row, row)


def refine(cameras: Sequence[Camera], seen: Observations, rows: tuple[Array, Array], prior: Prior, moved: tuple[Mask, Mask]) -> tuple[Adjusted, Mask]:
    """Adjust the cameras that have moved. Returns the adjusted state, and which parameters (cameras, 11) have moved.

    rows: parameters (cameras, 11) as given, and near the best ones. prior: `free` of moved_cameras. moved: which cameras (cameras,) have moved, and
    which are lost.
    """
    free = _free(prior, moved[0])
    problem = Problem(cameras, seen, rows[1], prior)
    problem.solve(ROUNDS // 2, _held(problem, free))
    problem.rescale()
    problem.solve(ROUNDS, _held(problem, free))
    problem.integrate(held=_held(problem, free))
    return _settled(problem, rows[0], free, moved[1]), free


def _settled(problem: Problem, rows: Array, moved: Mask, lost: Mask) -> Adjusted:
    """The state after parameters of moved cameras within SIGMAS of their given values are reset to these; `moved` is changed."""
    for _ in range(int(moved.sum())):
        sigma = np.sqrt(np.diag(problem.covariance(_held(problem, moved)))).reshape(moved.shape)
        ratio = np.where(moved & ~lost[:, None], np.abs(problem.rows - rows) / np.maximum(sigma, 1e-12), np.inf)
        if ratio.min() >= SIGMAS:
            break
        back = np.unravel_index(int(np.argmin(ratio)), ratio.shape)
        moved[back] = False
        problem.rows[back] = rows[back]
        # The other parameters change little, because this one was within its error.
        problem.integrate(2, _held(problem, moved))
    return problem.result(problem.covariance(_held(problem, moved)))


def _held(problem: Problem, moved: Mask) -> Mask:
    """Which of the free parameters (free,) of a problem are held fixed."""
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
