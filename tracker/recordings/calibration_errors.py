"""Errors of extrinsics that people make: units, the direction of R and t, cameras swapped. Each is tested by the correction that it needs.

A correction is reported where it is clearly better than the calibration as given, and that one is bad. Two figures say so.
The first is the nearness of feet to true people or, without truth, to the feet of other cameras.
The second is the share of boxes with the height of a person.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array
from tracker.geometry.ground import inside_area
from tracker.recordings.calibration_feet import CalibrationCase, Extrinsics, Nearness, Reference, nearness, reference_of

TIMES, MORE, ERRORS = 2.0, 0.08, 5.0
"""A correction is clearly better where the nearness is TIMES as much, MORE more, and more by ERRORS standard errors."""
HEIGHTS, HEIGHTS_TIMES = 0.4, 4.0
"""By heights alone: the share of boxes with the height of a person is at least HEIGHTS, and HEIGHTS_TIMES as much as before."""
LEAST_TALL = 0.2
"""Share of the boxes that have the height of a person under any right calibration. Cameras that are made too near agree in one point."""
LEAST_BOXES = 20
MOST_CAMERAS = 12
"""Up to so many cameras all pairs are compared, else those that agree badly."""
MM, CM = 1e-3, 1e-2
UNITS = {MM: "millimetres", CM: "centimetres"}
AREA_RATIO = (0.2, 5.0)
"""Bounds of the side of the area over that of the places of people."""
TOO_WIDE = 30.0
"""The same ratio from which the area is in another unit; and that of the spread of true people over that of feet."""


@dataclass(frozen=True)
class Finding:
    """A likely error. kind: short name. cameras: those concerned, empty for all data. words: one or two sentences."""

    kind: str
    cameras: tuple[str, ...]
    words: str


Corrected = tuple[Finding, CalibrationCase]


def _given(e: Extrinsics) -> Extrinsics:
    return e


def _transposed(e: Extrinsics) -> Extrinsics:
    return e[0].T, e[1]


def _from_centre(e: Extrinsics) -> Extrinsics:
    return e[0], -e[0] @ e[1]


def _inverted(e: Extrinsics) -> Extrinsics:
    return e[0].T, -e[0].T @ e[1]


FORMS: dict[str, tuple[Callable[[Extrinsics], Extrinsics], str]] = {
    "": (_given, ""),
    "rotation-transposed": (_transposed, "R is transposed (it turns camera axes into world axes)"),
    "translation-is-centre": (_from_centre, "t is the place of the camera c, and needs to be -R c"),
    "camera-to-world": (_inverted, "R and t lead from camera to world, and need to be R^T and -R^T t"),
}
"""Kind → the correction of the extrinsics, and what it says."""


@dataclass(frozen=True)
class Correction:
    """A correction of extrinsics: the form, a key of FORMS, and the scale of t."""

    form: str
    scale: float = 1.0

    def apply(self, extrinsics: Extrinsics) -> Extrinsics:
        R, t = FORMS[self.form][0](extrinsics)
        return R, t * self.scale

    @property
    def kind(self) -> str:
        return "+".join(part for part in (self.form, {MM: "units-mm", CM: "units-cm"}.get(self.scale, "")) if part)

    @property
    def words(self) -> str:
        unit = f"t is in {UNITS[self.scale]}, and needs to be in metres" if self.scale in UNITS else ""
        return "; ".join(part for part in (FORMS[self.form][1], unit) if part)


CORRECTIONS = tuple(Correction(form, scale) for scale in (1.0, MM, CM) for form in FORMS if form or scale != 1.0)
AS_GIVEN = Correction("")


@dataclass(frozen=True)
class Trial:
    """A correction as tested: nearness to people, and the share of boxes with the height of a person."""

    correction: Correction
    near: Nearness
    plausible: float

    def clearly_better(self, given: Trial, alone: bool) -> bool:
        """Whether the trial beats `given`; by heights alone, where feet are near nobody under either, if `alone`."""
        if better(self.near, given.near) and self.plausible >= max(LEAST_TALL, 0.8 * given.plausible):
            return True
        by_heights = self.plausible >= max(HEIGHTS, HEIGHTS_TIMES * given.plausible) and len(self.near.gain) >= LEAST_BOXES
        return alone and by_heights and given.near.mean < MORE and self.near.mean > -MORE


def better(near: Nearness, given: Nearness) -> bool:
    """Whether feet are clearly nearer to people than as given, where they are far from them."""
    if near.boxes < LEAST_BOXES or near.mean < TIMES * given.mean + MORE:
        return False
    more, error = near.better_than(given)
    return more > ERRORS * error


def wrong_extrinsics(case: CalibrationCase) -> Corrected | None:
    """The correction of R and t that is clearly better, with the cameras that need it."""
    found = _by_truth(case) if case.truth is not None else _by_agreement(case)
    found = found or _by_heights(case)
    if not found:
        return None
    kind = max({c.kind for c, _, _ in found.values()}, key=lambda kind: sum(c.kind == kind for c, _, _ in found.values()))
    chosen = {name: trials for name, trials in found.items() if trials[0].kind == kind}
    chosen = _extended(case, chosen)
    corrected = case.with_extrinsics({name: trials[0].apply(case.extrinsics[name]) for name, trials in chosen.items()})
    now, before = (float(np.mean([one.plausible for one in ones])) for ones in zip(*((new, old) for _, new, old in chosen.values()), strict=True))
    correction = next(iter(chosen.values()))[0]
    words = f"{_named(chosen, case)}: {correction.words}. So read, {now:.0%} of the boxes have the height of a person, {before:.0%} as given"
    return Finding(kind, tuple(chosen), words), corrected


Found = dict[str, tuple[Correction, Trial, Trial]]
"""Camera → the correction, the trial of it, and the trial of what is given."""


def _extended(case: CalibrationCase, found: Found) -> Found:
    """With the other cameras for which heights alone speak for the same correction: a camera may be far from the true people, or agree badly."""
    correction, empty = next(iter(found.values()))[0], reference_of([])
    out: Found = {}
    for name in case.lenses:
        given, trial = (_trial(case, name, one, empty) for one in (AS_GIVEN, correction))
        if name in found or trial.clearly_better(given, alone=True):
            out[name] = found.get(name, (correction, trial, given))
    return out


def _named(names: Found, case: CalibrationCase) -> str:
    return "all cameras" if len(names) == len(case.lenses) > 1 else ", ".join(names)


def _trial(case: CalibrationCase, name: str, correction: Correction, reference: Reference) -> Trial:
    feet = case.sampled_feet(name, correction.apply(case.extrinsics[name]))
    return Trial(correction, nearness(feet, reference), feet.plausible(case.band))


def _best(trials: list[Trial], given: Trial, alone: bool = False) -> Trial | None:
    good = [trial for trial in trials if trial.clearly_better(given, alone)]
    return max(good, key=lambda trial: trial.near.mean + trial.plausible, default=None)


def _by_truth(case: CalibrationCase) -> Found:
    assert case.truth is not None
    reference = Reference(case.truth.frame, case.truth.point)
    return _each(case, lambda _: reference)


def _each(case: CalibrationCase, reference_for: Callable[[str], Reference], alone: bool = False) -> Found:
    """Each camera by itself."""
    found: Found = {}
    for name in case.lenses:
        reference = reference_for(name)
        given = _trial(case, name, AS_GIVEN, reference)
        best = _best([_trial(case, name, correction, reference) for correction in CORRECTIONS], given, alone)
        if best is not None:
            found[name] = best.correction, best, given
    return found


def _by_heights(case: CalibrationCase) -> Found:
    empty = reference_of([])
    return _each(case, lambda _: empty, alone=True) if case.truth is None or _far_from_truth(case) else {}


def _far_from_truth(case: CalibrationCase) -> bool:
    """Whether the feet of no camera are near the truth, so that it says nothing of cameras: it may itself have a wrong unit."""
    assert case.truth is not None
    reference = Reference(case.truth.frame, case.truth.point)
    return all(nearness(case.sampled_feet(name), reference).mean < MORE for name in case.lenses)


def _by_agreement(case: CalibrationCase) -> Found:
    """Without truth: one camera against the others as given, or all cameras with the same correction."""
    case = case.part()
    single = _each(case, case.others)
    together = _together(case)
    if together is None or (single and min(t.near.mean for _, t, _ in single.values()) > together[1].near.mean):
        return single if len(single) < len(case.lenses) or together is None else {}
    correction, trial, given = together
    return dict.fromkeys(case.lenses, (correction, trial, given))


def _together(case: CalibrationCase) -> tuple[Correction, Trial, Trial] | None:
    trials = []
    for correction in (AS_GIVEN, *CORRECTIONS):
        moved = case.with_extrinsics({name: correction.apply(e) for name, e in case.extrinsics.items()})
        near, plausible = agreement(moved)
        trials.append(Trial(correction, near, plausible))
    best = _best(trials[1:], trials[0])
    return None if best is None else (best.correction, best, trials[0])


def agreement(case: CalibrationCase, names: tuple[str, ...] = ()) -> tuple[Nearness, float]:
    """Nearness of the feet of the cameras, all where none are named, to those of the others; and the mean share of plausible heights."""
    names = names or tuple(case.lenses)
    feet = {name: case.feet(name) for name in case.lenses}
    near, plausible = [], []
    for name in names:
        rows = case.sample(name)
        own = replace(feet[name], frame=feet[name].frame[rows], point=feet[name].point[rows], height=feet[name].height[rows])
        near.append(nearness(own, reference_of([other for key, other in feet.items() if key != name])))
        plausible.append(own.plausible(case.band))
    return reduce(add, near), float(np.mean(plausible))


def wrong_truth_unit(case: CalibrationCase) -> Corrected | None:
    """Truth in millimetres or centimetres."""
    if case.truth is None:
        return None

    def near(scale: float) -> Nearness:
        assert case.truth is not None
        reference = Reference(case.truth.frame, case.truth.point * scale)
        return reduce(add, [nearness(case.sampled_feet(name), reference) for name in case.lenses])

    # Truth that is made too small lies in one point, which feet may be near. So only truth that is spread too widely is tried.
    feet = np.concatenate([case.sampled_feet(name).point for name in case.lenses])
    if _spread(case.truth.point) < TOO_WIDE * _spread(feet):
        return None
    given, trials = near(1.0), {scale: near(scale) for scale in UNITS}
    scale = max(trials, key=lambda key: trials[key].mean)
    if not better(trials[scale], given):
        return None
    words = f"truth: x and y are in {UNITS[scale]}, and need to be in metres. So read, feet are near true people; as given, near none"
    truth = replace(case.truth, point=case.truth.point * scale)
    return Finding(f"truth-{'mm' if scale == MM else 'cm'}", (), words), replace(case, truth=truth)


def _spread(points: Array) -> float:
    """m: diagonal of the box from the 5th to the 95th percentile of points (n, 2) m; NaN are left out; inf without points."""
    points = points[np.isfinite(points[:, 0])]
    return float(np.linalg.norm(np.subtract(*np.percentile(points, [95, 5], axis=0)))) if len(points) else np.inf


def wrong_area_unit(case: CalibrationCase) -> Corrected | None:
    """An area in millimetres or centimetres: far larger than where people are, who are in the middle of the smaller one."""
    if case.area is None:
        return None
    places = case.truth.point if case.truth is not None else np.concatenate([case.sampled_feet(name).point for name in case.lenses])
    places = places[np.isfinite(places[:, 0])]
    if len(places) < LEAST_BOXES:
        return None
    side = float(np.linalg.norm(case.area[1] - case.area[0])) / max(_spread(places), 1.0)
    for scale, unit in UNITS.items():
        inside = inside_area(places, case.area * scale).mean()
        if side > TOO_WIDE and AREA_RATIO[0] < side * scale < AREA_RATIO[1] and inside > 0.5:
            words = f"area: is in {unit}, and needs to be in metres. So read, {inside:.0%} of the people are in it"
            return Finding(f"area-{'mm' if scale == MM else 'cm'}", (), words), replace(case, area=case.area * scale)
    return None


def swapped_cameras(case: CalibrationCase) -> Corrected | None:
    """Cameras whose boxes fit the calibrations of one another."""
    if len(case.lenses) < 2:
        return None
    order = _order_by_truth(case) if case.truth is not None else _pair_by_agreement(case)
    if not order:
        return None
    if len(order) == 2:
        words = f"{' and '.join(order)} are swapped: the boxes of each fit the calibration of the other"
    else:
        words = "the order of cameras is wrong: " + ", ".join(f"boxes of {boxes} fit the calibration of {name}" for name, boxes in order.items())
    return Finding("cameras-swapped", tuple(order), words), case.with_boxes_of(order)


def _order_by_truth(case: CalibrationCase) -> dict[str, str]:
    """Camera → the camera whose boxes fit its calibration, for those cameras whose own boxes do not. Best assignment of all."""
    assert case.truth is not None
    reference = Reference(case.truth.frame, case.truth.point)
    own = {name: nearness(case.sampled_feet(name), reference) for name in case.lenses}
    names = sorted(case.lenses, key=lambda name: own[name].mean)[:MOST_CAMERAS]
    near = {(a, b): own[a] if a == b else _with_boxes(case, a, b, reference) for a in names for b in names}
    gain = np.array([[near[a, b].mean for b in names] for a in names])
    order = dict(zip(names, linear_sum_assignment(-gain)[1].tolist(), strict=True))
    out: dict[str, str] = {}
    for cycle in _cycles([order[name] for name in names]):
        new = [near[names[k], names[order[names[k]]]] for k in cycle]
        old = [own[names[k]] for k in cycle]
        if len(cycle) > 1 and better(reduce(add, new), reduce(add, old)) and all(n.mean > o.mean + MORE / 2 for n, o in zip(new, old, strict=True)):
            out |= {names[k]: names[order[names[k]]] for k in cycle}
    return {name: out[name] for name in case.lenses if name in out}


def _with_boxes(case: CalibrationCase, name: str, other: str, reference: Reference) -> Nearness:
    return nearness(case.with_boxes_of({name: other}).sampled_feet(name), reference)


def _cycles(order: list[int]) -> Iterator[list[int]]:
    """Cycles of a permutation."""
    left = set(range(len(order)))
    while left:
        cycle = [min(left)]
        while order[cycle[-1]] != cycle[0]:
            cycle.append(order[cycle[-1]])
        left -= set(cycle)
        yield cycle


def _pair_by_agreement(case: CalibrationCase) -> dict[str, str]:
    case = case.part()
    own = {name: agreement(case, (name,))[0] for name in case.lenses}
    names = sorted(case.lenses, key=lambda name: own[name].mean)[:MOST_CAMERAS]
    best: tuple[float, dict[str, str]] = 0.0, {}
    for a, b in combinations(names, 2):
        pair = {a: b, b: a}
        swapped, given = _pair_with_rest(case.with_boxes_of(pair), (a, b)), _pair_with_rest(case, (a, b))
        if better(swapped, given) and swapped.mean - given.mean > best[0]:
            best = swapped.mean - given.mean, pair
    return {name: best[1][name] for name in case.lenses if name in best[1]}


def _pair_with_rest(case: CalibrationCase, pair: tuple[str, str]) -> Nearness:
    """Nearness of the feet of two cameras to those of the rest. Two swapped cameras in opposite corners of a room agree with one another."""
    rest = [name for name in case.lenses if name not in pair]
    if not rest:
        return agreement(case, pair)[0]
    reference = reference_of([case.feet(name) for name in rest])
    return reduce(add, [nearness(case.sampled_feet(name), reference) for name in pair])
