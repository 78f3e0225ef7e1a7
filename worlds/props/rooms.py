"""Rooms: painted walls around an outline, partitions, door frames, beams and lamps."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from worlds.engine import mujoco
from worlds.props.shapes import Shape, box, prism
from worlds.terrain.heightfield import Array
from worlds.terrain.polygons import offset
from worlds.textures.furniture_atlas import Surface
from worlds.textures.materials import add_material
from worlds.textures.wall_fixtures import wall

# Walls reach this far below the lowest floor, m, so that no light comes in under them.
FOOTING = 0.3
DOOR_HEIGHT = 2.15
LAMP_SIZE = 1.1


def add_walls(spec: mujoco.MjSpec, rng: np.random.Generator, outline: ArrayLike, doors: Collection[int], size: tuple[float, float]) -> None:
    """Walls "wall0", "wall1" ... outside of the edges of an anticlockwise outline (k, 2) m, each with a texture of its own.

    doors: the edges that have a closed door in their middle. size: (thickness, height above 0) m. Walls cast no shadows: light comes
    from a bright hall around, and shadows of surfaces nearly parallel to the light show stripes.
    """
    thickness, height = size
    inner = np.asarray(outline, dtype=np.float64)
    outer = offset(inner, thickness)
    for k in range(len(inner)):
        n = (k + 1) % len(inner)
        width = float(np.hypot(*(inner[n] - inner[k])))
        add_material(spec, f"wall{k}", wall(rng, width, height, -FOOTING, k in doors), 0.05)
        # Seen from inside, the edge's end is on the left and its start on the right.
        ring = np.array([inner[n], inner[k], outer[k], outer[n]])
        prism(ring, -FOOTING, height).add_to(spec, f"wall{k}", f"wall{k}").castshadow = False


def add_partition(spec: mujoco.MjSpec, rng: np.random.Generator, name: str, ends: ArrayLike, size: tuple[float, float]) -> Array:
    """A wall that stands free between two ends (2, 2) m, painted on both sides; size (thickness, height above 0) m. Returns its corners (4, 2) m."""
    thickness, height = size
    a, b = np.asarray(ends, dtype=np.float64)
    across = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a)) * thickness / 2
    for side, (start, end, out) in {"left": (b, a, across), "right": (a, b, -across)}.items():
        label = f"{name}-{side}"
        add_material(spec, label, wall(rng, float(np.hypot(*(b - a))), height, -FOOTING), 0.05)
        prism([start + out, end + out, end, start], -FOOTING, height).add_to(spec, label, label).castshadow = False
    return np.array([a - across, b - across, b + across, a + across])


def add_frame(spec: mujoco.MjSpec, rng: np.random.Generator, name: str, opening: ArrayLike, height: float) -> list[Array]:
    """Two posts and a lintel in an opening between two points (2, 2) m with equal x or equal y, up to `height` m.

    Returns the footprints (4, 2) m of the posts.
    """
    low, high = np.sort(np.asarray(opening, dtype=np.float64), axis=0)
    along = int(np.argmax(high - low))
    half, post = 0.12, 0.09
    low[1 - along] -= half
    high[1 - along] += half
    surface = (Surface.WHITE, Surface.WALNUT, Surface.BLUE, Surface.GREEN)[int(rng.integers(4))]
    box(rng, surface, [*low, DOOR_HEIGHT], [*high, height]).add_to(spec, f"{name}-lintel", "furniture")
    feet = []
    for side in ("left", "right"):
        a, b = low.copy(), high.copy()
        if side == "left":
            b[along] = a[along] + post
        else:
            a[along] = b[along] - post
        box(rng, surface, [*a, -FOOTING], [*b, DOOR_HEIGHT]).add_to(spec, f"{name}-{side}", "furniture")
        feet.append(np.array([a, [b[0], a[1]], b, [a[0], b[1]]]))
    return feet


def add_beam(spec: mujoco.MjSpec, rng: np.random.Generator, name: str, ends: ArrayLike, height: float) -> None:
    """A beam under the open roof between two points (2, 2) m with equal x or equal y, with lamps along it. It casts no shadow."""
    low, high = np.sort(np.asarray(ends, dtype=np.float64), axis=0)
    along = int(np.argmax(high - low))
    low[1 - along] -= 0.05
    high[1 - along] += 0.05
    shape: Shape = box(rng, Surface.STEEL, [*low, height - 0.18], [*high, height])
    at = low[along] + rng.uniform(0.5, 1.5)
    while at < high[along] - LAMP_SIZE - 0.2:
        a, b = low.copy(), high.copy()
        a[along], b[along] = at, at + LAMP_SIZE
        a[1 - along] -= 0.06
        b[1 - along] += 0.06
        shape += box(rng, Surface.WHITE, [*a, height - 0.28], [*b, height - 0.2])
        at += LAMP_SIZE + rng.uniform(0.8, 2.2)
    shape.add_to(spec, name, "furniture").castshadow = False
