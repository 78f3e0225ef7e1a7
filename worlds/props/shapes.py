"""Boxes, columns and surfaces of revolution with texture coordinates, joined into one mesh per piece; and the surfaces used as cloth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worlds.engine import mujoco
from worlds.terrain.heightfield import Array
from worlds.textures.furniture_atlas import Surface, crop

SIDES = 20
WHOLE = np.array([[0.0, 0.0], [1.0, 1.0]])
"""Texture coordinates of a whole picture."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh: vertices (n, 3) m, faces (m, 3) anticlockwise from outside, texcoord (n, 2), v downwards in the picture."""

    vertices: Array
    faces: NDArray[np.int64]
    texcoord: Array

    def __add__(self, other: Shape) -> Shape:
        return joined([self, other])

    def moved(self, offset: ArrayLike, rotation: ArrayLike | None = None) -> Shape:
        """The shape turned by a rotation (3, 3), then moved by offset (3,) m."""
        vertices = self.vertices if rotation is None else self.vertices @ np.asarray(rotation, dtype=np.float64).T
        return replace(self, vertices=vertices + np.asarray(offset, dtype=np.float64))

    def turned(self, yaw: float, offset: ArrayLike) -> Shape:
        """The shape turned by yaw rad about the vertical, then moved by offset (3,) m."""
        c, s = np.cos(yaw), np.sin(yaw)
        return self.moved(offset, [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def add_to(self, spec: mujoco.MjSpec, name: str, material: str, pos: ArrayLike = (0, 0, 0), yaw: float = 0.0) -> mujoco.MjsGeom:
        """The shape as a mesh and a geom of that name in the world body, turned by yaw radians and put at pos (3,) m.

        It is drawn and hit by rays as it is, and collides as its convex hull.
        """
        mesh = spec.add_mesh(name=name, uservert=self.vertices.ravel(), userface=self.faces.ravel(), usertexcoord=self.texcoord.ravel())
        # Furniture is no watertight solid; nothing here moves, so that the hull's inertia will do.
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        quat = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        return spec.worldbody.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, pos=np.asarray(pos, dtype=np.float64), quat=quat, material=material, group=1
        )


def joined(shapes: Sequence[Shape]) -> Shape:
    """All of them as one mesh."""
    first = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    faces = np.concatenate([shape.faces + k for shape, k in zip(shapes, first[:-1], strict=True)])
    return Shape(np.concatenate([shape.vertices for shape in shapes]), faces, np.concatenate([shape.texcoord for shape in shapes]))


def quad(corners: ArrayLike, texture: Array) -> Shape:
    """A plane of four corners (4, 3) m, anticlockwise from the lower left, seen from its front; texture [[u0, v0], [u1, v1]]."""
    (u0, v0), (u1, v1) = texture
    texcoord = np.array([[u0, v1], [u1, v1], [u1, v0], [u0, v0]])
    return Shape(np.asarray(corners, dtype=np.float64), np.array([[0, 1, 2], [0, 2, 3]]), texcoord)


def box(rng: np.random.Generator, surface: Surface, low: ArrayLike, high: ArrayLike, front: Surface | None = None) -> Shape:
    """An upright box from low (3,) to high (3,) m, each face another piece of the surface; `front` is the one that looks along −y."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    kinds = (surface if front is None else front, *[surface] * 5)
    sizes = [(x1 - x0, z1 - z0), (y1 - y0, z1 - z0)] * 2 + [(x1 - x0, y1 - y0)] * 2
    textures = [crop(rng, kind, size) for kind, size in zip(kinds, sizes, strict=True)]
    return _upright(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), (z0, z1), textures)


def _upright(ring: Array, heights: tuple[float, float], textures: Sequence[Array]) -> Shape:
    """Upright sides over four corners (4, 2) m, anticlockwise, between two heights m, and the upper and the lower lid, each with its texture."""
    low, high = heights
    sides = [[(*a, low), (*b, low), (*b, high), (*a, high)] for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    lids = [(*corner, high) for corner in ring], [(*corner, low) for corner in ring[::-1]]
    return joined([quad(corners, texture) for corners, texture in zip([*sides, *lids], textures, strict=True)])


def column(rng: np.random.Generator, surface: Surface, radius: float, height: float) -> Shape:
    """A round column on the origin; its surface goes once around, with a seam behind."""
    angle = np.linspace(-np.pi, np.pi, SIDES + 1)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    (u0, v0), (u1, v1) = crop(rng, surface, (2 * np.pi * radius, height))
    u = np.linspace(u0, u1, SIDES + 1)
    low, high = np.column_stack([ring, np.zeros(SIDES + 1)]), np.column_stack([ring, np.full(SIDES + 1, height)])
    vertices = np.concatenate([low, high, high[:-1]])
    texcoord = np.concatenate([np.column_stack([u, np.full(SIDES + 1, v1)]), np.column_stack([u, np.full(SIDES + 1, v0)])])
    middle = np.array([0.5 * (u0 + u1), 0.5 * (v0 + v1)])
    lid = middle + 0.05 * ring[:-1] / radius * (u1 - u0)
    k = np.arange(SIDES)
    sides = np.concatenate([np.stack([k, k + 1, k + SIDES + 2], axis=1), np.stack([k, k + SIDES + 2, k + SIDES + 1], axis=1)])
    top = 2 * SIDES + 2 + np.stack([np.zeros(SIDES - 2, dtype=np.int64), k[1:-1], k[2:]], axis=1)
    return Shape(vertices, np.concatenate([sides, top]), np.concatenate([texcoord, lid]))


def prism(corners: ArrayLike, low: float, high: float) -> Shape:
    """An upright wall over four corners (4, 2) m, anticlockwise. Its first side shows the whole picture, the other faces the picture's rim.

    Seen from outside, the first side runs from left to right.
    """
    return _upright(np.asarray(corners, dtype=np.float64), (low, high), [WHOLE, *[np.array([[0.0, 0.0], [0.02, 0.01]])] * 5])


CLOTHES = (Surface.BLUE, Surface.RED, Surface.GREEN, Surface.DARK, Surface.STEEL, Surface.WALNUT, Surface.WHITE)


def revolved(rng: np.random.Generator, surface: Surface, profile: ArrayLike, flat: float = 1.0) -> Shape:
    """A surface of revolution about z. profile: (k, 2) m of radius and height, upwards; flat: depth along y, as a share of the width."""
    rows = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(-np.pi, np.pi, SIDES + 1)
    ring = np.stack([np.cos(angle), flat * np.sin(angle)], axis=1)
    low, high = rows[0, 1], rows[-1, 1]
    (u0, v0), (u1, v1) = crop(rng, surface, (2 * np.pi * float(rows[:, 0].max()), float(high - low)))
    vertices = np.concatenate([np.column_stack([radius * ring, np.full(len(ring), z)]) for radius, z in rows])
    share = (rows[:, 1] - low) / (high - low)
    texcoord = np.stack(np.broadcast_arrays(np.linspace(u0, u1, SIDES + 1), v1 + (v0 - v1) * share[:, None]), axis=-1).reshape(-1, 2)
    i, j = (n.ravel() for n in np.mgrid[: len(rows) - 1, :SIDES])
    a = i * (SIDES + 1) + j
    b, c, d = a + 1, a + SIDES + 2, a + SIDES + 1
    return Shape(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), texcoord)
