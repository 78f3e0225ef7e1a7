"""Meshes of shapes that a height field cannot represent: vaults, ledges, arches, slabs, boulders. All are solid, and all but vaults convex."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from worlds.props.shapes import Shape
from worlds.terrain.heightfield import Heightfield, Mask

PERIOD = 8.0
"""m: period of a texture on a mesh."""
STONES = 7
"""Stones of an arch: odd, so that one is the keystone."""


def wrapped(vertices: ArrayLike, faces: NDArray[np.int64], shift: ArrayLike = (0.0, 0.0)) -> Shape:
    """A mesh whose faces get texture coordinates by projection along the axis closest to their normal, with the period PERIOD m.

    shift (2,) m: position of the mesh's origin in the picture, so that pieces differ.
    No vertex is shared, so that edges are sharp, as on broken stone.
    """
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    main = np.argmax(np.abs(normal), axis=1)
    # Seen along x: (y, −z); along y: (x, −z); along z: (x, −y). v goes downwards in pictures.
    across, down = np.array([1, 0, 0])[main], np.array([2, 2, 1])[main]
    rows = np.arange(len(faces))[:, None]
    u, v = corners[rows, np.arange(3), across[:, None]], -corners[rows, np.arange(3), down[:, None]]
    texcoord = (np.stack([u, v], axis=-1).reshape(-1, 2) + np.asarray(shift)) / PERIOD
    return Shape(corners.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), texcoord)


def hull(points: ArrayLike, shift: ArrayLike = (0.0, 0.0)) -> Shape:
    """The convex hull of points (n, 3) m, with texture coordinates of `wrapped`. Raises ValueError if they lie in one plane."""
    cloud = np.asarray(points, dtype=np.float64)
    if np.linalg.matrix_rank(cloud - cloud[0], tol=1e-6) < 3:
        raise ValueError(f"{len(cloud)} points lie in one plane, need a body")
    solid = trimesh.convex.convex_hull(cloud)
    return wrapped(solid.vertices, np.asarray(solid.faces, dtype=np.int64), shift)


def slab(rng: np.random.Generator, size: ArrayLike, ragged: float = 0.08) -> Shape:
    """A flat stone around the origin, size (length, width, thickness) m: its top at z = 0 and level, its outline ragged by that share."""
    length, width, thickness = np.asarray(size, dtype=np.float64)
    sides = 9
    angle = np.linspace(0, 2 * np.pi, 4 * sides, endpoint=False) + rng.uniform(-0.05, 0.05, 4 * sides)
    # A superellipse: between an oval and a rectangle.
    ring = np.stack([np.sign(f) * np.abs(f) ** 0.4 for f in (np.cos(angle), np.sin(angle))], axis=1)
    ring *= np.array([length, width]) / 2 * (1 - ragged * rng.uniform(0, 1, (4 * sides, 1)))
    ring = ring[np.sort(rng.permutation(4 * sides)[: 2 * sides])]
    below = ring * (1 - 0.5 * thickness / min(length, width)) + rng.uniform(-0.01, 0.01, ring.shape)
    rings = [np.column_stack([ring, np.zeros(len(ring))]), np.column_stack([below, np.full(len(ring), -thickness)])]
    return hull(np.concatenate(rings), rng.uniform(0, PERIOD, 2))


def ledge(rng: np.random.Generator, size: ArrayLike) -> Shape:
    """A tongue of rock along +x from the origin, size (reach, width, thickness) m, its underside at z = 0: thick in the wall, thin at its end."""
    reach, width, thickness = np.asarray(size, dtype=np.float64)
    points = []
    for t in (-0.4, 0.0, 0.4, 0.75, 1.0):
        half = width / 2 * np.sqrt(max(0.06, 1 - max(t, 0.0) ** 2.5))
        for y in np.linspace(-half, half, 5):
            bulge = 1 - 0.4 * (y / max(half, 1e-9)) ** 2
            points.append((t * reach, y + rng.uniform(-0.05, 0.05), 0.12 * thickness * rng.uniform(0, 1)))
            points.append((t * reach, y * 0.9, thickness * (1 - 0.55 * max(t, 0.0)) * bulge + rng.uniform(-0.04, 0.04)))
    return hull(points, rng.uniform(0, PERIOD, 2))


def wedge(profile: ArrayLike, depth: float, shift: ArrayLike = (0.0, 0.0)) -> Shape:
    """A convex outline (k, 2) of x, z m, extruded along y by `depth` m with its middle at y = 0: voussoirs, gables, steps."""
    outline = np.asarray(profile, dtype=np.float64)
    x, z = outline.T
    return hull(np.concatenate([np.column_stack([x, np.full(len(x), side * depth / 2), z]) for side in (-1, 1)]), shift)


def tilted(shape: Shape, pitch: float, roll: float) -> Shape:
    """The shape turned about its origin: by roll rad about x, then by pitch rad about y (its +x end goes down where that is above 0)."""
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    rotation = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return replace(shape, vertices=shape.vertices @ rotation.T)


def arch(span: float, rise: float, ring: float, depth: float) -> list[Shape]:
    """The STONES of a round arch over an opening `span` m wide at the origin; it springs at z = `rise` m and is `ring` m thick."""
    stones = STONES
    angle = np.linspace(np.pi, 0, stones + 1)
    inner, outer = (r * np.stack([np.cos(angle), np.sin(angle)], axis=1) + np.array([0, rise]) for r in (span / 2, span / 2 + ring))
    return [wedge([inner[k], inner[k + 1], outer[k + 1], outer[k]], depth, (0.7 * k, 0.45 * k)) for k in range(stones)]


@dataclass(frozen=True, eq=False)
class Ceiling:
    """The underside of a vault: heights on a grid, and which cells (rows − 1, columns − 1) are closed."""

    underside: Heightfield
    closed: Mask

    def tiles(self, cells: int, thickness: float) -> list[Shape]:
        """Solid pieces of cells x cells cells, `thickness` m thick; together without gaps."""
        rows, columns = self.closed.shape
        pieces = []
        for i in range(0, rows, cells):
            for j in range(0, columns, cells):
                own = np.zeros_like(self.closed)
                own[i : i + cells, j : j + cells] = self.closed[i : i + cells, j : j + cells]
                if own.any():
                    pieces.append(self._solid(own, thickness))
        return pieces

    def _solid(self, own: Mask, thickness: float) -> Shape:
        columns = self.closed.shape[1] + 1
        count = self.underside.heights.size
        i, j = np.nonzero(own)
        a = i * columns + j
        b, c, d = a + 1, a + columns + 1, a + columns
        top = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        faces = [top[:, ::-1], top + count]
        # A side wherever the cell beyond it is not of this piece.
        beyond = np.pad(own, 1)
        for step, start, end in (((-1, 0), a, b), ((0, 1), b, c), ((1, 0), c, d), ((0, -1), d, a)):
            rim = ~beyond[i + 1 + step[0], j + 1 + step[1]]
            s, e = start[rim], end[rim]
            faces += [np.stack([s, e, e + count], axis=1), np.stack([s, e + count, s + count], axis=1)]
        low = np.column_stack([self.underside.nodes.reshape(-1, 2), self.underside.heights.ravel()])
        return wrapped(np.concatenate([low, low + np.array([0, 0, thickness])]), np.concatenate(faces))


CORNERS = 34


def boulder(rng: np.random.Generator, size: ArrayLike) -> Shape:
    """A stone around the origin with half lengths size (3,) m: round, with a few broken facets. Some 60 triangles."""
    half = np.asarray(size, dtype=np.float64)
    direction = rng.normal(size=(CORNERS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # Planes that cut the ball leave facets.
    cut = rng.normal(size=(5, 3))
    cut /= np.linalg.norm(cut, axis=1, keepdims=True)
    reach = rng.uniform(0.9, 1.0, CORNERS)
    for plane in cut:
        beyond = np.maximum(direction @ plane, 1e-9)
        reach = np.minimum(reach, rng.uniform(0.62, 0.85) / beyond)
    return hull(direction * reach[:, None] * half, rng.uniform(0, PERIOD, 2))


def stone_sizes(rng: np.random.Generator, count: int, least: float, most: float) -> np.ndarray:
    """Half lengths (count, 3) m of stones: many small ones and few large ones (a power law, as fragments have; Turcotte 1986), flatter than wide."""
    u = rng.uniform(0, 1, count)
    mean = least * (1 - u * (1 - (least / most) ** 2)) ** -0.5
    return mean[:, None] * rng.uniform(0.75, 1.25, (count, 3)) * np.array([1.0, 1.0, 0.75])
