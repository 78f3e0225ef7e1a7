"""Errors of frame numbers: one camera, or all detections, are whole frames late or early, or are numbered in frames of a faster video.

A delay shows in moving people: a camera that is late sees them where they were. The residuals of matched feet are regressed on the velocities of
people, beside a bias of each camera's feet that depends on the place. The coefficient of the velocity is the delay in frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np

from tracker.geometry import Array, Ints
from tracker.recordings.calibration_errors import LEAST_BOXES, MORE, Corrected, Finding, better
from tracker.recordings.calibration_feet import BLOCKS, CalibrationCase, Feet, Nearness, People, Reference, nearness

MOST_SHIFT = 5
"""Frames by which detections are shifted at most."""
STRETCHES = range(2, 31)
"""Every n-th frame of a faster video."""
GATE = 1.0
"""m: feet of one person in two cameras, or in two successive frames, are at most so far apart."""
LEAST_PAIRS = 40
HALF, HALF_ERRORS = 0.5, 3.0
"""Against truth: a delay is reported beyond half a frame by so many standard errors. Cameras that run freely are within half a frame."""
AMONG_CAMERAS = 2 / 3
"""Frames: the least delay that is reported without truth. The whole frame that mends it then at least halves it."""
LEAST_DELAY = 0.08
"""s: shorter delays are within what the errors of feet of walking people imitate."""
ROUNDS = 15
"""Of the robust regression."""
MOST_PAIRS = 60
"""Pairs of cameras that are compared."""


@dataclass(frozen=True)
class Delay:
    """Frames by which detections are late, its standard error, and the number of matched feet."""

    frames: float
    error: float
    count: int


@dataclass(frozen=True, eq=False)
class Motion:
    """Points of people with velocities: frame (n,), point (n, 2) m, velocity (n, 2) m per frame, NaN where unknown."""

    frame: Ints
    point: Array
    velocity: Array

    @staticmethod
    def of_truth(people: People) -> Motion:
        """True people; the velocity is the central difference of a person's places."""
        row = {key: k for k, key in enumerate(zip(people.frame.tolist(), people.id.tolist(), strict=True))}
        step = int(np.diff(np.unique(people.frame)).min(initial=1)) if len(np.unique(people.frame)) < 2 else int(np.diff(np.unique(people.frame)).min())
        before, after = (
            np.array([row.get((frame + sign * step, one), -1) for frame, one in row], dtype=np.int64).reshape(-1) for sign in (-1, 1)
        )
        velocity = (people.point[after] - people.point[before]) / (2 * step)
        velocity[(before < 0) | (after < 0)] = np.nan
        return Motion(people.frame, people.point, velocity)

    @staticmethod
    def of_feet(feet: Feet) -> Motion:
        """Feet of a camera. The velocity is the central difference along nearest feet of successive frames, over two frames each way, else over one."""
        grounded = feet.grounded
        frame, point = feet.frame[grounded], feet.point[grounded]
        tree, n = Reference(frame, point), len(frame)
        after, before = (np.append(tree.nearest(frame + sign, point, GATE)[1], n) for sign in (1, -1))
        own = np.arange(n + 1)
        after, before = np.where(before[after] == own, after, n), np.where(after[before] == own, before, n)
        places = np.vstack([point, np.full(2, np.nan)])
        near, far = ((places[b] - places[a])[:n] / span for a, b, span in ((before, after, 2), (before[before], after[after], 4)))
        return Motion(frame, point, np.where(np.isnan(far), near, far))


def stretched_frames(case: CalibrationCase) -> Corrected | None:
    """Every n-th frame: the detections of all cameras, or of one, and the rest count frames of videos of different rates."""
    if case.truth is not None:
        reference = Reference(case.truth.frame, case.truth.point)
        found = _stretch(case, tuple(case.lenses), dict.fromkeys(case.lenses, reference))
        if found:
            return _stretched(case, tuple(case.lenses), found, "the truth")
    for name in case.lenses if len(case.lenses) > 1 else ():
        truth = case.truth
        reference = case.others(name) if truth is None else Reference(truth.frame, truth.point)
        found = _stretch(case, (name,), {name: reference})
        if found:
            return _stretched(case, (name,), found, "the other cameras" if truth is None else "the truth")
    return None


