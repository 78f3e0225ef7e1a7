"""The surface that feet and wheels stand on: the height field and meshes over it. Decks are walked on, roofs are walked under."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from worlds.engine import mujoco
from worlds.terrain.heightfield import Array, Heightfield

Index = NDArray[np.int64]

CELL = 0.5
"""m: side of the squares by which triangles are looked up."""
# Least z of the unit normal of a face that looks up; m by which a foot may be below the surface on which it stands.
_UPWARDS, _TOUCHING = 1e-6, 1e-6


@dataclass(frozen=True, eq=False)
class Decks:
    """Upward faces of meshes, in world coordinates.

    decks (k, 3, 3) m: walked on. roofs (m, 3, 3) m: walked under, though something may lie on them. Raises ValueError for other shapes.
    """

    decks: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    roofs: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))

    def __post_init__(self) -> None:
        for name in ("decks", "roofs"):
            faces = np.array(getattr(self, name), dtype=np.float64)
            if faces.ndim != 3 or faces.shape[1:] != (3, 3) or not np.isfinite(faces).all():
                raise ValueError(f"{name} have shape {faces.shape}, need (k, 3, 3) finite")
            faces.flags.writeable = False
            object.__setattr__(self, name, faces)

    @staticmethod
    def of(spec: mujoco.MjSpec, decks: Sequence[str], roofs: Sequence[str] = ()) -> Decks:
        """The upward faces of mesh geoms of these names in the world body of a spec.

        They are read from a compiled model, so that they are exactly MuJoCo's. MuJoCo moves a mesh to its frame of inertia and stores float32.
        Raises ValueError for a name that is not that of a mesh geom.
        """
        small = mujoco.MjSpec()
        for name in (*decks, *roofs):
            geom = spec.geom(name)
            if geom is None or geom.type != mujoco.mjtGeom.mjGEOM_MESH:
                raise ValueError(f"deck is {name!r}, needs the name of a mesh geom")
            mesh = spec.mesh(geom.meshname)
            copied = small.add_mesh(name=name, uservert=mesh.uservert, userface=mesh.userface, inertia=mesh.inertia)
            assert copied is not None
            small.worldbody.add_geom(name=name, type=geom.type, meshname=name, pos=geom.pos, quat=geom.quat)
        if not (decks or roofs):
            return Decks()
        model = small.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return Decks(*(_upward(model, data, names) for names in (decks, roofs)))


def _upward(model: mujoco.MjModel, data: mujoco.MjData, names: Sequence[str]) -> Array:
    """(k, 3, 3) m: the faces of these geoms that look up."""
    found = [np.zeros((0, 3, 3))]
    for name in names:
        geom = model.geom(name).id
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        at, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        local = model.mesh_vert[first : first + count].astype(np.float64)
        vertices = data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T
        found.append(vertices[model.mesh_face[at : at + faces]])
    triangles = np.concatenate(found)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return triangles[normal[:, 2] > _UPWARDS * np.maximum(np.linalg.norm(normal, axis=1), 1e-12)]


@dataclass(frozen=True, eq=False)
class Terrain:
    """The ground with its decks and roofs. height_at and normal_at agree with MuJoCo's rays to 1e-6 m."""

    ground: Heightfield
    decks: Decks = field(default_factory=Decks)

    def __post_init__(self) -> None:
        faces = np.concatenate([self.decks.decks, self.decks.roofs])
        edges = faces[:, 1:] - faces[:, :1]
        normal = np.cross(edges[:, 0], edges[:, 1])
        tables = {
            "_faces": np.concatenate([faces[:, 0], edges.reshape(-1, 6)], axis=1),
            "_normals": normal / np.linalg.norm(normal, axis=1, keepdims=True),
        }
        for name, table in tables.items():
            object.__setattr__(self, name, table)
        object.__setattr__(self, "_cells", _cells(faces, self.ground))

    @property
    def on_grid(self) -> Heightfield:
        """The walkable surface at the grid points of the ground, from which maps, slopes and free space are computed."""
        return self.ground.with_heights(self.height_at(self.ground.nodes.reshape(-1, 2)).reshape(self.ground.heights.shape))

    def height_at(self, points: ArrayLike) -> Array:
        """(n, 2) x, y m → (n,) m of the walkable surface: the highest of ground and decks; roofs are ignored.

        (n, 3) m → (n,) m of the highest surface, roofs included, at most 1e-6 m above z; the ground's height if there is none.
        Outside of the ground, heights are those at the nearest points of its edge.
        """
        return self._stood(points)[0]

    def normal_at(self, points: ArrayLike) -> Array:
        """(n, 2) or (n, 3) m → (n, 3) unit normals, upwards, of the surface that height_at gives."""
        _, face = self._stood(points)
        normal = self.ground.normal_at(points)
        normal[face >= 0] = self._normals[face[face >= 0]]
        return normal

    def _stood(self, points: ArrayLike) -> tuple[Array, Index]:
        """Height (n,) m, and face (n,) or −1 for the ground."""
        p = np.asarray(points, dtype=np.float64)
        height, face = self.ground.height_at(p), np.full(len(p), -1)
        if len(self._faces):
            walked = len(self.decks.decks) if p.shape[1] == 2 else len(self._faces)
            ceiling = np.full(len(p), np.inf) if p.shape[1] == 2 else p[:, 2] + _TOUCHING
            inside = np.clip(p[:, :2], *self.ground.extent)
            start, faces = self._cells
            shape = _shape(self.ground)
            _highest(inside - self.ground.origin, self.ground.origin, ceiling, (start, faces, shape[1]), (self._faces, walked), (height, face))
        return height, face

    # Declared for the type checker: set once in __post_init__.
    _faces: Array = field(init=False, repr=False)
    _normals: Array = field(init=False, repr=False)
    _cells: tuple[Index, Index] = field(init=False, repr=False)


