"""Errors of frame numbers: one camera, or all detections, are whole frames late or early, or are numbered in frames of a faster video.

A delay shows in moving people: a late camera sees them at earlier places. The residuals of matched feet are regressed on the velocities of
people, together with a bias of each camera's feet that depends on the place. The coefficient of the velocity is the delay in frames.
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

CLEARLY = 1.3
"""A shift by more than one frame is accepted where the nearness of feet is higher by this factor."""
MOST_SHIFT = 5
"""Most frames by which detections are shifted."""
STRETCHES = range(2, 31)
"""Factors n: detections are in every n-th frame of a faster video."""
GATE = 1.0
"""m: largest distance of the feet of one person in two cameras, or in two successive frames."""
LEAST_PAIRS = 40
"""Least number of matched feet for a regression; a quarter of the recording needs half as many."""
LEAST_SPEED = 1e-3
"""m per frame: where most people move less, no delay can be seen."""
HALF, ERRORS = 0.5, 2.5
"""Against truth, a delay must exceed HALF frames by ERRORS standard errors. Unsynchronized cameras differ by up to half a frame."""
AMONG_CAMERAS = 2 / 3
"""Frames: the least delay that is reported without truth. A correction by a whole frame then at least halves it."""
LEAST_SHARE = 1 / 3
"""Least share of the distance of feet from people that a delay explains. A smaller delay may be a bias of feet."""
LEAST_DELAY = 0.08
"""s: least delay. Errors of the feet of walking people imitate shorter delays."""
MATCHINGS = 3
ROUNDS = 15
"""Iterations of matching and regression; iterations of the weights of a regression."""
ROUNDING = 0.1
"""Frames: error of the delay of a pair in addition to its standard error."""
AMBIGUOUS = 1.5
"""Other cameras are named, too, where their correction leaves a sum of squared delays below this factor times the least."""
TRIED = 1500
"""Feet of a camera with which shifts by whole frames are tried."""
MOST_PAIRS = 60
"""Most pairs of cameras that are compared."""
QUARTERS = 4
"""Parts of a recording whose delays are compared."""


@dataclass(frozen=True)
class Delay:
    """A delay of detections in frames, positive for late, and its standard error. parts: the delay in each quarter, NaN where unknown.

    stride: median step of people in a frame over the median distance of the matched feet.
    A bias of feet that the regression does not model varies between quarters, because people walk elsewhere.
    """

    frames: float
    error: float
    stride: float = 1.0
    parts: tuple[float, ...] = (np.nan,) * QUARTERS

    @property
    def spread(self) -> float:
        """Standard error of the mean of quarters, at least `error`; inf where fewer than two are known."""
        known = [part for part in self.parts if np.isfinite(part)]
        return max(self.error, float(np.std(known, ddof=1) / np.sqrt(len(known)))) if len(known) > 1 else np.inf


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
        frames = np.unique(people.frame)
        step = int(np.diff(frames).min()) if len(frames) > 1 else 1
        before, after = (np.array([row.get((frame + sign * step, one), -1) for frame, one in row], dtype=np.int64).reshape(-1) for sign in (-1, 1))
        velocity = (people.point[after] - people.point[before]) / (2 * step)
        velocity[(before < 0) | (after < 0)] = np.nan
        return Motion(people.frame, people.point, velocity)

    @staticmethod
    def of_feet(feet: Feet) -> Motion:
        """Feet of a camera. The velocity is the central difference along nearest feet of successive frames: over two frames each way, else one."""
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
    """Frame numbers that differ by a factor n: detections of all cameras, or of one, count frames of a video of another rate."""
    if case.truth is not None:
        found = _stretch(case, tuple(case.lenses))
        if found:
            return _stretched(case, tuple(case.lenses), found, "the truth")
    for name in case.lenses if len(case.lenses) > 1 else ():
        found = _stretch(case, (name,))
        if found:
            return _stretched(case, (name,), found, "the other cameras" if case.truth is None else "the truth")
    return None


Numbering = tuple[int, int, int]
"""times, divisor, shift: a frame f of the detections is the frame times · f / divisor + shift of the reference."""


def _numbered(frame: Ints, numbering: Numbering) -> Ints:
    times, divisor, shift = numbering
    return np.asarray(np.where(frame % divisor == _phase(frame, divisor), times * (frame // divisor) + shift, -1))


def _phase(frame: Ints, divisor: int) -> int:
    """The most frequent remainder."""
    return int(np.bincount(frame % divisor, minlength=divisor).argmax()) if len(frame) else 0


def _stretch(case: CalibrationCase, names: tuple[str, ...]) -> Numbering | None:
    """The numbering that is clearly better, tried on some boxes and confirmed on more."""
    feet, references = {name: case.sampled_feet(name) for name in names}, {name: case.reference(name) for name in names}

    def near(numbering: Numbering, part: int) -> Nearness:
        parts = []
        for name in names:
            rows = slice(None, None, part)
            one = feet[name].select(rows)
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
    corrected = _renumbered(case, names, numbering)
    return Finding("frames-stretched", () if len(names) == len(case.lenses) else names, words), corrected


def _renumbered(case: CalibrationCase, names: tuple[str, ...], numbering: Numbering) -> CalibrationCase:
    """The case in the slower numbering where the truth has the faster one, so that a frame of the detections stays one frame."""
    times, _, shift = numbering
    if times == 1 or case.truth is None or len(names) < len(case.lenses):
        return case.with_frames({name: _numbered(case.rays[name].frame, numbering) for name in names})
    rows = (case.truth.frame - shift) % times == 0
    return replace(case, truth=People((case.truth.frame[rows] - shift) // times, case.truth.id[rows], case.truth.point[rows]))


def shifted_frames(case: CalibrationCase) -> Corrected | None:
    """Detections of one camera, or of all against truth, that are whole frames late or early.

    Where no shift is found against truth, cameras are compared with one another, because sparse truth may not reveal a delay.
    """
    if case.truth is None:
        return _shifted_among(case)
    found = _shifted_to_truth(case)
    if found is not None:
        return found
    among = _shifted_among(replace(case, truth=None))
    return None if among is None else (among[0], replace(among[1], truth=case.truth))


def _shifted_to_truth(case: CalibrationCase) -> Corrected | None:
    assert case.truth is not None
    truth, delays = Motion.of_truth(case.truth), dict[str, Delay]()
    for name in case.lenses:
        delay = _delay_to(case, name, truth)
        if delay is not None:
            delays[name] = delay
    if not delays:
        return None
    frames, spread, stride = (float(np.median(values)) for values in zip(*((d.frames, d.spread, d.stride) for d in delays.values()), strict=True))
    middle = Delay(frames, spread, stride, ())
    common = round(middle.frames) if _whole(case, middle, middle.error) else 0
    if common and (len(delays) > 1 or len(case.lenses) == 1):
        corrected = case.with_frames({name: rays.frame - common for name, rays in case.rays.items()})
        words = f"frames of all detections are {_late(common)} against the truth (by {abs(middle.frames):.1f} frames as moving people show)"
        return Finding("frames-shifted-all", (), words), corrected
    return _one_shifted(case, {name: delay for name, delay in delays.items() if _whole(case, delay, delay.spread)}, "the truth")


def _whole(case: CalibrationCase, delay: Delay, error: float) -> bool:
    """Whether a delay against truth is clearly more than half a frame, and too large for a bias of feet."""
    least = max(HALF + ERRORS * error, LEAST_DELAY * case.rate)
    return abs(delay.frames) > least and abs(delay.frames) * delay.stride > LEAST_SHARE


def _late(frames: int) -> str:
    n, late = abs(frames), frames > 0
    return f"{n} frame{'s' * (n > 1)} {'late' if late else 'early'} (numbered {n} too {'high' if late else 'low'})"


def _one_shifted(case: CalibrationCase, late: Mapping[str, Delay], rest: str) -> Corrected | None:
    """The finding on the camera with the greatest delay, and the corrected case."""
    if not late:
        return None
    name = max(late, key=lambda key: abs(late[key].frames))
    frames = late[name].frames
    whole = int(np.sign(frames)) * max(1, round(abs(frames)))
    words = f"frames of {name} are {_late(whole)} against {rest} (by {abs(frames):.1f} frames as moving people show)"
    return Finding("frames-shifted", (name,), words), case.with_frames({name: case.rays[name].frame - whole})


def _delay_to(case: CalibrationCase, name: str, truth: Motion) -> Delay | None:
    """The delay of a camera against truth: the best whole frame, and the rest by regression."""
    feet = case.sampled_feet(name)
    own = Motion(feet.frame, feet.point, np.full_like(feet.point, np.nan))
    delay = delay_between(own, truth, (centre_of(case, name), None), _best_shift(own, truth))
    return None if delay is None else replace(delay, frames=delay.frames + case.later.get(name, 0.0))


def centre_of(case: CalibrationCase, name: str) -> Array:
    """x, y (2,) m of a camera."""
    R, t = case.extrinsics[name]
    return np.asarray((-R.T @ t)[:2])


def delay_between(a: Motion, b: Motion, centres: tuple[Array, Array | None], shift: int = 0) -> Delay | None:
    """Frames by which `a` is late against `b`, or None with too few matched feet.

    centres: x, y (2,) m of their cameras; None for truth. shift: added to the frames of `a` before feet are matched. Feet are matched again after `b`
    is moved by the estimated delay. People in a crowd may be closer together than they walk in a frame.
    """
    delay, moved = None, b
    for _ in range(MATCHINGS):
        found = _delay_of(a, b, _matched(a, moved, shift), centres, shift)
        if found is None:
            return delay
        delay = found
        step = np.where(np.isfinite(b.velocity), b.velocity, 0.0)
        moved = replace(b, point=b.point - np.clip(delay.frames + shift, -1.0, 1.0) * step)
    return delay


def _delay_of(a: Motion, b: Motion, rows: tuple[Ints, Ints], centres: tuple[Array, Array | None], shift: int) -> Delay | None:
    """The delay by the matched feet in `rows` of `a` and `b`."""
    mine, other = rows
    velocity = np.stack([a.velocity[mine], b.velocity[other]])
    known = np.isfinite(velocity[:, :, 0])
    kept = known.any(axis=0)
    if kept.sum() < LEAST_PAIRS:
        return None
    mean = np.where(known[:, :, None], velocity, 0.0).sum(axis=0)[kept] / known.sum(axis=0)[kept, None]
    here, there, frame = a.point[mine][kept], b.point[other][kept], a.frame[mine][kept]
    if np.median(np.hypot(*mean.T)) < LEAST_SPEED:
        return None
    bias = _bias(here, centres[0]) + ([] if centres[1] is None else _bias(there, centres[1])[2:3])
    X = np.stack([np.stack([mean, *bias], axis=2)[:, axis] for axis in (0, 1)])
    stride = float(np.median(np.hypot(*mean.T)) / max(float(np.median(np.hypot(*(here - there).T))), 1e-3))
    late, error = _regression(here - there, X, _blocks(frame, BLOCKS))
    quarter, parts = _blocks(frame, len(Delay.parts)), []
    for k in range(len(Delay.parts)):
        part = quarter == k
        enough = part.sum() >= LEAST_PAIRS / 2
        parts.append(-_regression((here - there)[part], X[:, part], np.zeros(part.sum(), dtype=np.int64))[0] - shift if enough else np.nan)
    return Delay(-late - shift, error, stride, tuple(parts))


def _matched(a: Motion, b: Motion, shift: int) -> tuple[Ints, Ints]:
    """Rows of `a` and `b` whose points are mutually nearest in a frame, with frames of `a` shifted."""
    usable = np.flatnonzero(np.isfinite(a.point[:, 0]))
    frame, point = a.frame[usable] + shift, a.point[usable]
    there = Reference(b.frame, b.point).nearest(frame, point, GATE)[1]
    near = np.flatnonzero(there < len(b.frame))
    back = Reference(frame, point).nearest(b.frame[there[near]], b.point[there[near]], GATE)[1]
    near = near[back == near]
    return usable[near], there[near]


def _bias(point: Array, centre: Array) -> list[Array]:
    """Columns (n, 2) of biases of feet at `point`: constant, along the line of sight, and in proportion to the distance."""
    away = point - centre
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-6)[:, None]
    one = np.ones(len(point))
    return [np.column_stack([one, 0 * one]), np.column_stack([0 * one, one]), away / distance, away]


def _blocks(frame: Ints, count: int) -> Ints:
    return np.asarray((frame - frame.min()) * count // (frame.max() - frame.min() + 1))


def _regression(residual: Array, columns: Array, block: Ints) -> tuple[float, float]:
    """First coefficient and its standard error: residuals (n, 2) m on columns (2, n, c), by reweighted least squares with Cauchy weights.

    The error is the sandwich estimate with blocks as clusters (Liang and Zeger 1986).
    """
    X, y, block = np.concatenate(list(columns)), residual.T.ravel(), np.tile(block, 2)
    weight, rest = np.ones(len(y)), y
    coefficient: Array = np.zeros(X.shape[1])
    for _ in range(ROUNDS):
        coefficient = np.asarray(np.linalg.lstsq(X.T @ (X * weight[:, None]), X.T @ (weight * y), rcond=None)[0])
        rest = y - X @ coefficient
        weight = 1 / (1 + (rest / (1.5 * (1.48 * np.median(np.abs(rest)) + 1e-6))) ** 2)
    inverse = np.linalg.pinv((X * weight[:, None]).T @ X)
    score = np.zeros((block.max() + 1, X.shape[1]))
    np.add.at(score, block, X * (weight * rest)[:, None])
    return float(coefficient[0]), float(np.sqrt((inverse @ (score.T @ score) @ inverse)[0, 0]))


def _shifted_among(case: CalibrationCase) -> Corrected | None:
    """Without truth: the delays of cameras that fit the delays of all pairs best, against their median."""
    if len(case.lenses) < 2:
        return None
    delays = delays_among(case)
    least = LEAST_DELAY * case.rate
    late = {name: delay for name, delay in delays.items() if abs(delay.frames) > max(AMONG_CAMERAS + ERRORS * delay.spread, least)}
    found = _one_shifted(case, _least_left(delays, late), "the other cameras")
    if found is None:
        return None
    name = found[0].cameras[0]
    doubtful = {key: delay for key, delay in delays.items() if abs(delay.frames) > HALF}
    if len(delays) > 2:
        doubtful = {key: delay for key, delay in doubtful.items() if _left(delays, key) < AMBIGUOUS * _left(delays, name)}
    ways = [f"{key} {'late' if delay.frames > 0 else 'early'}" for key, delay in doubtful.items() if key != name]
    if not ways:
        return found
    words = f"{found[0].words}, or {', or '.join(ways)}: the boxes do not tell which"
    return replace(found[0], cameras=(name, *(key for key in doubtful if key != name)), words=words), found[1]


def delays_among(case: CalibrationCase) -> dict[str, Delay]:
    """The delay of each camera that shares people with other cameras, against the mean of the others."""
    return _camera_delays(list(case.lenses), _pair_delays(case)) if len(case.lenses) > 1 else {}


def _least_left(delays: Mapping[str, Delay], late: Mapping[str, Delay]) -> dict[str, Delay]:
    """The late camera whose correction leaves the smallest delays among all cameras."""
    name = min(late, key=lambda key: _left(delays, key), default=None)
    return {} if name is None else {name: late[name]}


def _left(delays: Mapping[str, Delay], name: str) -> float:
    """Sum of squared delays, frames², about their mean, after the camera `name` is shifted by whole frames."""
    left = np.array([delay.frames - (round(delay.frames) if key == name else 0) for key, delay in delays.items()])
    return float(((left - left.mean()) ** 2).sum())


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
            out[a, b] = replace(delay, frames=delay.frames + case.later.get(a, 0.0) - case.later.get(b, 0.0))
    return out


def _best_shift(a: Motion, b: Motion) -> int:
    """Frames to add to those of `a`, 0 unless feet are then clearly nearer. The regression, which models biases of feet, finds single frames."""
    reference = Reference(b.frame, b.point)
    rows = slice(None, None, 1 + len(a.frame) // TRIED)
    unknown = np.zeros(len(a.frame[rows]))
    feet = Feet(a.frame[rows], a.point[rows], unknown, unknown)
    near = {shift: nearness(feet, reference, feet.frame + shift).mean for shift in range(-MOST_SHIFT, MOST_SHIFT + 1)}
    best = max(near, key=lambda key: near[key])
    return best if abs(best) > 1 and near[best] > max(near[shift] for shift in (-1, 0, 1)) * CLEARLY else 0


def _camera_delays(names: list[str], pairs: Mapping[tuple[str, str], Delay]) -> dict[str, Delay]:
    """Delay of each camera that occurs in a pair, against the mean of the others."""
    known = [name for name in names if any(name in pair for pair in pairs)]
    if len(known) < 2:
        return {}
    error = np.array([delay.spread for delay in pairs.values()])
    error = np.where(np.isfinite(error), error, 10.0)
    whole = _solved(known, list(pairs), np.array([delay.frames for delay in pairs.values()]), error)
    parts = np.array([_solved(known, list(pairs), np.array(part), 2 * error) for part in zip(*(d.parts for d in pairs.values()), strict=True)])
    return {
        name: Delay(float(whole[k]), min(delay.error for pair, delay in pairs.items() if name in pair), parts=tuple(parts[:, k].tolist()))
        for k, name in enumerate(known)
    }


def _solved(known: list[str], pairs: list[tuple[str, str]], delays: Array, error: Array) -> Array:
    """Delays (n,) of cameras, each against the mean of the others: weighted least squares over the delays of pairs, robustly. NaN without a pair."""
    column = {name: k for k, name in enumerate(known)}
    rows = np.flatnonzero(np.isfinite(delays))
    A, y = np.zeros((len(rows), len(known))), delays[rows]
    for row, k in enumerate(rows.tolist()):
        A[row, column[pairs[k][0]]], A[row, column[pairs[k][1]]] = 1.0, -1.0
    given = 1 / (error[rows] ** 2 + ROUNDING**2)
    x: Array = np.zeros(len(known))
    weight = given
    for _ in range(ROUNDS):
        x = np.asarray(np.linalg.lstsq(A * np.sqrt(weight)[:, None], y * np.sqrt(weight), rcond=None)[0])
        weight = given / (1 + ((y - A @ x) / (3 * ROUNDING)) ** 2)
    x = np.where(np.abs(A).sum(axis=0) > 0, x, np.nan)
    seen = int(np.isfinite(x).sum())
    return np.asarray((x - np.nanmean(x)) * seen / (seen - 1)) if seen > 1 else np.full(len(known), np.nan)
