"""Errors of annotated people on which all views of a recording agree: displacements of their places, and statures.

A single view cannot separate an error of the truth from one of its detector. Errors of the truth are common to all views.
Simulated as errors of each view alone, they would make the views contradict each other.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tracker.detector_models.bodies import BODY
from tracker.detector_models.model import CLEAR
from tracker.detector_models.observations import TruePeople, ViewFrame, matched
from tracker.detector_models.processes import LAGS, TIMES, lasting_share
from tracker.detector_models.samples import concatenated
from tracker.geometry import Array, Ints
from tracker.recordings import Recording

LEAST_PAIRS = 200
"""Fewest pairs of clear boxes of one person in two views of a frame."""
CUT = 0.02
"""Largest share of a body beyond the image for its box to be used."""
LEAST_NOISE = 0.1
"""Least share of the variance of a view's errors that is its own."""
BLOCK = 250
"""Frames that are smoothed together."""
FIELD = 0.5
"""m: prior standard deviation of the coefficients of the field of displacements."""
TERMS = 6
LEAST_BOXES, TALLEST = 20, 0.2
"""Fewest clear boxes of a person for a stature, and the largest deviation of a stature, as a share of bodies.BODY."""
STEP = 0.05
"""m: step of the numerical derivative of a pixel by a place."""


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Differences between annotated people and those on which all views agree.

    field (6, 2): displacement on the ground, m, by the terms 1, x, y, x², xy, y² of the place, with bounds (2, 2) m taken to −1 and 1.
    by_place: root mean square of the field at the places of the fit, m.
    deviation: standard deviation, per axis, of a person's own displacement beside it, m. lasting: share of its variance that is constant.
    time_s: of the rest, a Matérn process with smoothness 3/2, of covariance (1 + a) exp(−a), a = √3 lag / time_s.
    stature: standard deviation over people of the height of the body, as a share of bodies.BODY.
    """

    field: Array
    bounds: Array
    by_place: float
    deviation: float
    lasting: float
    time_s: float
    stature: float

    def displacement(self, feet: Array) -> Array:
        """Displacement (n, 2) m by the field at feet (n, 2 or more) m; beyond the bounds, that at their border."""
        return np.asarray(_terms(feet, self.bounds) @ self.field)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {one.name: np.asarray(getattr(self, one.name)).tolist() for one in fields(self)}

    def covariance(self, lag_s: Array) -> Array:
        """Covariance of a person's displacement on an axis, m², at lags in s."""
        return np.asarray(self.deviation**2 * (self.lasting + (1 - self.lasting) * _decay(lag_s, self.time_s)))


@dataclass(frozen=True, eq=False)
class BoxErrors:
    """Errors of clear boxes from projected bodies: person, frame, view (n,); error (n, 2) px of the middle and of the lower edge.

    slope (n, 2, 2): derivative of the foot's pixel by x and y, px/m. feet (n, 2) m: annotated. top (n,): of the upper edge, in body heights.
    """

    person: Ints
    frame: Ints
    view: Ints
    error: Array
    slope: Array
    feet: Array
    top: Array

    def less(self, displacement: Array) -> BoxErrors:
        """The errors less those that a displacement (n, 2) m of the places explains."""
        return replace(self, error=self.error - np.einsum("nij,nj->ni", self.slope, displacement))

    def across(self) -> tuple[Array, Array]:
        """Errors of the middle (n,) as m across the line of sight, and the unit vector (n, 2) of that direction."""
        scale = np.maximum(np.linalg.norm(self.slope[:, 0], axis=1), 1e-9)
        return self.error[:, 0] / scale, self.slope[:, 0] / scale[:, None]

    def information(self, shared: float = 0.0) -> tuple[Array, Array]:
        """Information matrices (n, 2, 2) and vectors (n, 2) of a displacement. shared: the variance, m², that is not a view's own."""
        across, noise = self.across()[0], np.zeros((len(self.error), 2))
        for view in np.unique(self.view):
            mine = self.view == view
            scale = np.linalg.norm(self.slope[mine, 0], axis=1)
            own = float(np.mean(across[mine] ** 2))
            noise[mine, 0] = scale**2 * max(own - shared, LEAST_NOISE * own, 1e-6)
            noise[mine, 1] = scale**2 * max(float(np.mean((self.error[mine, 1] / scale) ** 2)), 1e-6)
        return np.einsum("nki,nk,nkj->nij", self.slope, 1 / noise, self.slope), np.einsum("nki,nk,nk->ni", self.slope, 1 / noise, self.error)