def _shape(ground: Heightfield) -> tuple[int, int]:
    """Rows and columns of cells."""
    low, high = ground.extent
    columns, rows = (np.floor((high - low) / CELL).astype(int) + 1).tolist()
    return rows, columns


def _cells(faces: Array, ground: Heightfield) -> tuple[Index, Index]:
    """Start indices (rows · columns + 1,) of each cell's faces, and the faces, cell after cell: all whose bounds touch the cell."""
    rows, columns = _shape(ground)
    low = np.floor((faces[:, :, :2].min(axis=1) - 1e-6 - ground.origin) / CELL).astype(np.int64)
    high = np.floor((faces[:, :, :2].max(axis=1) + 1e-6 - ground.origin) / CELL).astype(np.int64)
    low, high = np.clip(low, 0, [columns - 1, rows - 1]), np.clip(high, 0, [columns - 1, rows - 1])
    cells: list[int] = []
    owner: list[int] = []
    for k, ((x0, y0), (x1, y1)) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        for i in range(y0, y1 + 1):
            cells += range(i * columns + x0, i * columns + x1 + 1)
            owner += [k] * (x1 + 1 - x0)
    order = np.argsort(np.array(cells, dtype=np.int64), kind="stable")
    counts = np.bincount(np.array(cells, dtype=np.int64), minlength=rows * columns)
    return np.concatenate([[0], np.cumsum(counts)]), np.array(owner, dtype=np.int64)[order]


@njit(cache=True)
def _highest(
    offset: Array, origin: Array, ceiling: Array, cells: tuple[Index, Index, int], faces: tuple[Array, int], found: tuple[Array, Index]
) -> None:
    """Raise height and face of each point to the highest of the faces before `walked` that is below its ceiling."""
    start, owner, columns = cells
    table, walked = faces
    height, face = found
    for n in range(len(offset)):
        cell = int(offset[n, 1] / CELL) * columns + int(offset[n, 0] / CELL)
        for k in range(start[cell], start[cell + 1]):
            t = owner[k]
            if t >= walked:
                continue
            ax, ay, az, ux, uy, uz, vx, vy, vz = table[t]
            x, y = origin[0] + offset[n, 0] - ax, origin[1] + offset[n, 1] - ay
            area = ux * vy - uy * vx
            a, b = (x * vy - y * vx) / area, (ux * y - uy * x) / area
            if a < 0 or b < 0 or a + b > 1:
                continue
            z = az + a * uz + b * vz
            # Where the ground itself is above the ceiling, any face below the ceiling replaces it.
            if z <= ceiling[n] and (z > height[n] or height[n] > ceiling[n]):
                height[n], face[n] = z, t
