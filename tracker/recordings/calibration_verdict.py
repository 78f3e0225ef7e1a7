"""The last test of a calibration: bounds on figures that every right recording satisfies. The reason of each bound is given.

Agreement is the share of boxes whose feet are at a person of the same frame, above chance. It is 0 for a wrong calibration, even in a crowd.
A place is as accurate as its box's lower edge, which may miss the feet by a tenth of the body (Feet.error). So distant feet may be metres off.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.geometry import Array, Mask
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA
from tracker.geometry.ground import inside_area
from tracker.recordings.calibration_feet import CalibrationCase, Feet, Nearness, Reference, nearness, reference_of

LEAST_BOXES = 40
"""Least number of boxes of a camera that is tested."""
IN_IMAGE = 0.8
"""Least share of boxes with their middle in the image: a detector finds no others. Edges may lie outside."""
GROUNDED = 0.5
"""Least share of boxes with feet on the ground: most boxes are of people, who stand below the horizon. False boxes may be above it."""
BODIES, STATURE = 0.25, (0.6, 2.7)
"""Least share of boxes with the height of a body, and its bounds, m. They include children, seated people and a tenth for errors of edges."""
INSIDE = 0.1
"""Least share of boxes in the area. A camera may mostly see the surroundings of the area."""
WITH_TRUTH = 0.3
"""Least agreement with true people. A detector with two thirds false boxes is useless; its errors cost an eighth of the other boxes."""
WITH_CAMERAS = 0.2
"""Least agreement with other cameras that see the place. It is lower, because these cameras miss people, and walls hide some."""
MIDDLE = 1.0
"""m: height of the middle of a body."""
MOST_CHANCE = 0.7
"""Largest chance for which agreement is tested. Above it, everybody stands at one place, or people are everywhere."""
ERRORS = 2.0
"""Standard errors by which agreement has to be below its bound."""
MOST_CAMERAS = 40
"""Most cameras with which a camera is compared."""

Doubt = tuple[tuple[str, ...], str]
"""Cameras, and a text with their figures and the bound for a right recording."""


def doubts(case: CalibrationCase, alone: bool = False) -> list[Doubt]:
    """Figures that no right recording has, an entry for each figure with its cameras. Empty where all figures are within their bounds.

    alone: whether only figures of a camera by itself count, which errors of other cameras and of the truth do not change.
    """
    names = [name for name in case.lenses if sum(len(box) for box, _ in case.boxes[name].values()) >= LEAST_BOXES and _above(case, name)]
    feet = {name: case.sampled_feet(name) for name in names}
    out = [
        _below(names, lambda name: _in_image(case, name), IN_IMAGE, "of the boxes are in the image"),
        _below(names, lambda name: _share(feet[name].grounded), GROUNDED, "of the boxes have feet on the ground"),
        _below(names, lambda name: _bodies(feet[name]), BODIES, "of the boxes have the height of a body"),
        _below(names, lambda name: _inside(case, feet[name]), INSIDE, "of the boxes are in the area"),
    ]
    if case.truth is not None and not alone:
        inside = {name: _known(feet[name], _in_area(case, feet[name])) for name in names}
        out.append(_below(names, lambda name: _agreement(inside[name], case.reference(name)), WITH_TRUTH, "agree with true people"))
    if len(names) > 1 and not alone:
        out.append(_below(names, lambda name: _with_others(case, feet, name), WITH_CAMERAS, "agree with those of other cameras"))
    return [doubt for doubt in out if doubt is not None]


def _below(names: list[str], figure: Callable[[str], float | None], bound: float, words: str) -> Doubt | None:
    found = {name: value for name in names if (value := figure(name)) is not None and value < bound}
    if not found:
        return None
    figures = ", ".join(f"{max(value, 0):.0%}" for value in found.values())
    return tuple(found), f"{', '.join(found)}: {figures} {words}, needs {bound:.0%}"


def _above(case: CalibrationCase, name: str) -> bool:
    R, t = case.extrinsics[name]
    place = -R.T @ t
    return bool(place[2] > case.ground.height_at(place[None])[0])


def _share(rows: Mask) -> float | None:
    return float(np.mean(rows)) if len(rows) >= LEAST_BOXES else None


def _in_image(case: CalibrationCase, name: str) -> float | None:
    lens, box = case.lenses[name], np.concatenate([box for box, _ in case.boxes[name].values()])
    middle = box[:, :2] + box[:, 2:] / 2
    if lens.wraps:
        middle[:, 0] %= lens.width
    return _share(np.asarray(((middle >= 0) & (middle <= [lens.width, lens.height])).all(axis=1)))


def _bodies(feet: Feet) -> float | None:
    with np.errstate(invalid="ignore"):
        return _share(np.asarray((feet.height > STATURE[0]) & (feet.height < STATURE[1])))


def _in_area(case: CalibrationCase, feet: Feet) -> Mask:
    return inside_area(feet.point, case.area)


def _inside(case: CalibrationCase, feet: Feet) -> float | None:
    return None if case.area is None else _share(_in_area(case, feet)[feet.grounded])


def _known(feet: Feet, rows: Mask) -> Feet:
    return feet.select(np.flatnonzero(rows & feet.grounded))


def _agreement(feet: Feet, reference: Reference) -> float | None:
    """Agreement plus ERRORS standard errors; None for fewer than LEAST_BOXES feet in frames with people, and for a chance of MOST_CHANCE or more."""
    near = nearness(feet, reference, by_error=True)
    if near.boxes < LEAST_BOXES:
        return None
    chance = float(near.chance[np.isfinite(near.gain)].mean())
    error = near.better_than(Nearness(np.zeros(len(near.gain)), near.block, near.chance))[1]
    return near.agreement + ERRORS * error / (1 - chance) if chance < MOST_CHANCE and np.isfinite(error) else None


def _with_others(case: CalibrationCase, feet: dict[str, Feet], name: str) -> float | None:
    """Agreement of the feet in view of another camera with the feet of all other cameras."""
    others = [other for other in feet if other != name][:MOST_CAMERAS]
    own = _known(feet[name], _in_area(case, feet[name]))
    seen = np.zeros(len(own.frame), dtype=bool)
    points = np.column_stack([own.point, case.ground.height_at(own.point)])
    for other in others:
        R, t = case.extrinsics[other]
        sight = (points @ R.T + t) @ OPTICAL_FROM_CAMERA
        within = case.lenses[other].pixels_from_bearings(sight / np.maximum(np.linalg.norm(sight, axis=1), 1e-9)[:, None])[1]
        seen |= within & _free(case, -R.T @ t, points)
    return _agreement(own.select(np.flatnonzero(seen)), reference_of([case.feet(other) for other in others]))


def _free(case: CalibrationCase, place: Array, points: Array) -> Mask:
    """Whether no wall or furniture is between a camera at `place` (3,) m and the middle of bodies at `points` (n, 3) m."""
    if case.occluders is None or not len(points):
        return np.ones(len(points), dtype=bool)
    way = np.add(points, [0.0, 0.0, MIDDLE]) - place
    distance = np.linalg.norm(way, axis=1)
    hit, there = case.occluders.intersect(np.broadcast_to(place, way.shape), way / distance[:, None], float(distance.max()))
    return np.asarray(~there | (np.linalg.norm(hit - place, axis=1) > distance - MIDDLE))
