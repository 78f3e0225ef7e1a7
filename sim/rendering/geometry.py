"""Triangle geometry of a model: unit primitives, meshes, and height fields in tiles that can be culled one by one.

Round primitives and meshes have several levels of detail, finest first. The coarser levels of the mesh `name` are the meshes `name@1`, `name@2`, …
The halves of a capsule are unit hemispheres. The vertex shader moves them apart by the capsule's length; the fourth coordinate is the sign.
Height fields are shaded flat, by the normal of a triangle's last corner, so that triangles share most corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from worlds.engine import mujoco

CELLS = 8
"""Cells along the edge of a tile. Smaller tiles are culled better, larger tiles need fewer draw commands."""

Points = NDArray[np.float32]

Numbers = NDArray[np.int64]


def tiles_of(model: mujoco.MjModel, hfield: int) -> list[tuple[Shape, Array]]:
    """Tiles of the height field of that index, in its geom's frame: its surface and side walls, without the bottom.

    Each has its box (6,): centre and half edges, m. The normal of a triangle's last corner is the normal of the triangle.
    """
    rows, columns, start = model.hfield_nrow[hfield], model.hfield_ncol[hfield], model.hfield_adr[hfield]
    width, depth, height, base = model.hfield_size[hfield].astype(np.float32)
    heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * height
    half = np.array([columns - 1, rows - 1], np.float32) / 2
    x = width * (np.arange(columns, dtype=np.float32) / half[0] - 1)
    y = depth * (np.arange(rows, dtype=np.float32) / half[1] - 1)
    nodes = np.stack([*np.meshgrid(x, y), heights], axis=-1).astype(np.float32)
    tiles: list[tuple[Shape, Array]] = []
    for i in range(0, rows - 1, CELLS):
        for j in range(0, columns - 1, CELLS):
            patch = nodes[i : i + CELLS + 1, j : j + CELLS + 1]
            rims = [(i == 0, patch[0]), (j + CELLS >= columns - 1, patch[:, -1]), (i + CELLS >= rows - 1, patch[-1, ::-1]), (j == 0, patch[::-1, 0])]
            parts = [_surface(patch), *(_skirt(rim, base) for outer, rim in rims if outer)]
            tiles.append(_tile(parts))
    return tiles


def _surface(patch: Points) -> tuple[Points, Numbers]:
    """Points and triangles of nodes (r, c, 3): each node twice, two triangles a cell, anticlockwise, split along (i, j) → (i+1, j+1)."""
    rows, columns = patch.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    # A node is the last corner of at most two triangles, one for each of its copies.
    triangles = np.stack([np.stack([a, c, d], axis=2), np.stack([c, a, b + rows * columns], axis=2)], axis=2)
    return np.concatenate([patch.reshape(-1, 3)] * 2), triangles.reshape(-1, 3)


def _skirt(rim: Points, base: np.float32) -> tuple[Points, Numbers]:
    """The wall from a rim (n, 3), anticlockwise around the field, down to the bottom of the height field."""
    foot = rim.copy()
    foot[:, 2] = -base
    k, n = np.arange(len(rim) - 1), len(rim)
    triangles = np.concatenate([np.stack([n + k + 1, k, k + 1], axis=1), np.stack([k, n + k + 1, n + k], axis=1)])
    return np.concatenate([foot, rim]), triangles


def _tile(parts: list[tuple[Points, Numbers]]) -> tuple[Shape, Array]:
    """The parts as one tile, and its box (6,); the normal of every triangle is stored at its last corner."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    points = np.concatenate([points for points, _ in parts])
    triangles = np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=True)])
    corners = points[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(facing, axis=1, keepdims=True)
    vertices = np.zeros((len(points), 9), np.float32)
    vertices[:, :3], vertices[:, 6] = points, 1.0
    vertices[triangles[:, 2], 4:7] = facing / np.where(length > 0, length, 1)
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    return Shape(vertices, triangles.astype(np.uint32)), np.concatenate([(low + high) / 2, (high - low) / 2])


G = mujoco.mjtGeom

SLICES = ((48, 28), (32, 18), (20, 12), (14, 8), (10, 6))
"""Slices around and from pole to pole of round shapes, finest level first."""

DRAWN = (G.mjGEOM_PLANE, G.mjGEOM_HFIELD, G.mjGEOM_SPHERE, G.mjGEOM_CAPSULE, G.mjGEOM_ELLIPSOID, G.mjGEOM_CYLINDER, G.mjGEOM_BOX, G.mjGEOM_MESH)

Indices = NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Shape:
    """Vertices (n, 9): x, y, z, sign of a capsule's half (0 or ±1), normal, texture u, v. Triangles (t, 3), anticlockwise from outside."""

    vertices: Points
    triangles: Indices


@dataclass(frozen=True, eq=False)
class ShapeBuffers:
    """Vertex and index buffers of all shapes of a model.

    vertices (n, 9), indices (m,): as in Shape. first, count, base (s,): first index, number of indices and first vertex of a shape.
    levels (s, k): shapes of its levels of detail, finest first, the last one repeated. boxes (s, 6): centre and half edges of a tile, m, else NaN.
    plain: geom type → finest shape. mesh, hfield: index in the model → shape, or shapes of the tiles.
    """

    vertices: Points
    indices: Indices
    first: Numbers
    count: Numbers
    base: Numbers
    levels: Numbers
    boxes: Array
    plain: dict[int, int]
    mesh: Numbers
    hfield: list[list[int]]

    @staticmethod
    def of(model: mujoco.MjModel) -> ShapeBuffers:
        shapes: list[Shape] = []
        levels_of: dict[int, list[int]] = {}
        plain = {}
        for kind, make in ((G.mjGEOM_SPHERE, sphere), (G.mjGEOM_CAPSULE, capsule), (G.mjGEOM_CYLINDER, cylinder)):
            plain[int(kind)] = len(shapes)
            levels_of[len(shapes)] = list(range(len(shapes), len(shapes) + len(SLICES)))
            shapes += [make(*resolution) for resolution in SLICES]
        plain[int(G.mjGEOM_ELLIPSOID)] = plain[int(G.mjGEOM_SPHERE)]
        for kind, shape in ((G.mjGEOM_BOX, box()), (G.mjGEOM_PLANE, plane())):
            plain[int(kind)] = len(shapes)
            shapes.append(shape)
        meshes = np.arange(len(shapes), len(shapes) + model.nmesh)
        shapes += [mesh(model, k) for k in range(model.nmesh)]
        for fine, levels in _levels_of_detail(model).items():
            levels_of[int(meshes[fine])] = [int(meshes[k]) for k in levels]
        boxes, hfields = [np.full(6, np.nan)] * len(shapes), []
        for k in range(model.nhfield):
            tiles = tiles_of(model, k)
            hfields.append(list(range(len(shapes), len(shapes) + len(tiles))))
            shapes += [shape for shape, _ in tiles]
            boxes += [extent for _, extent in tiles]
        return ShapeBuffers(*_joined(shapes), _padded(levels_of, len(shapes)), np.array(boxes), plain, meshes, hfields)


def _joined(shapes: list[Shape]) -> tuple[Points, Indices, Numbers, Numbers, Numbers]:
    """Vertices, indices, first, count and base of ShapeBuffers."""
    count = np.array([3 * len(shape.triangles) for shape in shapes])
    sizes = np.array([len(shape.vertices) for shape in shapes])
    vertices = np.concatenate([shape.vertices for shape in shapes]).astype(np.float32)
    indices = np.concatenate([shape.triangles.ravel() for shape in shapes]).astype(np.uint32)
    return vertices, indices, np.cumsum(count) - count, count, np.cumsum(sizes) - sizes


def _padded(levels_of: dict[int, list[int]], shapes: int) -> Numbers:
    """Levels of ShapeBuffers. levels_of: finest shape → all its levels, finest first, where it has several."""
    most = max([1, *(len(members) for members in levels_of.values())])
    levels = np.tile(np.arange(shapes)[:, None], (1, most))
    for shape, members in levels_of.items():
        levels[shape] = [*members, *[members[-1]] * (most - len(members))]
    return levels


def _levels_of_detail(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Meshes with coarser levels of detail → indices of all their levels, finest first."""
    number = {model.mesh(k).name: k for k in range(model.nmesh)}
    levels = {}
    for name, fine in number.items():
        coarser = [number[other] for level in range(1, 10) if (other := f"{name}@{level}") in number]
        if coarser:
            levels[fine] = [fine, *coarser]
    return levels


def sphere(around: int, along: int) -> Shape:
    """The unit sphere."""
    return _revolved(np.linspace(np.pi / 2, -np.pi / 2, along + 1), np.zeros(along + 1), around)


def capsule(around: int, along: int) -> Shape:
    """Two unit hemispheres, which the vertex shader moves apart, joined by a ring."""
    half = np.linspace(0, np.pi / 2, along // 2 + 1)
    return _revolved(np.concatenate([half[::-1], -half]), np.concatenate([np.ones(len(half)), -np.ones(len(half))]), around)


def _revolved(elevation: Array, away: Array, around: int) -> Shape:
    """Surface of revolution: rings of a unit sphere at these elevations, top first."""
    turn = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.cos(turn), np.sin(turn), np.ones(around)], axis=1)
    at = np.stack([np.cos(elevation), np.cos(elevation), np.sin(elevation)], axis=1)[:, None] * ring
    vertices = np.zeros((len(elevation), around, 9), np.float32)
    vertices[..., :3], vertices[..., 3], vertices[..., 4:7] = at, away[:, None], at
    rows, columns = len(elevation), np.arange(around)
    quads = [_quad(k * around + columns, (k + 1) * around + columns, (k + 1) * around + (columns + 1) % around, k * around + (columns + 1) % around)
             for k in range(rows - 1)]  # fmt: skip
    triangles = np.concatenate(quads)
    corners = vertices.reshape(-1, 9)[triangles][:, :, :4]
    area = np.linalg.norm(np.cross(corners[:, 1, :3] - corners[:, 0, :3], corners[:, 2, :3] - corners[:, 0, :3]), axis=1)
    # Half of every quadrilateral at a pole has no area. The ring of a capsule has none either until its halves are moved apart.
    return Shape(vertices.reshape(-1, 9), triangles[(area > 1e-9) | (np.ptp(corners[:, :, 3], axis=1) > 0)].astype(np.uint32))


def _quad(a: Numbers, b: Numbers, c: Numbers, d: Numbers) -> Numbers:
    """Triangles (2 n, 3) of quadrilaterals with corners (n,), anticlockwise."""
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def cylinder(around: int, along: int) -> Shape:
    """The cylinder of radius 1 from z = −1 to 1; `along` has no effect."""
    turn = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    vertices = np.zeros((4, around, 9), np.float32)
    vertices[..., :2], vertices[:2, :, 2], vertices[2:, :, 2] = ring, 1.0, -1.0
    vertices[0, :, 6], vertices[3, :, 6], vertices[1:3, :, 4:6] = 1.0, -1.0, ring
    k = np.arange(around)
    nxt, fan = (k + 1) % around, np.arange(1, around - 1)
    top = np.stack([np.zeros_like(fan), fan, fan + 1], axis=1)
    side = _quad(around + k, 2 * around + k, 2 * around + nxt, around + nxt)
    return Shape(vertices.reshape(-1, 9), np.concatenate([top, side, 3 * around + top[:, ::-1]]).astype(np.uint32))


def box() -> Shape:
    """The cube from −1 to 1 along every axis."""
    corners, normals = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            normal, a, b = np.zeros(3), np.zeros(3), np.zeros(3)
            normal[axis], a[(axis + 1) % 3], b[(axis + 2) % 3] = side, 1.0, side
            corners += [[normal - a - b, normal + a - b, normal + a + b], [normal - a - b, normal + a + b, normal - a + b]]
            normals += [[normal] * 3] * 2
    return _separate_triangles(np.array(corners), np.array(normals))


def plane() -> Shape:
    """The square from −1 to 1 along x and y, visible from above."""
    corners = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]], np.float32)
    return _separate_triangles(corners, np.broadcast_to(np.array([0.0, 0.0, 1.0]), corners.shape))


def _separate_triangles(corners: Array | Points, normals: Array | Points) -> Shape:
    """Shape of triangles with corners and normals (t, 3, 3) that share no vertices."""
    vertices = np.zeros((3 * len(corners), 9), np.float32)
    vertices[:, :3], vertices[:, 4:7] = corners.reshape(-1, 3), normals.reshape(-1, 3)
    return Shape(vertices, np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3))


def mesh(model: mujoco.MjModel, number: int) -> Shape:
    """A mesh of the model in the frame of its geoms. Corners that differ in normal or texture coordinates are separate vertices."""
    faces = slice(model.mesh_faceadr[number], model.mesh_faceadr[number] + model.mesh_facenum[number])
    points = model.mesh_vert[model.mesh_vertadr[number] :][: model.mesh_vertnum[number]]
    normals = model.mesh_normal[model.mesh_normaladr[number] :][: model.mesh_normalnum[number]]
    textured = model.mesh_texcoordadr[number] >= 0
    places = model.mesh_texcoord[model.mesh_texcoordadr[number] :][: model.mesh_texcoordnum[number]] if textured else np.zeros((1, 2))
    by_texture = model.mesh_facetexcoord[faces] if textured else np.zeros_like(model.mesh_face[faces])
    corners = np.stack([model.mesh_face[faces], model.mesh_facenormal[faces], by_texture], axis=-1).reshape(-1, 3)
    unique, inverse = np.unique(corners, axis=0, return_inverse=True)
    vertices = np.zeros((len(unique), 9), np.float32)
    vertices[:, :3], vertices[:, 4:7], vertices[:, 7:] = points[unique[:, 0]], normals[unique[:, 1]], places[unique[:, 2]]
    return Shape(vertices, inverse.reshape(-1, 3).astype(np.uint32))
