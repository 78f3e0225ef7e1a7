"""Building fronts with windows around a world, some of whose panes glare: they mirror the sun, or are lit from inside.

The picture of a front is a row of bays, all but the last with one window.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from worlds.engine import mujoco
from worlds.props.shapes import WHOLE, Shape, joined, quad
from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.polygons import turned
from worlds.textures.masonry import brick, concrete, plaster
from worlds.textures.materials import Box, Canvas, add_material, tint

BAY, STOREY = 3.0, 3.2
"""m: width of a bay and height of a storey."""
VARIANTS = 4
"""Bays of a picture; the last one has no window."""


def bay_box(variant: int) -> Array:
    """Texture coordinates [[u0, v0], [u1, v1]] of a bay, v downwards in the picture."""
    return np.array([[variant / VARIANTS, 0.0], [(variant + 1) / VARIANTS, 1.0]])


def facade(rng: np.random.Generator) -> tuple[Canvas, Box]:
    """The picture of the bays of a front, and the pane of its windows.

    The pane is x0, y0, x1, y1 m from the lower left corner of a bay.
    """
    material = (brick, brick, plaster, concrete)[int(rng.integers(4))]
    canvas = material(rng, VARIANTS * BAY, STOREY, 0.0)
    width, sill, top = rng.uniform(1.0, 2.4), rng.uniform(0.7, 1.1), rng.uniform(2.3, 2.7)
    pane = ((BAY - width) / 2, sill, (BAY + width) / 2, top)
    frame = tint(rng, ((236, 234, 228), (92, 44, 36), (60, 64, 68), (150, 152, 150))[int(rng.integers(4))], 8)
    glass = tint(rng, ((46, 58, 70), (70, 88, 104), (96, 116, 132))[int(rng.integers(3))], 8)
    mullions = int(rng.integers(1, 4))
    for variant in range(VARIANTS - 1):
        x0, y0, x1, y1 = (value + side * variant * BAY for value, side in zip(pane, (1, 0, 1, 0), strict=True))
        canvas.fill((x0, y0, x1, y1), glass)
        rows = canvas.window((x0, y0, x1, y1)).shape[0]
        # The upper part of a pane mirrors the sky, the lower one what is across the street.
        canvas.shade((x0, y0, x1, y1), np.linspace(rng.uniform(0.2, 0.7), rng.uniform(-0.4, 0.0), rows)[:, None])
        canvas.mottle(rng, (x0, y0, x1, y1), 0.3, 0.8, 3)
        if rng.uniform() < 0.5:
            canvas.fill((x0, rng.uniform(y0 + 0.4, y1 - 0.2), x1, y1), tint(rng, (212, 206, 192), 8), 0.7)
        for k in range(1, mullions + 1):
            x = x0 + k * (x1 - x0) / (mullions + 1)
            canvas.fill((x - 0.03, y0, x + 0.03, y1), frame)
        canvas.frame((x0, y0, x1, y1), frame, 0.07)
        canvas.fill((x0 - 0.1, y0 - 0.1, x1 + 0.1, y0), tint(rng, (176, 172, 164)))
        canvas.shade((x0 - 0.1, y0 - 0.16, x1 + 0.1, y0 - 0.1), -0.35)
    canvas.shade((0.0, STOREY - 0.05, canvas.width, STOREY), -0.2)
    return canvas, pane


BAYS, STOREYS = (3, 9), (1, 5)
"""Least and largest number of bays and of storeys, the upper one excluded."""
DISTANCE, DEPTH, FOOTING = (0.5, 8.0), 6.0, 3.0
"""m: distance of a front from the ground of the world, depth of a building, and how far it reaches below the ground beside it."""
FIRST = 1000
"""Number of the first building, beyond those of the walls of any world."""
SUN, INSIDE = (1.0, 0.99, 0.94, 1.0), (1.0, 0.86, 0.58, 1.0)
"""RGBA of panes that mirror the sun, and of panes with lamps behind them."""
MIRRORS = 0.5
"""Share of the glaring panes that mirror the sun."""
THICKNESS = 0.02
"""m: how far a glaring pane stands out."""


def add_facades(spec: mujoco.MjSpec, rng: np.random.Generator, ground: Heightfield, count: int, glare: float) -> None:
    """Put `count` buildings around the ground of a world, each with its front towards the world.

    Free space does not change, since nobody can be there. glare: probability that a window glares. Walls of rooms hide the buildings.
    """
    for name, colour in (("glare_sun", SUN), ("glare_inside", INSIDE)):
        spec.add_material(name=name, emission=1.0, specular=0.0, rgba=list(colour))
    for number in range(FIRST, FIRST + count):
        canvas, pane = facade(rng)
        name = f"wall{number}"
        add_material(spec, f"{name}-facade", canvas, 0.05)
        bays, storeys = int(rng.integers(*BAYS)), int(rng.integers(*STOREYS))
        place, yaw = _place(rng, ground.extent, bays * BAY)
        low, high = ground.extent
        on = np.array([*place, float(ground.height_at(np.clip(place, low, high)[None])[0])])
        front, windows = _front(rng, bays, storeys)
        parts = {"facade": (front + _body(bays * BAY, storeys * STOREY), f"{name}-facade")}
        # The number of draws does not depend on `glare`, so that the buildings do not either.
        glares, mirrors = rng.random(len(windows)) < glare, rng.random(len(windows)) < MIRRORS
        for part, some in (("sun", windows[glares & mirrors]), ("inside", windows[glares & ~mirrors])):
            if len(some):
                parts[part] = _panes(some, pane), f"glare_{part}"
        for part, (shape, material) in parts.items():
            geom = shape.add_to(spec, f"{name}-{part}", material, on, yaw)
            # Nobody reaches it, and its shadow would lie over half of the world.
            geom.contype, geom.conaffinity, geom.castshadow = 0, 0, False


def _place(rng: np.random.Generator, extent: Array, width: float) -> tuple[Array, float]:
    """The middle (2,) m of the foot of a front outside of an extent [[xmin, ymin], [xmax, ymax]], and its yaw.

    The yaw turns the front, which faces −y, towards the world.
    """
    low, high = np.asarray(extent)
    side, out = int(rng.integers(4)), float(rng.uniform(*DISTANCE))
    yaw = (0.0, -np.pi / 2, np.pi, np.pi / 2)[side]
    half = (high - low) / 2 if side % 2 == 0 else (high - low)[::-1] / 2
    along = rng.uniform(-1, 1) * max(0.0, half[0] - width / 4)
    return (low + high) / 2 + turned(np.array([[along, half[1] + out]]), yaw)[0], yaw


def _front(rng: np.random.Generator, bays: int, storeys: int) -> tuple[Shape, Array]:
    """The front of a building at y = 0, and the lower left corners (n, 2) m of x and z of its bays with a window."""
    shape, corners = _wall(bays * BAY, -FOOTING, 0.0), []
    for storey in range(storeys):
        for bay in range(bays):
            x, z, variant = (bay - bays / 2) * BAY, storey * STOREY, int(rng.integers(VARIANTS))
            square = [(x, 0, z), (x + BAY, 0, z), (x + BAY, 0, z + STOREY), (x, 0, z + STOREY)]
            shape += quad(square, bay_box(variant))
            if variant < VARIANTS - 1:
                corners.append((x, z))
    return shape, np.array(corners).reshape(-1, 2)


def _wall(width: float, low: float, high: float) -> Shape:
    """A wall without windows at y = 0."""
    half = width / 2
    return quad([(-half, 0, low), (half, 0, low), (half, 0, high), (-half, 0, high)], bay_box(VARIANTS - 1))


def _body(width: float, height: float) -> Shape:
    """The other walls and the roof."""
    half, blank = width / 2, bay_box(VARIANTS - 1)
    ring = [(half, 0.0), (half, DEPTH), (-half, DEPTH), (-half, 0.0)]
    shape = quad([(-half, 0, height), (half, 0, height), (half, DEPTH, height), (-half, DEPTH, height)], blank)
    for (ax, ay), (bx, by) in pairwise(ring):
        shape += quad([(ax, ay, -FOOTING), (bx, by, -FOOTING), (bx, by, height), (ax, ay, height)], blank)
    return shape


def _panes(corners: Array, pane: Box) -> Shape:
    """Panes as flat boxes before the front; corners (n, 2) m of x and z of their bays."""
    x0, z0, x1, z1 = pane
    sides = []
    for x, z in corners:
        ring = [(x + x0, z + z0), (x + x1, z + z0), (x + x1, z + z1), (x + x0, z + z1)]
        sides.append(quad([(a, -THICKNESS, b) for a, b in ring], WHOLE))
        for (ax, az), (bx, bz) in zip(ring, ring[1:] + ring[:1], strict=True):
            sides.append(quad([(ax, 0, az), (bx, 0, bz), (bx, -THICKNESS, bz), (ax, -THICKNESS, az)], WHOLE))
    return joined(sides)
