"""What is rendered for a camera: the rows of its lenses that are read out together, and the halves of a stitched panorama.

The time of a frame is the end of its last row's exposure, since the simulation knows the past alone. A row's truth, instances and range, is that of
the middle of its exposure. Rows within a physics step are rendered together, at the time of their middle row.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sim.cameras import Rig
from sim.cameras.partial import PartialCamera
from sim.cameras.stitching import HalfPanorama
from sim.effects import Effects
from sim.rendering.coverage import UnoccludedExtent
from tracker.geometry import Array
from tracker.geometry.cameras import Camera


@dataclass(frozen=True, eq=False)
class ShutterPart:
    """Pixels of a camera that are read out together. rows: first one and end, of the lens. before: s from the middle of exposure to the frame."""

    camera: Camera | PartialCamera
    rows: tuple[int, int]
    before: float


@dataclass(frozen=True)
class ShutterTimes:
    """When rows are exposed. readout: s from the first row to the last; shutter: s of exposure; step: s, the largest time between two parts."""

    readout: float
    shutter: float
    step: float
    averaged: int

    @staticmethod
    def of(effects: Effects, step: float) -> ShutterTimes:
        return ShutterTimes(effects.readout or 0.0, effects.shutter or 0.0, step, effects.averaged)

    def parts(self, height: int) -> list[tuple[int, int, float]]:
        """First row, end and time before the frame of the parts of an image with `height` rows."""
        count = min(max(math.ceil(self.readout / self.step - 1e-9), 1), height)
        edges = [round(height * k / count) for k in range(count + 1)]
        return [(a, b, self.readout * (1 - (a + b) / 2 / height) + self.shutter / 2) for a, b in itertools.pairwise(edges)]

    def subframes(self, before: float) -> list[float]:
        """Times before the frame of the images that are averaged; the middle one is that of the truth."""
        n = self.averaged
        return [max(before + self.shutter * (k - (n - 1) / 2) / n, 0.0) for k in range(n)]


@lru_cache(maxsize=16)
def rig_of(text: str, width: int) -> Rig:
    """The rig of a camera's text. Equal arguments give the same object."""
    return Rig.of(text, width)


def lens_parts(camera: Camera, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    """The parts of a lens' image. Equal arguments give the same objects. All camera models have a hash."""
    assert isinstance(camera, Hashable)
    return _lens_parts(camera, times)


@lru_cache(maxsize=64)
def _lens_parts(camera: Any, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    rows = times.parts(camera.height)
    if len(rows) == 1:
        return (ShutterPart(camera, (0, camera.height), rows[0][2]),)
    mask, out = np.zeros((camera.height, camera.width), np.bool_), []
    for first, last, before in rows:
        mask[:] = False
        mask[first:last] = True
        out.append(ShutterPart(PartialCamera.of(camera, mask), (first, last), before))
    return tuple(out)


@lru_cache(maxsize=64)
def half_parts(half: HalfPanorama, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    """The parts of what a lens contributes to a stitched panorama: a pixel is exposed with the lens' row that it takes."""
    lens = half.stitching.lens
    u, v = np.meshgrid(np.arange(half.width) + 0.5, np.arange(half.height) + 0.5)
    own = ~half.blind(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(half.height, half.width)
    row = np.clip(np.rint(half.stitching.lens_rows(half.index)), 0, lens.height - 1)
    parts = [(own & (row >= first) & (row < last), first, last, before) for first, last, before in times.parts(lens.height)]
    return tuple(ShutterPart(PartialCamera.of(half, mask), (first, last), before) for mask, first, last, before in parts if mask.any())


def joined(extents: list[tuple[PartialCamera | Camera, UnoccludedExtent]], width: int, wraps: bool) -> UnoccludedExtent:
    """The extent of one body in a whole image, from those in its parts. wraps: whether the image is a full panorama of `width` px."""
    seen = [(camera, extent) for camera, extent in extents if extent.pixels]
    if not seen:
        return UnoccludedExtent(0, np.full(4, np.nan))
    corners = [(camera.left, camera.top) if isinstance(camera, PartialCamera) else (0, 0) for camera, _ in seen]
    boxes = np.array([extent.box + np.array([*corner, *corner]) for corner, (_, extent) in zip(corners, seen, strict=True)])
    return UnoccludedExtent(sum(extent.pixels for _, extent in seen), _around(boxes, width, wraps))


def _around(boxes: Array, width: int, wraps: bool) -> Array:
    """The smallest box (4,) around boxes (n, 4). In a panorama it may lie across the seam."""
    low, high = boxes[:, 1].min(), boxes[:, 3].max()
    if not wraps:
        return np.array([boxes[:, 0].min(), low, boxes[:, 2].max(), high])
    starts = np.unique(np.mod(boxes[:, 0], width))
    ends = [(np.mod(boxes[:, 0] - start, width) + boxes[:, 2] - boxes[:, 0]).max() for start in starts]
    best = int(np.argmin(ends))
    return np.array([starts[best], low, starts[best] + min(ends[best], width), high])
