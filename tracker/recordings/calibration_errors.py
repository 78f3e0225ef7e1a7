"""Common errors of cameras and boxes: units, the direction of R and t, axes, sizes of images, swapped cameras. Each error is tested by applying
its correction.

A correction is reported where the given calibration is bad and the correction is clearly better. Two figures decide.
The first is the nearness of feet to true people or, without truth, to the feet of other cameras.
The second is the share of boxes with the height of a person.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations
from operator import add

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.ground import inside_area
from tracker.recordings.calibration_feet import CalibrationCase, Extrinsics, Nearness, Reference, nearness, reference_of

TIMES, MORE, ERRORS = 2.0, 0.08, 5.0
"""A correction is clearly better where its nearness is at least TIMES the given one plus MORE, and higher by ERRORS standard errors."""
HEIGHTS, HEIGHTS_TIMES = 0.4, 4.0
"""By heights alone: the share of boxes with the height of a person is at least HEIGHTS, and HEIGHTS_TIMES as much as before."""
LEAST_TALL = 0.2
"""Least share of boxes with the height of a person in a right calibration. Nearness is not enough: cameras shrunk into a point agree."""
LEAST_BOXES = 20
MOST_CAMERAS = 12
"""Most cameras of which all pairs are compared. Of more cameras, those with the least agreement are compared."""
UNITS = {1e-3: ("mm", "millimetres"), 1e-2: ("cm", "centimetres"), 0.1: ("dm", "decimetres")}
"""m → short and long name."""
AREA_RATIO = (0.2, 5.0)
"""Bounds of the side of the area over that of the places of people."""
TOO_WIDE = 30.0
"""Least such ratio for an area in another unit; least ratio of the spreads of true people and feet for truth in another unit."""


@dataclass(frozen=True)
class Finding:
    """A likely error. kind: short name. cameras: those concerned, empty for all data. words: one or two sentences."""

    kind: str
    cameras: tuple[str, ...]
    words: str


Corrected = tuple[Finding, CalibrationCase]


def _as_given(case: CalibrationCase, names: Iterable[str]) -> CalibrationCase:
    return case


@dataclass(frozen=True)
class Correction:
    """A correction of some cameras. kind: short name. words: what is wrong. apply: (case, names of cameras) → the corrected case."""

    kind: str = ""
    words: str = ""
    apply: Callable[[CalibrationCase, Iterable[str]], CalibrationCase] = _as_given


OPENGL = np.diag([1.0, -1.0, -1.0])
"""From the camera axes of OpenGL and Blender (right, up, backward) to ours (right, down, ahead)."""
FORMS: dict[str, tuple[Callable[[Array, Array], Extrinsics], str]] = {
    "": (lambda R, t: (R, t), ""),
    "rotation-transposed": (lambda R, t: (R.T, t), "R is transposed (it turns camera axes into world axes)"),
    "translation-is-centre": (lambda R, t: (R, -R @ t), "t is the place of the camera c, and needs to be -R c"),
    "camera-to-world": (lambda R, t: (R.T, -R.T @ t), "R and t lead from camera to world, and need to be R^T and -R^T t"),
    "opengl-axes": (lambda R, t: (OPENGL @ R, OPENGL @ t), "the camera's axes are OpenGL's (y up, z backward), and need to be y down, z ahead"),
    "opengl-camera-to-world": (
        lambda R, t: (OPENGL @ R.T, -OPENGL @ R.T @ t),
        "R and t lead from a camera with OpenGL's axes (y up, z backward) to the world; with G = diag(1, -1, -1) they need to be G R^T and -G R^T t",
    ),
}
"""Kind → the correction of the extrinsics, and a description of the error."""


def _of_extrinsics(form: str, scale: float) -> Correction:
    change, words = FORMS[form]

    def apply(case: CalibrationCase, names: Iterable[str]) -> CalibrationCase:
        changed = {name: change(*case.extrinsics[name]) for name in names}
        return case.with_extrinsics({name: (R, t * scale) for name, (R, t) in changed.items()})

    kind = "+".join(part for part in (form, f"units-{UNITS[scale][0]}" if scale in UNITS else "") if part)
    unit = f"t is in {UNITS[scale][1]}, and needs to be in metres" if scale in UNITS else ""
    return Correction(kind, "; ".join(part for part in (words, unit) if part), apply)


def _of_boxes(kind: str, words: str, change: Callable[[Array, Camera], Array]) -> Correction:
    return Correction(kind, words, lambda case, names: case.with_changed_boxes(names, change))


def _of_width(width: int) -> Correction:
    words = f"boxes are of images {width} px wide, and need to be of those of the calibration"
    return _of_boxes("boxes-of-other-size", words, lambda box, lens: box * (lens.width / width))


AS_GIVEN = Correction()
EXTRINSICS = tuple(_of_extrinsics(form, scale) for scale in (1.0, *UNITS) for form in FORMS if form or scale != 1.0)
BOXES = (
    _of_boxes("boxes-in-shares", "boxes are shares of the image, and need to be in pixels", lambda b, lens: b * ([lens.width, lens.height] * 2)),
    _of_boxes(
        "boxes-mirrored",
        "boxes are of mirrored images",
        lambda b, lens: np.column_stack([lens.width - b[:, 0] - b[:, 2], b[:, 1:]]),
    ),
    _of_boxes("boxes-of-half-size", "the calibration is of images twice the size of those with the boxes", lambda b, _: 2.0 * b),
    _of_boxes("boxes-of-twice-the-size", "the calibration is of images half the size of those with the boxes", lambda b, _: b / 2),
    *(_of_width(width) for width in (320, 416, 512, 640, 800, 960, 1024, 1280, 1920, 3840)),
)


@dataclass(frozen=True)
class Trial:
    """A correction as tested: nearness to people, and the share of boxes with the height of a person."""

    correction: Correction
    near: Nearness
    plausible: float

    def clearly_better(self, given: Trial, alone: bool) -> bool:
        """Whether the trial is clearly better than `given`. alone: whether heights suffice where neither trial has feet near people."""
        if better(self.near, given.near) and self.plausible >= max(LEAST_TALL, 0.8 * given.plausible):
            return True
        by_heights = self.plausible >= max(HEIGHTS, HEIGHTS_TIMES * given.plausible) and len(self.near.gain) >= LEAST_BOXES
        return alone and by_heights and given.near.mean < MORE and self.near.mean > -MORE


def better(near: Nearness, given: Nearness) -> bool:
    """Whether feet are clearly nearer to people than with the given calibration, whose feet are far from people."""
    if near.boxes < LEAST_BOXES or near.mean < TIMES * given.mean + MORE:
        return False
    more, error = near.better_than(given)
    return more > ERRORS * error


def wrong_extrinsics(case: CalibrationCase) -> Corrected | None:
    """The correction of R and t that is clearly better, with the cameras that need it."""
    return _corrected(case, EXTRINSICS)


def wrong_boxes(case: CalibrationCase) -> Corrected | None:
    """The correction of boxes that is clearly better: other units, mirrored images, or images of another size."""
    return _corrected(case, BOXES)


def _corrected(case: CalibrationCase, corrections: Corrections) -> Corrected | None:
    found = _each(case, corrections, case.reference) if case.truth is not None else _by_agreement(case, corrections)
    found = found or _by_heights(case, corrections)
    if not found:
        return None
    words = [trial.correction.words for trial, _ in found.values()]
    most = max(dict.fromkeys(words), key=words.count)
    chosen = _extended(case, {name: trials for name, trials in found.items() if trials[0].correction.words == most})
    correction = next(iter(chosen.values()))[0].correction
    now, before = (float(np.mean([one.plausible for one in ones])) for ones in zip(*chosen.values(), strict=True))
    figures = f"So read, {now:.0%} of the boxes have the height of a person, {before:.0%} as given"
    return Finding(correction.kind, tuple(chosen), f"{_named(chosen, case)}: {correction.words}. {figures}"), correction.apply(case, chosen)


Corrections = tuple[Correction, ...]
Found = dict[str, tuple[Trial, Trial]]
"""Camera → the trial of the correction, and the trial of the given calibration."""


def _extended(case: CalibrationCase, found: Found) -> Found:
    """Add cameras whose heights alone support the same correction. Such a camera may be far from the true people, or agree badly."""
    correction, empty = next(iter(found.values()))[0].correction, reference_of([])
    out: Found = {}
    for name in case.lenses:
        given, trial = (_trial(case, name, one, empty) for one in (AS_GIVEN, correction))
        if name in found or trial.clearly_better(given, alone=True):
            out[name] = found.get(name, (trial, given))
    return out


def _named(names: Found, case: CalibrationCase) -> str:
    return "all cameras" if len(names) == len(case.lenses) > 1 else ", ".join(names)


def _trial(case: CalibrationCase, name: str, correction: Correction, reference: Reference) -> Trial:
    feet = correction.apply(case, (name,)).sampled_feet(name)
    return Trial(correction, nearness(feet, reference), feet.plausible(case.band))


def _best(trials: list[Trial], given: Trial, alone: bool = False) -> Trial | None:
    good = [trial for trial in trials if trial.clearly_better(given, alone)]
    return max(good, key=lambda trial: trial.near.mean + trial.plausible, default=None)


def _each(case: CalibrationCase, corrections: Corrections, reference_for: Callable[[str], Reference], alone: bool = False) -> Found:
    """Test each camera separately."""
    found: Found = {}
    for name in case.lenses:
        reference = reference_for(name)
        given = _trial(case, name, AS_GIVEN, reference)
        best = _best([_trial(case, name, correction, reference) for correction in corrections], given, alone)
        if best is not None:
            found[name] = best, given
    return found


def _by_heights(case: CalibrationCase, corrections: Corrections) -> Found:
    empty = reference_of([])
    return _each(case, corrections, lambda _: empty, alone=True) if case.truth is None or _far_from_truth(case) else {}


def _far_from_truth(case: CalibrationCase) -> bool:
    """Whether no camera has feet near the truth. The truth then cannot test cameras; its own unit may be wrong."""
    return all(nearness(case.sampled_feet(name), case.reference(name)).mean < MORE for name in case.lenses)


def _by_agreement(case: CalibrationCase, corrections: Corrections) -> Found:
    """Without truth: one camera against the others as given, or all cameras with the same correction."""
    case = case.part()
    single = _each(case, corrections, case.others)
    together = _together(case, corrections)
    if together is None or (single and min(trial.near.mean for trial, _ in single.values()) > together[0].near.mean):
        return single if len(single) < len(case.lenses) or together is None else {}
    return dict.fromkeys(case.lenses, together)


def _together(case: CalibrationCase, corrections: Corrections) -> tuple[Trial, Trial] | None:
    trials = [Trial(correction, *agreement(correction.apply(case, case.lenses))) for correction in (AS_GIVEN, *corrections)]
    best = _best(trials[1:], trials[0])
    return None if best is None else (best, trials[0])


def agreement(case: CalibrationCase, names: tuple[str, ...] = ()) -> tuple[Nearness, float]:
    """Nearness of the feet of the cameras, all where none are named, to those of the others; and the mean share of plausible heights."""
    names = names or tuple(case.lenses)
    feet = {name: case.feet(name) for name in case.lenses}
    near, plausible = [], []
    for name in names:
        own = feet[name].select(case.sample(name))
        near.append(nearness(own, reference_of([other for key, other in feet.items() if key != name])))
        plausible.append(own.plausible(case.band))
    return reduce(add, near), float(np.mean(plausible))


def wrong_truth_unit(case: CalibrationCase) -> Corrected | None:
    """Truth in a smaller unit than metres."""
    if case.truth is None:
        return None

    def near(scale: float) -> Nearness:
        assert case.truth is not None
        reference = Reference(case.truth.frame, case.truth.point * scale)
        return reduce(add, [nearness(case.sampled_feet(name), reference) for name in case.lenses])

    # Truth that is scaled too small lies in one point, which may be near feet. So only truth that is spread too widely is tried.
    feet = np.concatenate([case.sampled_feet(name).point for name in case.lenses])
    if _spread(case.truth.point) < TOO_WIDE * _spread(feet):
        return None
    given, trials = near(1.0), {scale: near(scale) for scale in UNITS}
    scale = max(trials, key=lambda key: trials[key].mean)
    if not better(trials[scale], given):
        return None
    words = f"truth: x and y are in {UNITS[scale][1]}, and need to be in metres. So read, feet are near true people; as given, near none"
    truth = replace(case.truth, point=case.truth.point * scale)
    return Finding(f"truth-{UNITS[scale][0]}", (), words), replace(case, truth=truth)


def _spread(points: Array) -> float:
    """m: diagonal of the box from the 5th to the 95th percentile of points (n, 2) m; NaN are left out; inf without points."""
    points = points[np.isfinite(points[:, 0])]
    return float(np.linalg.norm(np.subtract(*np.percentile(points, [95, 5], axis=0)))) if len(points) else np.inf


def wrong_area_unit(case: CalibrationCase) -> Corrected | None:
    """An area in a smaller unit than metres. It is far larger than the places of people, and the scaled area contains most of them."""
    if case.area is None:
        return None
    places = case.truth.point if case.truth is not None else np.concatenate([case.sampled_feet(name).point for name in case.lenses])
    places = places[np.isfinite(places[:, 0])]
    if len(places) < LEAST_BOXES:
        return None
    side = float(np.linalg.norm(case.area[1] - case.area[0])) / max(_spread(places), 1.0)
    for scale, (short, unit) in UNITS.items():
        inside = inside_area(places, case.area * scale).mean()
        if side > TOO_WIDE and AREA_RATIO[0] < side * scale < AREA_RATIO[1] and inside > 0.5:
            words = f"area: is in {unit}, and needs to be in metres. So read, {inside:.0%} of the people are in it"
            return Finding(f"area-{short}", (), words), replace(case, area=case.area * scale)
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
    """Camera → the camera whose boxes fit its calibration, for cameras whose own boxes do not fit. It is the optimal assignment."""
    own = {name: nearness(case.sampled_feet(name), case.reference(name)) for name in case.lenses}
    names = sorted(case.lenses, key=lambda name: own[name].mean)[:MOST_CAMERAS]
    swapped = {(a, b): case.with_boxes_of({a: b}).sampled_feet(a) for a in names for b in names if a != b}
    near = {(a, a): own[a] for a in names} | {pair: nearness(feet, case.reference(pair[0])) for pair, feet in swapped.items()}
    gain = np.array([[near[a, b].mean for b in names] for a in names])
    order = dict(zip(names, linear_sum_assignment(-gain)[1].tolist(), strict=True))
    out: dict[str, str] = {}
    for cycle in _cycles([order[name] for name in names]):
        new = [near[names[k], names[order[names[k]]]] for k in cycle]
        old = [own[names[k]] for k in cycle]
        if len(cycle) > 1 and better(reduce(add, new), reduce(add, old)) and all(n.mean > o.mean + MORE / 2 for n, o in zip(new, old, strict=True)):
            out |= {names[k]: names[order[names[k]]] for k in cycle}
    return {name: out[name] for name in case.lenses if name in out}


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
    """Nearness of the feet of two cameras to those of the rest, because two swapped cameras in opposite corners of a room agree."""
    rest = [name for name in case.lenses if name not in pair]
    if not rest:
        return agreement(case, pair)[0]
    reference = reference_of([case.feet(name) for name in rest])
    return reduce(add, [nearness(case.sampled_feet(name), reference) for name in pair])