Numbering = tuple[int, int, int]
"""times, divisor, shift: a frame f of the detections is the frame times · f / divisor + shift of the reference."""


def _numbered(frame: Ints, numbering: Numbering) -> Ints:
    times, divisor, shift = numbering
    return np.asarray(np.where(frame % divisor == _phase(frame, divisor), times * (frame // divisor) + shift, -1))


def _phase(frame: Ints, divisor: int) -> int:
    """The most frequent remainder."""
    return int(np.bincount(frame % divisor, minlength=divisor).argmax()) if len(frame) else 0


def _stretch(case: CalibrationCase, names: tuple[str, ...], references: Mapping[str, Reference]) -> Numbering | None:
    """The numbering that is clearly better, tried on some boxes and confirmed on more."""
    feet = {name: case.sampled_feet(name) for name in names}

    def near(numbering: Numbering, part: int) -> Nearness:
        parts = []
        for name in names:
            rows = slice(None, None, part)
            one = Feet(feet[name].frame[rows], feet[name].point[rows], feet[name].height[rows])
            parts.append(nearness(one, references[name], _numbered(one.frame, numbering)))
        return reduce(add, parts)

    given = near((1, 1, 0), 1)
    if given.mean > (1 - MORE) / 2:
        return None
    trials = {one: near(one, 3) for one in _numberings()}
    known = {one: trial for one, trial in trials.items() if trial.boxes >= LEAST_BOXES}
    best = max(known, key=lambda one: known[one].mean, default=None)
    return best if best is not None and better(near(best, 1), given) else None


def _numberings() -> Iterator[Numbering]:
    for n in STRETCHES:
        yield from ((n, 1, shift) for shift in (0, -1, 1, n - 1))
        yield from ((1, n, shift) for shift in (0, -1, 1))


def _stretched(case: CalibrationCase, names: tuple[str, ...], numbering: Numbering, rest: str) -> Corrected:
    times, divisor, _ = numbering
    who = "the detections" if len(names) == len(case.lenses) else ", ".join(names)
    faster, slower, n = (rest, who, times) if times > 1 else (who, rest, divisor)
    words = f"frames of {faster} look numbered in a video that is {n} times as fast: frame {n} k fits frame k of {slower}"
    corrected = case.with_frames({name: _numbered(case.rays[name].frame, numbering) for name in names})
    return Finding("frames-stretched", () if len(names) == len(case.lenses) else names, words), corrected


def shifted_frames(case: CalibrationCase) -> Corrected | None:
    """Detections of one camera, or of all against truth, that are whole frames late or early."""
    return _shifted_to_truth(case) if case.truth is not None else _shifted_among(case)


def _shifted_to_truth(case: CalibrationCase) -> Corrected | None:
    assert case.truth is not None
    truth, delays = Motion.of_truth(case.truth), dict[str, Delay]()
    for name in case.lenses:
        delay = _delay_to(case, name, truth)
        if delay is not None:
            delays[name] = delay
    if not delays:
        return None
    middle = float(np.median([delay.frames for delay in delays.values()]))
    common = round(middle) if _beyond(case, middle, float(np.median([delay.error for delay in delays.values()]))) else 0
    if common and (len(delays) > 1 or len(case.lenses) == 1):
        corrected = case.with_frames({name: rays.frame - common for name, rays in case.rays.items()})
        words = f"frames of all detections are {_late(common)} against the truth (by {abs(middle):.1f} frames as moving people show)"
        return Finding("frames-shifted-all", (), words), corrected
    late = {name: delay for name, delay in delays.items() if _beyond(case, delay.frames, delay.error)}
    return _one_shifted(case, late, {name: delay.frames for name, delay in late.items()}, "the truth")


def _beyond(case: CalibrationCase, frames: float, error: float) -> bool:
    return abs(frames) > max(HALF + HALF_ERRORS * error, LEAST_DELAY * case.rate)


def _late(frames: int) -> str:
    return f"{abs(frames)} frame{'s' * (abs(frames) > 1)} {'late' if frames > 0 else 'early'} (numbered {abs(frames)} too {'high' if frames > 0 else 'low'})"


def _one_shifted(case: CalibrationCase, late: Mapping[str, Delay], frames: Mapping[str, float], rest: str) -> Corrected | None:
    """The camera with the greatest delay, in words."""
    if not late:
        return None
    name = max(late, key=lambda key: abs(frames[key]))
    whole = int(np.sign(frames[name])) * max(1, round(abs(frames[name])))
    words = f"frames of {name} are {_late(whole)} against {rest} (by {abs(frames[name]):.1f} frames as moving people show)"
    return Finding("frames-shifted", (name,), words), case.with_frames({name: case.rays[name].frame - whole})


def _delay_to(case: CalibrationCase, name: str, truth: Motion) -> Delay | None:
    """The delay of a camera against truth: the best whole frame, and the rest by regression."""
    feet, reference = case.sampled_feet(name), Reference(truth.frame, truth.point)
    near = {shift: nearness(feet, reference, feet.frame + shift) for shift in range(-MOST_SHIFT, MOST_SHIFT + 1)}
    shift = max(near, key=lambda key: (near[key].mean, -abs(key)))
    own = Motion(feet.frame, feet.point, np.full_like(feet.point, np.nan))
    for _ in range(3):
        delay = delay_between(own, truth, (centre_of(case, name), None), shift)
        if delay is None:
            return None
        if round(-delay.frames) == shift or abs(round(-delay.frames)) > MOST_SHIFT:
            break
        shift = round(-delay.frames)
    worse = near[0].mean > near[max(-MOST_SHIFT, min(MOST_SHIFT, -(round(delay.frames) or int(np.sign(delay.frames)))))].mean
    # Regression and nearness need to agree that another frame is better.
    return Delay(0.0, delay.error, delay.count) if worse else delay


def centre_of(case: CalibrationCase, name: str) -> Array:
    """x, y (2,) m of a camera."""
    R, t = case.extrinsics[name]
    return np.asarray((-R.T @ t)[:2])


def delay_between(a: Motion, b: Motion, centres: tuple[Array, Array | None], shift: int = 0) -> Delay | None:
    """Frames by which `a` is late against `b`, or None with too few matched feet.

    centres: x, y (2,) m of their cameras; None for truth. shift: added to the frames of `a` before feet are matched, as mutually nearest ones.
    """
    frame = a.frame + shift
    row = Reference(b.frame, b.point).nearest(frame, a.point, GATE)[1]
    back = Reference(frame[np.isfinite(a.point[:, 0])], a.point[np.isfinite(a.point[:, 0])])
    origin = np.append(np.flatnonzero(np.isfinite(a.point[:, 0])), -1)
    matched = np.flatnonzero(row < len(b.frame))
    mutual = origin[back.nearest(b.frame[row[matched]], b.point[row[matched]], GATE)[1]] == matched
    matched = matched[mutual]
    pair = row[matched]
    velocity = np.stack([a.velocity[matched], b.velocity[pair]])
    known = np.isfinite(velocity[:, :, 0])
    weight = np.maximum(known.sum(axis=0), 1)
    speed = np.where(known[:, :, None], velocity, 0.0).sum(axis=0) / weight[:, None]
    kept = known.any(axis=0)
    if kept.sum() < LEAST_PAIRS:
        return None
    here, there = a.point[matched][kept], b.point[pair][kept]
    bias = _bias(here, centres[0]) + ([] if centres[1] is None else _bias(there, centres[1])[2:3])
    if not np.isfinite(here).all() or np.median(np.hypot(*speed[kept].T)) < 1e-3:
        return None
    late, error = _regression(here - there, speed[kept], bias, _blocks(frame[matched][kept]))
    return Delay(-late - shift, error, int(kept.sum()))


def _bias(point: Array, centre: Array) -> list[Array]:
    """Columns (n, 2) of biases of feet at `point`: constant, along the line of sight, and in proportion to the distance."""
    away = point - centre
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)[:, None]
    one = np.ones(len(point))
    return [np.column_stack([one, 0 * one]), np.column_stack([0 * one, one]), away / distance, away]


def _blocks(frame: Ints) -> Ints:
    return np.asarray((frame - frame.min()) * BLOCKS // (frame.max() - frame.min() + 1))


def _regression(residual: Array, velocity: Array, bias: list[Array], block: Ints) -> tuple[float, float]:
    """Coefficient of the velocity and its standard error, by iteratively reweighted least squares with Cauchy weights.

    The error is the sandwich estimate with blocks as clusters (Liang and Zeger 1986).
    """
    X = np.concatenate([np.column_stack([velocity[:, axis], *(column[:, axis] for column in bias)]) for axis in (0, 1)])
    y, block = residual.T.ravel(), np.tile(block, 2)
    weight, rest = np.ones(len(y)), y
    coefficient = np.zeros(X.shape[1])
    for _ in range(ROUNDS):
        coefficient = np.linalg.lstsq(X.T @ (X * weight[:, None]), X.T @ (weight * y), rcond=None)[0]
        rest = y - X @ coefficient
        weight = 1 / (1 + (rest / (1.5 * (1.48 * np.median(np.abs(rest)) + 1e-6))) ** 2)
    inverse = np.linalg.pinv((X * weight[:, None]).T @ X)
    score = np.zeros((BLOCKS, X.shape[1]))
    np.add.at(score, block, X * (weight * rest)[:, None])
    return float(coefficient[0]), float(np.sqrt((inverse @ (score.T @ score) @ inverse)[0, 0]))


def _shifted_among(case: CalibrationCase) -> Corrected | None:
    """Without truth: the delays of cameras that fit the delays of all pairs best, against their median."""
    if len(case.lenses) < 2:
        return None
    pairs = _pair_delays(case)
    delays = _camera_delays(list(case.lenses), pairs)
    late = {name: delay for name, delay in delays.items() if abs(delay.frames) > max(AMONG_CAMERAS + delay.error, LEAST_DELAY * case.rate)}
    found = _one_shifted(case, late, {name: delay.frames for name, delay in late.items()}, "the other cameras")
    if found is None or len(case.lenses) > 2:
        return found
    one, other = case.lenses
    words = f"{found[0].words}, or those of {other if found[0].cameras[0] == one else one} are as much the other way"
    return replace(found[0], words=words), found[1]


def _pair_delays(case: CalibrationCase) -> dict[tuple[str, str], Delay]:
    """Pair of cameras that see the same people → the delay of the first against the second."""
    motion = {name: Motion.of_feet(case.feet(name)) for name in case.lenses}
    out = {}
    for a, b in list(combinations(case.lenses, 2))[:MOST_PAIRS]:
        if not len(motion[a].frame) or not len(motion[b].frame):
            continue
        shift = _best_shift(motion[a], motion[b])
        delay = delay_between(motion[a], motion[b], (centre_of(case, a), centre_of(case, b)), shift)
        if delay is not None:
            out[a, b] = delay
    return out


def _best_shift(a: Motion, b: Motion) -> int:
    reference = Reference(b.frame, b.point)
    feet = Feet(a.frame, a.point, np.zeros(len(a.frame)))
    near = {shift: nearness(feet, reference, feet.frame + shift).mean for shift in range(-MOST_SHIFT, MOST_SHIFT + 1)}
    best = max(near, key=lambda key: near[key])
    # A shift of one frame is left to the regression, which allows for biases of feet.
    return best if abs(best) > 1 else 0


def _camera_delays(names: list[str], pairs: Mapping[tuple[str, str], Delay]) -> dict[str, Delay]:
    """Delay of each camera that stands in a pair, against the median of the others: weighted least squares over pairs, robustly."""
    known = [name for name in names if any(name in pair for pair in pairs)]
    if len(known) < 2:
        return {}
    column = {name: k for k, name in enumerate(known)}
    A, y = np.zeros((len(pairs), len(known))), np.array([delay.frames for delay in pairs.values()])
    for row, (a, b) in enumerate(pairs):
        A[row, column[a]], A[row, column[b]] = 1.0, -1.0
    given = 1 / (np.array([delay.error for delay in pairs.values()]) ** 2 + 0.1**2)
    weight, x = given, np.zeros(len(known))
    for _ in range(ROUNDS):
        x = np.linalg.lstsq(A * np.sqrt(weight)[:, None], y * np.sqrt(weight), rcond=None)[0]
        weight = given / (1 + ((y - A @ x) / 0.3) ** 2)
    out = {}
    for name, k in column.items():
        others = np.delete(x, k)
        error = min((delay.error for pair, delay in pairs.items() if name in pair), default=np.inf)
        out[name] = Delay(float(x[k] - np.median(others)), error, 0)
    return out
