"""Calibration from one view: focal length, pitch, roll and height from the feet and heads of people of known mean stature.

Given the camera's parameters, each box on the ground has a stature. The right parameters give each person one stature in all places, and the usual
distribution of statures (Lv, Zhao and Nevatia 2006, with maximum likelihood in place of their linear estimate).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from tracker.calibration.body import FOCAL, HEIGHT, PITCH, ROLL, lean_of, lens_of, rotation_of
from tracker.calibration.boxes import LinkedBoxes
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.cameras import Camera, LensCamera

STATURE, SPREAD, STATURES = 1.72, 0.09, (1.5, 2.0)
"""m: mean, standard deviation and bounds of statures, as of the simulated people."""
FOCALS = np.geomspace(0.4, 2.2, 9)
"""Focal lengths over the width of the image from which the search begins."""
USUAL_FOCAL = (0.8, 0.35)
"""Prior focal length over the width, and standard deviation of its logarithm: surveillance cameras see 40° to 110°."""
USUAL_HEIGHT = (3.5, 0.8)
"""Prior height, m, and standard deviation of its logarithm."""
ROLL_SIGMA = np.radians(4.0)
PITCHES = np.radians(np.arange(-9.0, 70.0, 4.0))
DEPTH = 0.4
"""m along the line of sight from where the lower edge of a box meets the ground to where the upper edge touches the body."""
EDGE = (0.045, 3.0)
"""Error of a box's height: a share of it, and px."""
SPACING, MOST = 0.4, 600
"""s between two boxes of a tracklet, and most boxes, that are used."""
AS_LIKELY, UNSURE, MOST_OTHERS = 12.0, 0.1, 4
"""Alternative focal lengths for later steps: largest loss of log density, least difference of logarithms from the best, and their largest number."""
INDEPENDENT = 150
"""Largest effective number of boxes, because errors of a detector are correlated in similar boxes."""
STEP = 0.05
"""Step of the logarithm of a stature, for the derivative of the upper edge."""
BEYOND = 4.0
"""Residual of a box that would stand above the horizon."""
LEAST_BOXES = 40


@dataclass(frozen=True, eq=False)
class SingleView:
    """The estimate from one view. row (11,): parameters as in body.NAMES. others: nearly as likely ones with other focal lengths.

    Each of the others has its loss of log density against `row`.
    """

    row: Array
    others: tuple[tuple[Array, float], ...]

    @property
    def tried(self) -> tuple[tuple[Array, float], ...]:
        """`row` and the others, each with its loss of log density."""
        return (self.row, 0.0), *self.others


@dataclass(frozen=True, eq=False)
class _Sample:
    """Boxes of a camera that are used: table, the persons' numbers (n,), and errors (n,) px of the upper edge."""

    camera: Camera
    table: LinkedBoxes
    person: Ints
    error: Array


def thinned(table: LinkedBoxes, spacing: float) -> Ints:
    """Rows of the boxes of whole bodies, one per tracklet and interval of `spacing` s."""
    rows = np.flatnonzero(table.whole)
    key = table.track[rows] * (1 + int(table.time.max(initial=0.0) / spacing)) + (table.time[rows] / spacing).astype(np.int64)
    return np.sort(rows[np.unique(key, return_index=True)[1]])


