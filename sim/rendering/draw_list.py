"""Draw list: records of all geoms of a model, view-frustum culling and levels of detail for each face.

A record is one geom, or one tile of a height field. Only its transform changes from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.rendering.geometry import DRAWN, G, ShapeBuffers
from tracker.geometry import Array, Pose
from worlds.engine import mujoco
from worlds.semantics import CLASSES, class_of, kind_of

Indices = NDArray[np.int64]

GROUPS = (0, 1, 2, 3)
"""Geom groups that are drawn: ground, props, people, robots; 4 holds invisible collision shapes."""
ABSENT = 5
"""Group of geoms that are hidden for now. A geom may change between this group and GROUPS from frame to frame."""
TRIANGLES_PER_PIXEL = 5.0
"""Triangles of a round shape per pixel of its radius. A sphere of n triangles deviates by 3.6 r / n, hence by 0.7 pixel at most."""
CULLING_MARGIN = 1e-3
"""m: tolerance of culling, for rounding errors."""
OPAQUE = 0.995
PLAIN, TEXTURED, CUBE_MAPPED, FACETS, TEXTURED_FACETS = range(5)
"""Kinds of surface: untextured, 2-D texture, cube texture; untextured and 2-D texture with flat shading."""

RECORD = np.dtype(
    [("rows", "f4", (3, 4)), ("scale", "f4", 4), ("rgba", "f4", 4), ("shine", "f4", 4), ("mapping", "f4", 4), ("code", "u4"), ("slot", "u4")]
)
"""Per-instance data. rows: transform from shape to world. scale: x, y, z, and half the length of a capsule's cylinder.
shine: emission, specular, shininess, 0. code: geom + 1. slot: bit of its body.
mapping: texture coordinates per unit along x, y, z, and 1 where they are computed from the position."""
COMMAND = np.dtype([("count", "u4"), ("instances", "u4"), ("first", "u4"), ("base", "i4"), ("record", "u4")])
"""OpenGL's DrawElementsIndirectCommand."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Commands `first` to `last` (exclusive) of a list. They share kind, texture (−1 for none) and alpha blending."""

    kind: int
    texture: int
    blended: bool
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class DrawCommands:
    """Commands of one face, near shapes first, and their batches."""

    commands: NDArray[np.void]
    batches: tuple[Batch, ...]


