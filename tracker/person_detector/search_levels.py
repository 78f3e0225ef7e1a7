"""Where people are searched in an image: levels of scale, each for bodies of some heights, in the rows where such bodies can be.

A panorama sees the whole sphere, but people stand on the ground. The height of a body in px determines its distance, and so its rows.
A fine level, which is for small bodies, needs only a narrow band of rows near the horizon. The cost grows with the bands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.ground import Ground
from tracker.geometry.panoramas import Panorama, PanoramicCamera
from tracker.person_detector.found_boxes import FoundBoxes
from tracker.person_detector.network import MULTIPLE, STRIDE

LEAST_ROWS = 256
"""px: the coarsest level of an image is at least as high, and less than twice as high. A level at half size always exists."""
TALLEST, SMALLEST = (288.0, 192.0), (96.0, 80.0)
"""px of a level: the tallest bodies that are taken from it, unless it is the coarsest. The next coarser level takes those of SMALLEST and more.

The second value of each is for panoramas with more than two levels, and makes their bands narrower.
"""
MAGNIFIED, REASON = (90.0, 60.0), (-2.0, -1.5)
"""Height, px of the finest level, below which bodies are searched at twice the size; least logit of a peak that triggers it. Pairs as above."""
POLES = 8
"""The upper and lower 1/POLES of a panorama are searched at the coarsest level only, because bodies there are large and distorted."""
SHORT, TALL = 1.5, 2.1
"""m: people of SHORT and more are in the band of their level; nobody reaches above TALL."""
BAND_SLACK = 0.03
"""Share of the height of a box by which its edge may miss the end of a band."""
DISTANCES = np.geomspace(0.5, 200.0, 240)
"""m: at which people may stand."""
TILT = math.radians(6.0)
"""rad: of a rover, beside that of its mount: slopes, curbs and the swing of its mast. Training has a standard deviation of half of it."""
STEP, AROUND, USUAL = 2.0, 32.0, 0.95
"""m between points of the ground that are compared, and how far around a camera they are; the quantile of their differences that counts."""


@dataclass(frozen=True, eq=False)
class CameraHeight:
    """The height of a camera over the ground on which people stand.

    bounds: m. tilt: rad, by which the camera may be off the vertical. relief: m, by which ground at each of DISTANCES may be higher or lower,
    None for level ground. The defaults are for an unknown camera on a table, a rover or a tripod, nearly upright.
    """

    bounds: tuple[float, float] = (0.8, 1.8)
    tilt: float = math.radians(8.0)
    relief: Array | None = None

    @staticmethod
    def of(T_world_camera: Pose, ground: Ground, moves: bool) -> CameraHeight | None:
        """The height of a camera at a pose, None where that is not above the ground.

        moves: whether it is on a robot, which may be anywhere on similar ground, and tilted by TILT.
        """
        place = T_world_camera.translation
        height = float(place[2] - ground.height_at(place[None])[0])
        if not height > 0:
            return None
        side = np.arange(-AROUND, AROUND, STEP)
        level = ground.height_at((place[:2] + np.stack(np.meshgrid(side, side), axis=-1)).reshape(-1, 2)).reshape(len(side), -1)
        steps = np.arange(1, len(side) // 2)
        apart = [np.concatenate([np.abs(level[k:] - level[:-k]).ravel(), np.abs(level[:, k:] - level[:, :-k]).ravel()]) for k in steps]
        relief = np.interp(DISTANCES, np.append(0, STEP * steps), [0.0, *(float(np.quantile(one, USUAL)) for one in apart)])
        upright = math.acos(min(1.0, float(T_world_camera.rotation[2, 2])))
        return CameraHeight((height, height), upright + (TILT if moves else 0.0), relief)


@dataclass(frozen=True)
class SearchLevel:
    """A level: an image 2^halvings times smaller, of which some rows are searched for bodies of some heights.

    heights: px of the picture, the upper bound excluded. rows: first and end, px of the picture; the first is a multiple of 2^halvings.
    magnified: px; bodies below are searched again at twice the size, 0 for none. reason: least logit of a peak that triggers it.
    """

    halvings: int
    heights: tuple[float, float]
    rows: tuple[int, int]
    magnified: float = 0.0
    reason: float = math.inf

    def in_band(self, found: FoundBoxes, rows: int) -> FoundBoxes:
        """The boxes that do not end with the band inside an image of `rows` px, because those may show a part of a taller person."""
        top, bottom = found.box[:, 1], found.box[:, 1] + found.box[:, 3]
        slack = STRIDE / 2 * 2.0**self.halvings + BAND_SLACK * found.height
        cut = (top < self.rows[0] + slack) & (self.rows[0] > 0) | (bottom > self.rows[1] - slack) & (self.rows[1] < rows)
        return found.select(np.asarray(~cut))


def search_levels(shape: tuple[int, ...], camera: PanoramicCamera | None = None, above: CameraHeight | None = None) -> list[SearchLevel]:
    """The levels for an image of shape (H, W, …), the finest first.

    camera: of a panorama, whose levels but the coarsest are searched in bands; None for images whose rows are all searched at every level.
    above: the height of that camera, None where it is not known.
    """
    rows, out = shape[0], []
    coarsest = max(1, int(math.log2(max(rows / LEAST_ROWS, 1.0))))
    large = int(coarsest > 1 and camera is not None)
    for k in range(coarsest + 1):
        low = SMALLEST[large] * 2 ** (k - 1) if k else 0.0
        high = TALLEST[large] * 2**k if k < coarsest else math.inf
        taken = SMALLEST[large] * 2**k if k < coarsest else math.inf
        # Feet of a person at arm's length are nearer than the body, and no coarser level would find who ends outside a band.
        band = (0.0, float(rows)) if camera is None or k == coarsest else _band(camera, above or CameraHeight(), high, taken)
        again = (0.0, math.inf) if k else (MAGNIFIED[large], REASON[large])
        out.append(SearchLevel(k, (low, high), _whole_cells(band, 2**k, rows), *again))
    return out


def _band(camera: PanoramicCamera, above: CameraHeight, tallest: float, taken: float) -> tuple[float, float]:
    """First row and end of the bodies of at most `tallest` px. Those of `taken` px and more are searched at the next level, too.

    So the band allows for tilt and relief for bodies below `taken` px only.
    """
    low, high = above.bounds
    spans = [camera.rows_from_elevations(_up(-h)) - camera.rows_from_elevations(_up(SHORT - h)) for h in above.bounds]
    span, relief = np.min(spans, axis=0), np.zeros(len(DISTANCES)) if above.relief is None else above.relief
    ends = [0.0, 0.0]
    for height, sure in ((tallest, 0.0), (taken, 1.0)):
        there = span <= height
        up, down = _up(TALL - low + sure * relief)[there], _up(-high - sure * relief)[there]
        ends = [max(ends[0], up.max(initial=0.0) + sure * above.tilt), min(ends[1], down.min(initial=0.0) - sure * above.tilt)]
    first, end = camera.rows_from_elevations(np.clip(ends, -1.5, 1.5)).tolist()
    pole = camera.height / POLES if isinstance(camera, Panorama) else 0.0
    first, end = max(first, pole), min(end, camera.height - pole)
    return (first, end) if first < end else (0.0, float(camera.height))


def _up(height: float | Array) -> Array:
    """Elevations, rad, of points `height` m above a camera at all DISTANCES."""
    return np.asarray(np.arctan2(height, DISTANCES))


def _whole_cells(band: tuple[float, float], scale: int, rows: int) -> tuple[int, int]:
    """The band of rows, widened to multiples of what the network takes."""
    step, begin = MULTIPLE * scale, 2 * STRIDE * scale
    first = int(band[0]) // begin * begin
    return first, min(rows, first + -(-(math.ceil(band[1]) - first) // step) * step)
