"""The last test of a calibration: what a right recording shows, whatever may be wrong with another one. Each figure has a bound with a reason.

Agreement is the share of boxes whose feet are at a person of the same frame, above chance. It is 0 for a wrong calibration, in a crowd, too.
A place is as sure as its lower edge, which may miss the feet by a tenth of the body (Feet.error). So distant feet of a low camera may be metres off.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.geometry import Array, Mask
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA
from tracker.geometry.ground import inside_area
from tracker.recordings.calibration_feet import CalibrationCase, Feet, Nearness, Reference, nearness, reference_of

LEAST_BOXES = 40
"""Boxes of a camera below which nothing is said of it."""
IN_IMAGE = 0.8
"""Share of boxes with their middle in the image: a detector sees no other. Edges may lie outside."""
GROUNDED = 0.5
"""Share of boxes with feet on the ground: most boxes are of people, who stand below the horizon. False boxes may be above it."""
BODIES, STATURE = 0.25, (0.6, 2.7)
"""Share of boxes with the height of a body, m, children and people who sit included, and a tenth for errors of edges."""
INSIDE = 0.1
"""Share of boxes in the area. A camera may mostly see what is around it."""
WITH_TRUTH = 0.3
"""Agreement with true people: a detector of which two thirds of the boxes are false is of no use. An eighth of the rest is lost to its errors."""
WITH_CAMERAS = 0.2
"""Agreement with other cameras that see the place: less, as others miss people, and walls hide some."""
MIDDLE = 1.0
"""m: height of the middle of a body."""
MOST_CHANCE = 0.7
"""Above it nothing can be told: everybody stands at one place, or people are everywhere."""
ERRORS = 2.0
"""Standard errors by which agreement has to be below its bound."""
MOST_CAMERAS = 40
"""Cameras with which one is compared."""

Doubt = tuple[tuple[str, ...], str]
"""Cameras, and in words what they show and what a right recording shows."""


def doubts(case: CalibrationCase, alone: bool = False) -> list[Doubt]:
    """What no right recording shows, a line for each figure with the cameras concerned. Empty where nothing speaks against the calibration.

    alone: whether only figures of a camera by itself count, so that errors of other cameras and of the truth do not.
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
    """Agreement, and ERRORS standard errors more; None for fewer than LEAST_BOXES feet in frames with people."""
    near = nearness(feet, reference, by_error=True)
    if near.boxes < LEAST_BOXES:
        return None
    chance = float(near.chance[np.isfinite(near.gain)].mean())
    error = near.better_than(Nearness(np.zeros(len(near.gain)), near.block, near.chance))[1]
    return near.agreement + ERRORS * error / (1 - chance) if chance < MOST_CHANCE and np.isfinite(error) else None


def _with_others(case: CalibrationCase, feet: dict[str, Feet], name: str) -> float | None:
    """Agreement of the feet that another camera sees, with the feet of all others."""
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