class DrawList:
    """The records of a model. `update` reads the transforms; `visible_from` culls and orders for a camera.

    Raises ValueError for a model with flexes or skins.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        if model.nflex or model.nskin:
            raise ValueError(f"the model has {model.nflex} flexes and {model.nskin} skins, which are not drawn: needs 0")
        self.buffers = ShapeBuffers.of(model)
        drawn = np.isin(model.geom_group, (*GROUPS, ABSENT)) & np.isin(model.geom_type, [int(kind) for kind in DRAWN])
        colour = _colours(model)
        drawn &= colour[:, 3] > 0
        shapes = [_shapes(model, self.buffers, k) if drawn[k] else [] for k in range(model.ngeom)]
        self._groups = model.geom_group
        self.geom = np.repeat(np.arange(model.ngeom), [len(of) for of in shapes])
        self._shape = np.array([shape for of in shapes for shape in of], dtype=np.int64)
        self.records = np.zeros(len(self.geom), RECORD)
        self.records["rgba"] = colour[self.geom]
        self.records["code"] = self.geom + 1
        self.kind, self.texture = _materials(model, self.geom, self.records)
        self.blended = colour[self.geom, 3] < OPAQUE
        self.casts_shadow = model.geom_castshadow[self.geom].astype(bool) & ~self.blended
        self._levels = self.buffers.levels[self._shape]
        self._triangles = self.buffers.count[self._levels] // 3
        self._boxes = np.where(np.isnan(self.buffers.boxes[self._shape]), model.geom_aabb[self.geom], self.buffers.boxes[self._shape])
        flat = model.geom_type[self.geom] == G.mjGEOM_PLANE
        # MuJoCo's bounding box of a plane is the half space below it; size 0 means an infinite plane.
        edges = np.where(model.geom_size[self.geom, :2] > 0, model.geom_size[self.geom, :2], 2 * model.vis.map.zfar * model.stat.extent)
        self._boxes[flat] = np.concatenate([np.zeros((flat.sum(), 3)), edges[flat], np.zeros((flat.sum(), 1))], axis=1)
        self.infinite = flat & (model.geom_size[self.geom, :2] <= 0).any(axis=1)
        self.records["scale"] = _scales(model, self.geom)
        self.records["scale"][flat, :2] = edges[flat]

    def update(self, data: mujoco.MjData) -> None:
        """Read the transforms of all geoms, and which records are in a drawn group: `present` (m,)."""
        self.present = np.isin(self._groups[self.geom], GROUPS)
        rotation, self._place = data.geom_xmat[self.geom].reshape(-1, 3, 3), data.geom_xpos[self.geom]
        self.records["rows"][:, :, :3], self.records["rows"][:, :, 3] = rotation, self._place
        # The oriented box about every record: centre (m, 3), half edges as columns (m, 3, 3), m, world.
        self.centres = self._place + np.einsum("nij,nj->ni", rotation, self._boxes[:, :3])
        self.halves = rotation * self._boxes[:, None, 3:]
        self.radius = np.linalg.norm(self._boxes[:, 3:], axis=1)

    def visible_from(self, pose: Pose, planes: Array, resolution: float, among: Indices | None = None) -> list[DrawCommands]:
        """Draw commands of n faces of a camera at `pose` (T_world_camera), near shapes first.

        planes (n, 5, 3): inward normals of the faces. resolution: pixels per radian. among: candidate records, all where None.
        """
        records = np.flatnonzero(self.present) if among is None else among[self.present[among]]
        normals = planes.reshape(-1, 3) @ pose.rotation.T
        away = self.centres[records] - pose.translation
        spans = np.abs(self.halves[records].transpose(0, 2, 1).reshape(-1, 3) @ normals.T).reshape(len(records), 3, len(normals))
        reach = away @ normals.T + spans.sum(axis=1)
        seen = (reach.reshape(len(records), len(planes), 5) > -CULLING_MARGIN).all(axis=2)
        distance = np.maximum(np.linalg.norm(away, axis=1) - self.radius[records], 1e-3)
        commands = self.commands(records, resolution * self.radius[records] / distance)
        draw_order = _draw_order(self.kind[records], self.texture[records], self.blended[records], distance)
        return [self._draw_commands(commands[chosen], records[chosen]) for chosen in (draw_order[face[draw_order]] for face in seen.T)]

    def commands(self, records: Indices, pixels: Array) -> NDArray[np.void]:
        """Commands of records with radius `pixels` (m,) px, each at the coarsest level of detail that is accurate enough."""
        needed = TRIANGLES_PER_PIXEL * np.minimum(pixels, 1e6)
        enough = (self._triangles[records] >= needed[:, None]).sum(axis=1)
        shape = self._levels[records, np.maximum(enough - 1, 0)]
        commands = np.zeros(len(records), COMMAND)
        commands["count"], commands["first"], commands["base"] = self.buffers.count[shape], self.buffers.first[shape], self.buffers.base[shape]
        commands["instances"], commands["record"] = 1, records
        return commands

    def _draw_commands(self, commands: NDArray[np.void], records: Indices) -> DrawCommands:
        key = np.stack([self.kind[records], self.texture[records], self.blended[records]], axis=1)
        cuts = np.flatnonzero((key[1:] != key[:-1]).any(axis=1)) + 1
        bounds = [0, *cuts, len(records)] if len(records) else [0]
        batches = [Batch(int(key[a, 0]), int(key[a, 1]), bool(key[a, 2]), int(a), int(b)) for a, b in pairwise(bounds)]
        return DrawCommands(commands, tuple(batches))


def _draw_order(kind: Indices, texture: Indices, blended: NDArray[np.bool_], distance: Array) -> Indices:
    """Draw order: opaque records grouped by surface, near to far, then blended records from far to near."""
    group = (texture + 1) * 5 + kind
    nearest = np.full(group.max(initial=0) + 1, np.inf)
    np.minimum.at(nearest, group[~blended], distance[~blended])
    draw_order = np.lexsort((distance, group, nearest[group], blended))
    last = np.flatnonzero(blended)
    # Alpha blending is only right from far to near.
    return np.concatenate([draw_order[: len(draw_order) - len(last)], last[np.argsort(-distance[last], kind="stable")]])


def _colours(model: mujoco.MjModel) -> NDArray[np.float32]:
    """(ngeom, 4) rgba: the geom's own colour, or that of its material if the geom has the default."""
    material = model.geom_matid
    default = (model.geom_rgba == np.array([0.5, 0.5, 0.5, 1.0], np.float32)).all(axis=1)
    inherited = (material >= 0) & default
    colours = model.geom_rgba.copy()
    colours[inherited] = model.mat_rgba[material[inherited]]
    return colours


