"""Measures of how irregular a world is, so that worlds can be compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from worlds.terrain.heightfield import Array, Mask
from worlds.world import World

PATCH = 0.4
"""m: slopes are those of heights averaged over a patch of this side, the scale of a foot or a wheel."""
WINDOW = 1.0
"""m: roughness is the deviation of heights from their mean over a window of this side."""
STEEP, IRREGULAR = np.deg2rad(10), np.deg2rad(5)
STEP = 0.05
"""m: the least rise from one grid point to the next, beyond what the slope there explains, that counts as a step."""
NEAR_STEP = 0.5
"""m from a step within which ground counts as irregular."""
TALL = 1.2
"""m over the ground: lower objects hide no walking person's upper half, so they are no occluders."""


@dataclass(frozen=True)
class Measures:
    """Measures of irregularity. Lengths are in m, shares in [0, 1].

    * extent_x, extent_y: the size of the ground.
    * relief: the highest minus the lowest ground where people may walk. The next four are measured there, too.
    * roughness: root mean square of the heights around their local mean.
    * steep_share: the share of the ground that is steeper than 10°.
    * highest_step: the greatest rise between neighbouring grid points beyond the slope.
    * irregular_share: the share that is steeper than 5° or within 0.5 m of a step of at least 5 cm.
    * feet_share, wheels_share: the shares of the extent that are free for people and for rovers.
    * occluders: objects at least 1.2 m high per 100 m² of the extent.
    """

    extent_x: float
    extent_y: float
    relief: float
    roughness: float
    steep_share: float
    highest_step: float
    feet_share: float
    wheels_share: float
    occluders: float
    irregular_share: float


def measure(world: World) -> Measures:
    """The measures of a world, on the grid of its ground."""
    ground, spacing = world.ground, world.ground.spacing
    heights = world.terrain.on_grid.heights
    free = world.feet.free
    size = ground.extent[1] - ground.extent[0]
    area = float(np.prod(size))
    slope = _slope(heights, spacing)
    step = _step(heights, slope, spacing)
    near = ndimage.distance_transform_edt(step < STEP) * spacing <= NEAR_STEP if (step >= STEP).any() else np.zeros_like(free)
    rough = heights - ndimage.uniform_filter(heights, max(3, round(WINDOW / spacing)), mode="nearest")
    standing = world.tops().heights - heights >= TALL
    return Measures(
        extent_x=float(size[0]),
        extent_y=float(size[1]),
        relief=float(np.ptp(heights[free])),
        roughness=float(np.sqrt(np.mean(rough[free] ** 2))),
        steep_share=_share(slope > STEEP, free),
        highest_step=float(step[free].max()),
        feet_share=world.feet.area / area,
        wheels_share=world.wheels.area / area,
        occluders=100 * int(ndimage.label(standing)[1]) / area,
        irregular_share=_share((slope > IRREGULAR) | near, free),
    )


def _slope(heights: Array, spacing: float) -> Array:
    """(rows, columns) rad."""
    smooth = ndimage.uniform_filter(heights, max(1, round(PATCH / spacing)), mode="nearest")
    return np.arctan(np.hypot(*np.gradient(smooth, spacing)))


def _step(heights: Array, slope: Array, spacing: float) -> Array:
    """(rows, columns) m: the greatest rise to a neighbour beyond what the slope around explains."""
    step = np.zeros_like(heights)
    for axis in (0, 1):
        rise = np.abs(np.diff(heights, axis=axis))
        before, after = (slice(None, -1), slice(1, None))
        for here in (before, after):
            where = (here, slice(None)) if axis == 0 else (slice(None), here)
            step[where] = np.maximum(step[where], rise - np.tan(np.minimum(slope[where], STEEP)) * spacing)
    return step


def _share(what: Mask, free: Mask) -> float:
    return float(what[free].mean())
