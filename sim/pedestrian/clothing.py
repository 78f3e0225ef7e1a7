"""Limb meshes, random outfits and colliders of people, as bodies of a MuJoCo model.

Every limb is one geom `person_7/head` with a mesh of that name. Coarser levels of detail are the meshes `person_7/head@1` and `person_7/head@2`.
MuJoCo expresses a mesh in the frame of its inertia, which is that of its convex hull.
All levels of a limb contain the corners of one box as unused vertices, hence share that hull and that frame.
Thus a renderer changes the level of detail by the mesh index alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from sim.pedestrian import body_mesh, clothing_textures
from sim.pedestrian.body_mesh import Outfit
from sim.pedestrian.loft import LEVELS, Part, Skin
from sim.pedestrian.skeleton import LIMBS, RADIUS, head_size, trunk_size
from tracker.geometry import Array
from worlds.engine import mujoco

LEGS = {"long": 0.44, "short": 0.08, "skirt": 0.10, "long_skirt": 0.10, "coat": 0.12, "long_coat": 0.16}
HAIR = {"short": 0.34, "long": 0.10, "loose": 0.16, "bun": 0.08, "cap": 0.08, "beanie": 0.08, "hood": 0.16}
"""Shares of people with each kind of legs and of hair in varied clothing."""
_GIRTH = (0.92, 1.12)


def add_person(spec: mujoco.MjSpec, name: str, stature: float, rng: np.random.Generator, variety: np.random.Generator | None = None) -> None:
    """Add the limbs (mocap bodies `name/limb`) to the world body of `spec`, which must have the clothing textures already.

    variety: a second stream, which draws the clothes of `varied_outfit`; None for those of `draw_outfit`.
    """
    outfit = draw_outfit(rng)
    shapes = body_mesh.parts(outfit if variety is None else varied_outfit(outfit, variety))
    size = {limb: float(trunk_size(np.array(stature))) for limb in LIMBS} | {"head": float(head_size(np.array(stature)))}
    for limb in LIMBS:
        _add_meshes(spec, f"{name}/{limb}", shapes[limb], size[limb])
        mocap = spec.worldbody.add_body(name=f"{name}/{limb}", mocap=True)
        attributes = {"material": clothing_textures.NAME, "contype": 0, "conaffinity": 0, "group": 2}
        mocap.add_geom(name=f"{name}/{limb}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{name}/{limb}", **attributes)


def add_collider(spec: mujoco.MjSpec, name: str, stature: float) -> None:
    """Add the upright capsule that robots collide with: mocap body `name/collider`, with its origin on the ground."""
    collider = spec.worldbody.add_body(name=f"{name}/collider", mocap=True)
    half = stature / 2 - RADIUS
    collider.add_geom(
        name=f"{name}/collider", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(RADIUS, half, 0), pos=(0, 0, stature / 2), group=4, rgba=(0, 0, 0, 0),
        contype=2, conaffinity=0, solref=(0.06, 1.0),
    )  # fmt: skip


def compile_posed(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a scene with people that is posed and drawn, but never stepped: without contacts.

    The memory of the contact search grows with the square of the number of limbs. From about 220 people on it exceeds MuJoCo's reserve.
    """
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return model


def varied_outfit(outfit: Outfit, rng: np.random.Generator) -> Outfit:
    """The outfit with the legs, hair and sleeves of LEGS and HAIR: long coats, long skirts, hoods and loose hair as well."""
    legs, hair = _one(rng, LEGS), _one(rng, HAIR)
    covered = legs in ("coat", "long_coat") or hair == "hood"
    if outfit.head % clothing_textures.BALD == 0 and hair in ("short", "long", "loose", "bun"):
        hair = "none"
    return replace(outfit, legs=legs, hair=hair, sleeves="long" if covered else outfit.sleeves, tucked=outfit.tucked and not covered)


def _one(rng: np.random.Generator, options: dict[str, float]) -> str:
    return str(rng.choice(list(options), p=list(options.values())))


def draw_outfit(rng: np.random.Generator) -> Outfit:
    """Random clothes, hair and luggage."""
    one = partial(_one, rng)
    head = int(rng.choice(clothing_textures.HEADS))
    hair = one({"short": 0.44, "long": 0.26, "bun": 0.10, "cap": 0.12, "beanie": 0.08})
    if head % clothing_textures.BALD == 0 and hair in ("short", "long", "bun"):
        hair = "none"
    return Outfit(
        head=head,
        top=int(rng.choice(clothing_textures.TOPS)),
        bottom=int(rng.choice(clothing_textures.BOTTOMS)),
        shoes=int(rng.choice(clothing_textures.SHOES)),
        bag=int(rng.choice(clothing_textures.BAGS[1:])),
        girth=float(rng.uniform(*_GIRTH)),
        sleeves=one({"long": 0.6, "short": 0.4}),
        legs=one({"long": 0.58, "short": 0.14, "skirt": 0.12, "coat": 0.16}),
        tucked=bool(rng.random() < 0.3),
        hair=hair,
        luggage=one({"none": 0.55, "backpack": 0.27, "shoulder": 0.18}),
        side=1 if rng.random() < 0.5 else -1,
    )


def limb_meshes(parts: list[Part], size: float) -> list[Skin]:
    """Meshes of a limb at all levels of detail, m. size: stature of its person, m."""
    out = []
    for level in range(LEVELS):
        skin = Skin.joined([s for part in parts if (s := part.skin(level)) is not None])
        out.append(Skin(skin.vertices * size, skin.normals, skin.texcoord, skin.faces))
    return out


def _add_meshes(spec: mujoco.MjSpec, name: str, parts: list[Part], size: float) -> None:
    levels = limb_meshes(parts, size)
    corners = _inertia_box(np.concatenate([skin.vertices for skin in levels]))
    for level, skin in enumerate(levels):
        mesh = spec.add_mesh(
            name=f"{name}@{level}" if level else name,
            uservert=np.concatenate([skin.vertices, corners]).ravel(),
            usernormal=np.concatenate([skin.normals, np.tile([0.0, 0.0, 1.0], (8, 1))]).ravel(),
            usertexcoord=np.concatenate([skin.texcoord, np.zeros((8, 2))]).ravel(),
            userface=skin.faces.ravel(),
        )
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX


def _inertia_box(points: Array) -> Array:
    """Corners (8, 3) of a box about points (n, 3). Its edges differ by 5 % at least, so that its axes of inertia are unique."""
    low, high = points.min(axis=0) - 1e-3, points.max(axis=0) + 1e-3
    order = np.argsort(high - low)
    for before, after in pairwise(order):
        high[after] = max(high[after], low[after] + 1.05 * (high[before] - low[before]))
    return np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(8, 3)