def single_view(camera: Camera, table: LinkedBoxes, known_focal: bool, height: float | None = None) -> SingleView | None:
    """The parameters of greatest posterior density; None with fewer than LEAST_BOXES boxes, or without a horizon above them.

    height: m above the ground, where it is known.
    """
    rows = thinned(table, SPACING)
    rows = rows[:: 1 + len(rows) // MOST]
    if len(rows) < LEAST_BOXES:
        return None
    part = table.select(rows)
    person = np.unique(part.track, return_inverse=True)[1]
    error = np.hypot(EDGE[0] * part.height, EDGE[1])
    sample = _Sample(camera, part, person, error)
    fixed = known_focal or not isinstance(camera, LensCamera)
    profile = _profile(sample, fixed, height)
    if not profile:
        return None
    best = min(profile, key=lambda found: found.cost)
    if fixed:
        return SingleView(best.row, ())
    found = min((_refined(sample, best.row, False, height), best), key=lambda one: one.cost)
    return SingleView(found.row, _others(profile, found))


@dataclass(frozen=True, eq=False)
class _Found:
    """A maximum of the posterior density: its cost, half the sum of squares, and parameters (11,)."""

    cost: float
    row: Array


def _profile(sample: _Sample, fixed: bool, height: float | None) -> list[_Found]:
    """The likeliest parameters for each of some focal lengths, from short to long. The results of neighbouring focal lengths are starts, too."""
    out: list[_Found] = []
    for focal in _log_first(sample.camera, fixed):
        starts = [*_starts(sample, float(focal)), *(_zoomed(found.row, float(focal)) for found in out[-1:])]
        if starts:
            out.append(min((_refined(sample, start, True, height) for start in starts), key=lambda found: found.cost))
    for k in range(len(out) - 2, -1, -1):
        again = _refined(sample, _zoomed(out[k + 1].row, float(out[k].row[FOCAL])), True, height)
        out[k] = min(out[k], again, key=lambda found: found.cost)
    return out


def _zoomed(row: Array, focal: float) -> Array:
    """Parameters with another focal length, and the pitch that keeps the horizon at its place in the image."""
    out = row.copy()
    out[FOCAL], out[PITCH] = focal, np.arctan(np.tan(row[PITCH]) * np.exp(row[FOCAL] - focal))
    return out


def _others(profile: list[_Found], best: _Found) -> tuple[tuple[Array, float], ...]:
    """Those of the profile that are nearly as likely as the best one: at most MOST_OTHERS, from the shortest focal length to the longest."""
    likely = [one for one in profile if one.cost - best.cost < AS_LIKELY and abs(one.row[FOCAL] - best.row[FOCAL]) > UNSURE]
    chosen = np.unique(np.linspace(0, len(likely) - 1, min(len(likely), MOST_OTHERS)).round().astype(np.int64))
    return tuple((likely[k].row, likely[k].cost - best.cost) for k in chosen.tolist())


def _row(focal: float, pitch: float, roll: float, height: float) -> Array:
    row = np.zeros(11)
    row[[FOCAL, PITCH, ROLL, HEIGHT]] = focal, pitch, roll, height
    return row


def _log_first(camera: Camera, fixed: bool) -> Array:
    """Logarithms of the focal lengths that are tried, over that of the camera as given."""
    return np.zeros(1) if fixed or not isinstance(camera, LensCamera) else np.log(FOCALS * max(camera.width, camera.height) / camera.fx)


def log_usual_focal(camera: LensCamera) -> float:
    """Logarithm of the usual focal length, a multiple of the longer side of the image, over that of the camera as given."""
    return float(np.log(USUAL_FOCAL[0] * max(camera.width, camera.height) / camera.fx))


def _starts(sample: _Sample, focal: float) -> list[Array]:
    """A coarse guess with a focal length, in a list that is empty where no pitch puts most people below the horizon."""
    costs = []
    for pitch in PITCHES:
        row = _row(focal, float(pitch), 0.0, np.log(USUAL_HEIGHT[0]))
        # The height of the camera scales all statures, but for the effect of DEPTH.
        for _ in range(2):
            top, rise, valid = _tops(sample, row)
            if valid.mean() < 0.7:
                break
            log = (top - sample.table.top) / rise
            row[HEIGHT] -= np.clip(np.median(log[valid]), -1.0, 1.0)
        if valid.mean() < 0.7:
            continue
        top, rise, valid = _tops(sample, row)
        r = (top - sample.table.top) / np.hypot(SPREAD / STATURE * rise, sample.error)
        costs.append((float(np.minimum(np.where(valid, r * r, BEYOND**2), BEYOND**2).mean()), row))
    return [min(costs, key=lambda one: one[0])[1]] if costs else []


def _tops(sample: _Sample, row: Array) -> tuple[Array, Array, Mask]:
    """Upper edge (n,) px of a person of mean stature on the feet of each box, and its derivative (n,) px by the logarithm of the stature.

    The third (n,) is whether the feet are below the horizon and the edge has a pixel.
    """
    camera, t = lens_of(sample.camera, row), sample.table
    R, high = rotation_of(float(row[PITCH]), float(row[ROLL])), float(np.exp(row[HEIGHT]))
    lean = lean_of(camera, R, t.middle, t.top, t.bottom)
    foot = camera.bearings_from_pixels(np.column_stack([t.middle + lean, t.bottom])) @ R.T
    level = np.maximum(np.hypot(foot[:, 0], foot[:, 1]), 1e-9)
    valid = -foot[:, 2] / level > 0.01
    distance = high / np.where(valid, -foot[:, 2] / level, 1.0) + DEPTH
    ahead = foot[:, :2] / level[:, None] * distance[:, None]
    heads = [np.column_stack([ahead, np.full(len(t), stature - high)]) @ R for stature in (STATURE, STATURE * np.exp(STEP))]
    with np.errstate(invalid="ignore"):
        tops = [camera.pixels_from_bearings(head / np.linalg.norm(head, axis=1, keepdims=True))[0][:, 1] for head in heads]
    valid &= np.isfinite(tops[0]) & np.isfinite(tops[1])
    return np.where(valid, tops[0], t.top), np.where(valid, (tops[0] - tops[1]) / STEP, t.height), valid


def _refined(sample: _Sample, start: Array, fixed: bool, height: float | None) -> _Found:
    """Maximum of the posterior from a start, whose focal length is kept if `fixed`."""
    people, n = int(sample.person.max()) + 1, len(sample.person)
    share = min(1.0, np.sqrt(INDEPENDENT / n))
    usual = log_usual_focal(sample.camera) if isinstance(sample.camera, LensCamera) else 0.0
    level = (np.log(USUAL_HEIGHT[0]), USUAL_HEIGHT[1]) if height is None else (np.log(height), 0.01)
    order = np.argsort(sample.person, kind="stable")
    ends = np.searchsorted(sample.person[order], np.arange(people))

    def row_of(x: Array) -> Array:
        return _row(start[FOCAL] if fixed else x[3], x[0], x[1], x[2])

    def residuals(x: Array) -> Array:
        row = row_of(x)
        top, rise, valid = _tops(sample, row)
        log = (top - sample.table.top) / rise
        weight = np.where(valid & (np.abs(log) < 0.4), (rise / sample.error) ** 2, 1e-6)
        # The stature of each person is the posterior mean, from the boxes and the prior of statures.
        sums = np.add.reduceat(np.column_stack([weight * log, weight])[order], ends)
        mean = sums[:, 0] / (sums[:, 1] + (STATURE / SPREAD) ** 2)
        own = np.where(valid, (log - mean[sample.person]) * rise / sample.error, BEYOND)
        prior = [x[1] / ROLL_SIGMA, (x[2] - level[0]) / level[1], (row[FOCAL] - usual) / USUAL_FOCAL[1]]
        return np.concatenate([share * own / np.sqrt(1 + (own / 2.5) ** 2 / 2), share * mean * STATURE / SPREAD, prior])

    x0 = np.array([start[PITCH], start[ROLL], start[HEIGHT] if height is None else np.log(height), *([] if fixed else [start[FOCAL]])])
    found = least_squares(residuals, x0, x_scale=np.array([0.05, 0.03, 0.1, *([] if fixed else [0.1])]), max_nfev=40)
    return _Found(float(found.cost), row_of(found.x))