def box_errors(recording: Recording, truth: TruePeople, views: Iterable[Iterable[ViewFrame]]) -> BoxErrors:
    """Errors of the clear boxes in matched views. The median of a view, in body heights, is subtracted as an error of its calibration."""
    out = [_no_errors()]
    for number, frames in enumerate(views):
        mine, heights = [_no_errors()], [np.zeros(0)]
        for one in frames:
            camera, pose, bodies = recording.cameras[one.camera].camera, recording.pose_at(recording.cameras[one.camera], one.frame), one.bodies
            rows = np.flatnonzero((one.match >= 0) & (bodies.visible >= CLEAR) & (bodies.cut <= CUT))
            if pose is None or not len(rows):
                continue
            ids, feet = truth.places[one.frame]
            foot = {int(each): at for each, at in zip(ids, feet, strict=True)}
            at = np.array([foot[int(bodies.person[k])] for k in rows])
            points = (at[:, None] + STEP * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])).reshape(-1, 3) - pose.translation
            bearings = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
            pixels = camera.pixels_from_bearings(bearings @ pose.rotation)[0].reshape(-1, 3, 2)
            slope = np.swapaxes(pixels[:, 1:] - pixels[:, :1], 1, 2) / STEP
            edges, whole, height = one.edges[one.match[rows]], bodies.whole[rows], bodies.height[rows]
            moved = np.column_stack([(edges[:, 0] + edges[:, 2] - whole[:, 0] - whole[:, 2]) / 2, edges[:, 3] - whole[:, 3]])
            ok = np.isfinite(slope).all(axis=(1, 2)) & (np.abs(slope).max(axis=(1, 2)) < camera.width / 4 / STEP)
            top = (edges[:, 1] - whole[:, 1]) / height
            size = np.full(int(ok.sum()), 0)
            found = bodies.person[rows][ok], size + one.frame, size + number, moved[ok], slope[ok], at[ok, :2], top[ok]
            mine.append(BoxErrors(*found))
            heights.append(height[ok])
        view, tall = concatenated(mine), np.concatenate(heights)[:, None]
        if len(tall):
            error, top = view.error - tall * np.median(view.error / tall, axis=0), view.top - np.median(view.top)
            out.append(replace(view, error=error, top=top))
    return concatenated(out)


def fit_shared_errors(found: BoxErrors, period: float) -> SharedErrors | None:
    """Errors that views share; None where too little is known. period: s from frame to frame.

    The field is a weighted least-squares fit to all boxes. The process is found by moments of errors across the line of sight, at LAGS.
    The product of those of two views, with unit vectors a and b across them, is σ² (a · b) in the mean.
    """
    if not len(found.person):
        return None
    bounds = np.array([found.feet.min(axis=0), np.maximum(found.feet.max(axis=0), found.feet.min(axis=0) + 1.0)])
    matrix, vector = found.information()
    terms = _terms(found.feet, bounds)
    normal = np.einsum("na,nij,nb->aibj", terms, matrix, terms).reshape(2 * TERMS, 2 * TERMS) + np.eye(2 * TERMS) / FIELD**2
    field = np.linalg.solve(normal, np.einsum("na,ni->ai", terms, vector).ravel()).reshape(TERMS, 2)
    moments = _moments(found.less(terms @ field))
    if moments is None:
        return None
    lag, gamma, weight = moments
    decay = np.array([_decay(np.asarray(lag * period), time_s) for time_s in TIMES])
    lasting, time_s = lasting_share(np.clip(gamma / max(gamma[0], 1e-9), -1.0, 1.0), weight, decay)
    by_place, deviation = np.sqrt(((terms @ field) ** 2).sum(axis=1).mean()), np.sqrt(max(gamma[0], 0.0))
    stature = np.std(list(_statures(found).values()) or [0.0])
    numbers = (round(float(one), 4) for one in (by_place, deviation, lasting, time_s, stature))
    return SharedErrors(np.asarray(np.round(field, 5)), np.asarray(np.round(bounds, 3)), *numbers)


def agreed(recording: Recording, truth: TruePeople) -> tuple[TruePeople, SharedErrors | None]:
    """People on which all views agree, and their differences from annotated people; the truth itself and None where these are not known.

    They are not known for one view, nor for true boxes. Places are the posterior mean of a Gaussian process.
    """
    if truth.boxes or len(recording.detections) < 2:
        return truth, None
    found = box_errors(recording, truth, [matched(recording.choose([name]), truth)[0] for name in recording.detections])
    errors = fit_shared_errors(found, 1 / recording.rate)
    if errors is None:
        return truth, None
    moved = dict[tuple[int, int], Array]()
    rest = found.less(errors.displacement(found.feet))
    information = rest.information(errors.deviation**2)
    for person in np.unique(found.person).tolist():
        there = np.array(sorted(frame for frame, (ids, _) in truth.places.items() if person in ids))
        for first in range(0, len(there), BLOCK):
            frames = there[first : first + BLOCK]
            mine = np.flatnonzero((found.person == person) & np.isin(found.frame, frames))
            row = np.searchsorted(frames, found.frame[mine])
            matrix, vector = np.zeros((len(frames), 2, 2)), np.zeros((len(frames), 2))
            np.add.at(matrix, row, information[0][mine])
            np.add.at(vector, row, information[1][mine])
            prior, n = errors.covariance(np.abs(frames[:, None] - frames[None]) / recording.rate), 2 * len(frames)
            # mean = K (1 + Λ K)⁻¹ η, with K the prior of both axes and Λ, η the information of the boxes
            kernel = np.einsum("fg,ij->figj", prior, np.eye(2)).reshape(n, n)
            mixed = np.einsum("fij,fg->figj", matrix, prior).reshape(n, n)
            mean = (kernel @ np.linalg.solve(np.eye(n) + mixed, vector.ravel())).reshape(-1, 2)
            moved |= {(int(frame), person): shift for frame, shift in zip(frames, mean, strict=True)}
    return _moved(recording, truth, errors, moved, _statures(found)), errors