def _shapes(model: mujoco.MjModel, shapes: ShapeBuffers, geom: int) -> list[int]:
    kind, number = int(model.geom_type[geom]), int(model.geom_dataid[geom])
    if kind == G.mjGEOM_HFIELD:
        return shapes.hfield[number]
    return [int(shapes.mesh[number])] if kind == G.mjGEOM_MESH else [shapes.plain[kind]]


def _scales(model: mujoco.MjModel, geom: Indices) -> Array:
    """(m, 4): half sizes along x, y, z, and half the length of a capsule's cylinder."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    scale = np.ones((len(geom), 4))
    scale[:, 3] = 0
    for drawn, columns in ((G.mjGEOM_SPHERE, (0, 0, 0)), (G.mjGEOM_CAPSULE, (0, 0, 0)), (G.mjGEOM_CYLINDER, (0, 0, 1)),
                           (G.mjGEOM_ELLIPSOID, (0, 1, 2)), (G.mjGEOM_BOX, (0, 1, 2))):  # fmt: skip
        scale[kind == drawn, :3] = size[kind == drawn][:, columns]
    scale[kind == G.mjGEOM_CAPSULE, 3] = size[kind == G.mjGEOM_CAPSULE, 1]
    return scale


def _materials(model: mujoco.MjModel, geom: Indices, records: NDArray[np.void]) -> tuple[Indices, Indices]:
    """Kind and texture (m,) of every record. Fills in shine and mapping by MuJoCo's rules."""
    material, kind = model.geom_matid[geom], model.geom_type[geom]
    has = material >= 0
    records["shine"] = np.array([0.0, 0.5, 64.0, 0.0])
    records["shine"][has, 0] = model.mat_emission[material[has]]
    records["shine"][has, 1] = model.mat_specular[material[has]]
    records["shine"][has, 2] = 128 * model.mat_shininess[material[has]]
    texture = np.where(has, model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] if model.nmat else -1, -1)
    cubic = (texture >= 0) & (model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D if model.ntex else False)
    repeat = np.where(has[:, None], model.mat_texrepeat[material] if model.nmat else 1, 1)
    uniform = (has & (model.mat_texuniform[material].astype(bool) if model.nmat else False))[:, None]
    field, size = kind == G.mjGEOM_HFIELD, model.geom_size[geom].copy()
    size[field] = model.hfield_size[model.geom_dataid[geom[field]], :3]
    size[size <= 0] = 1
    # Texture coordinates of scaled unit shapes are computed before scaling; meshes and height fields are in metres.
    metric = np.isin(kind, [int(G.mjGEOM_MESH), int(G.mjGEOM_HFIELD)])[:, None]
    flat = repeat / np.where(metric, size[:, :2], 1) * np.where(uniform, size[:, :2], 1)
    records["mapping"][:, :2] = flat * [0.5, -0.5]
    own = kind == G.mjGEOM_MESH
    own[own] = model.mesh_texcoordadr[model.geom_dataid[geom[own]]] >= 0
    records["mapping"][:, 3] = ~own
    records["mapping"][cubic, :3] = np.where(uniform, size, 1)[cubic]
    surface = np.where(texture < 0, PLAIN, np.where(cubic & ~own, CUBE_MAPPED, TEXTURED))
    faceted = field & (surface != CUBE_MAPPED)
    surface[faceted] = np.where(texture[faceted] < 0, FACETS, TEXTURED_FACETS)
    return surface, texture


def classes(model: mujoco.MjModel) -> NDArray[np.uint8]:
    """Class (ngeom,) of every geom, from its name or its body's name; 0 for geoms that are not drawn.

    A geom of a user's MJCF has a name with a prefix, or no name. Words in the names of its body, material and geom determine its class.
    Raises ValueError for a drawn geom of another name that worlds.semantics does not know.
    """
    out = np.zeros(model.ngeom, np.uint8)
    for k in np.flatnonzero(np.isin(model.geom_group, (*GROUPS, ABSENT)) & (model.geom_rgba[:, 3] > 0)):
        name, body = model.geom(int(k)).name, model.body(int(model.geom_bodyid[k])).name
        if body.startswith("person_"):
            out[k] = CLASSES.index("person")
        elif body.startswith("robot_"):
            out[k] = CLASSES.index("robot")
        else:
            material = model.mat(int(model.geom_matid[k])).name if model.geom_matid[k] >= 0 else ""
            out[k] = class_of(name if "/" not in name and name else kind_of(f"{body} {material} {name}") or "beam")
    return out
