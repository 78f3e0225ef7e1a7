"""A MuJoCo scene as textured triangles, for programs that cannot read MuJoCo's models."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.color import ColorVisuals
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from worlds.engine import mujoco
from worlds.terrain.heightfield import Array

DRAWN_GROUPS = (0, 1, 2, 3)
DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
"""Colour of a geom that is given none."""


def scenery(spec: mujoco.MjSpec) -> trimesh.Scene:
    """The drawn geoms of a spec, each a node of the same name, in world coordinates: metres, z up. ValueError for a geom without triangles."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    materials: dict[int, Any] = {}
    scene = trimesh.Scene()
    for geom in range(model.ngeom):
        if model.geom_group[geom] not in DRAWN_GROUPS or model.geom_rgba[geom, 3] == 0:
            continue
        mesh = _mesh(model, geom)
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        mesh.apply_transform(turn)
        uv = mesh.metadata.pop("uv", None)
        number = int(model.geom_matid[geom])
        if number >= 0 and uv is not None:
            if number not in materials:
                materials[number] = _material(model, number, spec.modelname)
            mesh.visual = TextureVisuals(uv=uv, material=materials[number])
        else:
            # As in MuJoCo, the colour of a material holds where the geom's is the default one.
            own = number < 0 or (model.geom_rgba[geom] != DEFAULT_RGBA).any()
            colour = model.geom_rgba[geom] if own else model.mat_rgba[number]
            mesh.visual = ColorVisuals(mesh, face_colors=np.round(255 * colour).astype(np.uint8))
        name = model.geom(geom).name or f"geom{geom}"
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    return scene


def geom_triangles(model: mujoco.MjModel, data: mujoco.MjData, geom: int, reach: float | None = None) -> Array:
    """Triangles (k, 3, 3) m of a geom in world coordinates. An infinite plane reaches `reach` m, or the scene's extent for None.

    Raises ValueError for a geom without triangles.
    """
    mesh = _mesh(model, geom, reach)
    corners: Array = np.asarray(mesh.vertices, dtype=np.float64)[np.asarray(mesh.faces)]
    return corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def _mesh(model: mujoco.MjModel, geom: int, reach: float | None = None) -> trimesh.Trimesh:
    """A geom in its own frame; its texture coordinates, if any, as metadata "uv", v upwards in the picture.

    Raises ValueError for a geom without triangles.
    """
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    number = int(model.geom_dataid[geom])
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _field(model, number)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return compiled_mesh(model, number)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        x, y = (float(side) if side > 0 else float(reach or model.stat.extent) for side in size[:2])
        return trimesh.Trimesh([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [(0, 1, 2), (0, 2, 3)], process=False)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(extents=2 * size)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        ball = trimesh.creation.icosphere(subdivisions=2)
        ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.repeat(size[0], 3))
        return ball
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=size[0], height=2 * size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(radius=size[0], height=2 * size[1])
    raise ValueError(f"geom {model.geom(geom).name!r} is a {kind.name}, which has no triangles to export")


def compiled_mesh(model: mujoco.MjModel, number: int) -> trimesh.Trimesh:
    """A mesh with a vertex of its own for every corner that has its own texture coordinates."""
    first, count = model.mesh_faceadr[number], model.mesh_facenum[number]
    faces = model.mesh_face[first : first + count]
    vertices = model.mesh_vert[model.mesh_vertadr[number] : model.mesh_vertadr[number] + model.mesh_vertnum[number]]
    start = model.mesh_texcoordadr[number]
    if start < 0:
        return trimesh.Trimesh(vertices, faces, process=False)
    corners = model.mesh_facetexcoord[first : first + count]
    pairs, inverse = np.unique(np.column_stack([faces.ravel(), corners.ravel()]), axis=0, return_inverse=True)
    uv = model.mesh_texcoord[start + pairs[:, 1]] * [1, -1] + [0, 1]
    return trimesh.Trimesh(vertices[pairs[:, 0]], inverse.reshape(-1, 3), process=False, metadata={"uv": uv})


def compiled_picture(model: mujoco.MjModel, number: int) -> NDArray[np.uint8]:
    """The pixels (height, width, channels) of a texture; the six sides of a cube one below the other."""
    shape = model.tex_height[number], model.tex_width[number], model.tex_nchannel[number]
    return np.asarray(model.tex_data[model.tex_adr[number] :][: int(np.prod(shape))].reshape(shape))


def _field(model: mujoco.MjModel, number: int) -> trimesh.Trimesh:
    """The surface of a height field, its cells split as MuJoCo splits them; the texture lies once over all of it, north up."""
    rows, columns, start = model.hfield_nrow[number], model.hfield_ncol[number], model.hfield_adr[number]
    half_x, half_y, height, _ = model.hfield_size[number]
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    z = height * model.hfield_data[start : start + rows * columns]
    vertices: Array = np.column_stack([x.ravel(), y.ravel(), z])
    node: NDArray[np.int64] = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = node[:-1, :-1].ravel(), node[:-1, 1:].ravel(), node[1:, 1:].ravel(), node[1:, :-1].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    uv = np.column_stack([x.ravel() / (2 * half_x) + 0.5, y.ravel() / (2 * half_y) + 0.5])
    return trimesh.Trimesh(vertices, faces, process=False, metadata={"uv": uv})


def _material(model: mujoco.MjModel, number: int, owner: str) -> Any:
    """The material. Its name begins with that of the model, since files of several worlds may share a folder."""
    texture = int(model.mat_texid[number, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    colour = np.round(255 * model.mat_rgba[number]).astype(np.uint8)
    image = None
    if texture >= 0:
        image = Image.fromarray(compiled_picture(model, texture))
    name = f"{owner}-{model.mat(number).name}"
    return PBRMaterial(name=name, baseColorFactor=colour, baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0)
