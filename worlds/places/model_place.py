"""The world of MJCF: its bodies, lights and cameras as they are, attached with a prefix; free space from its triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from worlds.attachment import CAMERA_AXES, attach, read_model
from worlds.engine import mujoco
from worlds.places.mesh_place import HIDDEN, level_of, world_of_level
from worlds.places.place import Place
from worlds.terrain.heightfield import Array
from worlds.textures.materials import FAIR_SKY, HIGH_SUN, add_light, add_sky
from worlds.triangles import DRAWN_GROUPS, geom_triangles
from worlds.world import PlaceCamera, World

PREFIX = "place/"
SHOWN = (0, 1, 2)
"""Groups of geoms that MuJoCo's viewer shows; the others are contacts."""
MOST_LIGHTS = 6
"""OpenGL's eight, less the headlight and one to spare."""
OPEN = 15.0
"""m: half the side of the walkable part of an infinite plane, if nothing else bounds the place."""
BEYOND = 3.0
"""m: how far the walkable part of an infinite plane extends beyond all other geoms."""


def build_model(place: Place, rng: np.random.Generator) -> World:
    """The world of MJCF. Raises ValueError if MuJoCo cannot compile it, and if people or rovers have too little free space."""
    user, _ = read_model(place.source)
    notes = _prepared(user)
    spec = mujoco.MjSpec()
    spec.modelname = place.name
    spec.visual.headlight.ambient = np.maximum(user.visual.headlight.ambient, 0.2)
    spec.visual.headlight.diffuse, spec.visual.headlight.specular = user.visual.headlight.diffuse, user.visual.headlight.specular
    lit = len(user.lights) > 0
    attach(spec, user, PREFIX)
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        add_sky(spec, *FAIR_SKY)
    if not lit:
        add_light(spec, HIGH_SUN, 1.0)
    model, data = _posed(spec, place)
    triangles = _triangles(model, data)
    level, more = level_of(place, triangles)
    cameras = _cameras(model, data)
    moving = sum(1 for geom in range(model.ngeom) if model.body_weldid[model.geom_bodyid[geom]] != 0)
    said = [f"{place.source.name}: {model.nbody - 1} bodies, {model.ngeom} geoms, {len(cameras)} cameras, which are fixed cameras", *notes, *more]
    if moving:
        said.append(f"{moving} geoms of bodies that move are obstacles where they are at the start")
    world = world_of_level(place, spec, level, rng, place.toml({}, said))
    return replace(world, cameras=cameras)


def _prepared(user: mujoco.MjSpec) -> list[str]:
    """Move geoms to the groups of our scenes and switch off surplus lights. Returns notes about the lights."""
    notes = []
    for geom in user.geoms:
        geom.group = 1 if geom.group in SHOWN else HIDDEN
    lights = [light for light in user.lights if light.active]
    for light in lights[MOST_LIGHTS:]:
        light.active = False
    if len(lights) > MOST_LIGHTS:
        notes.append(f"{len(lights) - MOST_LIGHTS} of its {len(lights)} lights are out: images have {MOST_LIGHTS}")
    return notes


def _posed(spec: mujoco.MjSpec, place: Place) -> tuple[mujoco.MjModel, mujoco.MjData]:
    try:
        model = spec.copy().compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"MuJoCo cannot use {place.source.name} in a scene: {' '.join(str(error).split())[:200]}") from None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _triangles(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Triangles (k, 3, 3) m of all drawn geoms. An infinite plane extends BEYOND the others. Raises ValueError if none is drawn."""
    drawn = [geom for geom in range(model.ngeom) if model.geom_group[geom] in DRAWN_GROUPS and model.geom_rgba[geom, 3] > 0]
    planes = [geom for geom in drawn if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE]
    found = [geom_triangles(model, data, geom) for geom in drawn if geom not in planes]
    points = np.concatenate(found).reshape(-1, 3) if found else np.zeros((0, 3))
    reach = float(np.abs(points[:, :2]).max()) + BEYOND if len(points) else OPEN
    found += [geom_triangles(model, data, geom, reach) for geom in planes]
    if not found:
        raise ValueError("has no geom that is drawn (groups 0 to 2)")
    return np.concatenate(found)


def _cameras(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[PlaceCamera, ...]:
    """The fixed cameras on static bodies."""
    out = []
    for k in range(model.ncam):
        if model.body_weldid[model.cam_bodyid[k]] == 0 and model.cam_mode[k] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
            turned = data.cam_xmat[k].reshape(3, 3) @ CAMERA_AXES
            out.append(PlaceCamera(model.camera(k).name.removeprefix(PREFIX), turned, data.cam_xpos[k].copy(), float(np.radians(model.cam_fovy[k]))))
    return tuple(out)