def drawn(recording: Recording, truth: TruePeople, errors: SharedErrors, seed: int) -> TruePeople:
    """True people who differ from the annotated ones by a sample of `errors`. The same seed gives the same people."""
    moved, heights, period, frames = dict[tuple[int, int], Array](), dict[int, float](), 1 / recording.rate, sorted(truth.places)
    rate = np.sqrt(3.0) / max(errors.time_s, 1e-6)
    turn = np.exp(-rate * period) * np.array([[1 + rate * period, period], [-(rate**2) * period, 1 - rate * period]])
    spread = np.diag([1.0, rate**2])
    root = np.linalg.cholesky(spread - turn @ spread @ turn.T + 1e-12 * spread)
    for person in sorted({int(one) for ids, _ in truth.places.values() for one in ids}):
        rng = np.random.default_rng([seed, zlib.crc32(b"people"), person])
        heights[person] = float(np.clip(errors.stature * rng.normal(), -TALLEST, TALLEST))
        lasting = np.sqrt(errors.lasting) * rng.normal(size=2)
        state = np.diag([1.0, rate]) @ rng.normal(size=(2, 2))
        for frame in range(frames[0], frames[-1] + 1):
            moved[frame, person] = errors.deviation * (lasting + np.sqrt(1 - errors.lasting) * state[0])
            state = turn @ state + root @ rng.normal(size=(2, 2))
    return _moved(recording, truth, errors, moved, heights)


def _moved(
    recording: Recording, truth: TruePeople, errors: SharedErrors, moved: dict[tuple[int, int], Array], taller: dict[int, float]
) -> TruePeople:
    """People displaced by the field and `moved`, (frame, person) → (2,) m. taller: person → share by which a body is taller than bodies.BODY."""
    places = {}
    for frame, (ids, feet) in truth.places.items():
        shift = np.array([moved.get((frame, int(one)), np.zeros(2)) for one in ids]).reshape(-1, 2) + errors.displacement(feet)
        there = feet + np.column_stack([shift, np.zeros(len(shift))])
        there[:, 2] += recording.ground.height_at(there) - recording.ground.height_at(feet)
        places[frame] = ids, there
    return replace(truth, places=places, heights={person: BODY[0] * (1 + share) for person, share in taller.items()})


def _statures(found: BoxErrors) -> dict[int, float]:
    """Person → share by which the body is taller than bodies.BODY, of people with enough boxes."""
    persons, count = np.unique(found.person, return_counts=True)
    known = persons[count >= LEAST_BOXES].tolist()
    return {person: float(np.clip(-found.top[found.person == person].mean(), -TALLEST, TALLEST)) for person in known}


def _moments(found: BoxErrors) -> tuple[Ints, Array, Array] | None:
    """Lags, frames, with covariances, m², and weights (n,); None where too few boxes of different views are of one person and frame."""
    across, unit = found.across()
    lags, gamma, number = list[int](), list[float](), list[float]()
    for lag in (0, *LAGS):
        product = weight = pairs = 0.0
        for person in np.unique(found.person):
            mine = found.person == person
            table = np.zeros((found.frame[mine].max() + 1, found.view[mine].max() + 1, 3))
            table[found.frame[mine], found.view[mine]] = np.column_stack([unit[mine], across[mine]])
            first, then = table[: max(len(table) - lag, 0)], table[lag:]
            cosine = np.einsum("fvi,fwi->fvw", first[..., :2], then[..., :2])
            cosine[:, np.arange(table.shape[1]), np.arange(table.shape[1])] = 0.0
            product += float(np.einsum("fv,fw,fvw->", first[..., 2], then[..., 2], cosine))
            weight, pairs = weight + float((cosine**2).sum()), pairs + np.count_nonzero(cosine) / 2
        if pairs >= LEAST_PAIRS and weight > 0:
            lags.append(lag)
            gamma.append(product / weight)
            number.append(weight)
    return (np.array(lags), np.array(gamma), np.array(number)) if lags and lags[0] == 0 else None


def _terms(feet: Array, bounds: Array) -> Array:
    """Terms (n, TERMS) of the field at feet (n, 2 or more) m."""
    x, y = np.clip(2 * (feet[:, :2] - bounds[0]) / (bounds[1] - bounds[0]) - 1, -1.0, 1.0).T
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])


def _no_errors() -> BoxErrors:
    none = np.zeros(0, dtype=np.int64)
    return BoxErrors(none, none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0))


def _decay(lag_s: Array, time_s: float) -> Array:
    a = np.sqrt(3.0) * np.asarray(lag_s) / max(time_s, 1e-6)
    return np.asarray((1 + a) * np.exp(-a))
