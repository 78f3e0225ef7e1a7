"""Pictures as materials, light and sky: all that only changes pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worlds.engine import mujoco
from worlds.textures.canvas import Canvas, Image


def add_material(spec: mujoco.MjSpec, name: str, canvas: Canvas, shine: float = 0.1) -> None:
    """A matt material of that name with the picture as its texture."""
    add_picture(spec, name, canvas.image(), shine)


def add_picture(spec: mujoco.MjSpec, name: str, image: Image, shine: float = 0.1) -> None:
    """As `add_material`, with an image (rows, columns, 3) uint8, row 0 on top."""
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.height, texture.width, texture.nchannel = image.shape
    texture.data = image.tobytes()
    material = spec.add_material(name=name, specular=shine, shininess=0.3)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


FAIR_SKY = (0.36, 0.56, 0.84), (0.84, 0.89, 0.94)
"""Colours of a fair sky at the zenith and at the horizon."""
HIGH_SUN = (0.5, 0.35, -1.0)
"""Direction of the light of a high sun."""


def add_sky(spec: mujoco.MjSpec, zenith: ArrayLike, horizon: ArrayLike) -> None:
    """A sky without features, from one colour (3,) in [0, 1] to another: what is infinitely far away must not look like a landmark."""
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=np.asarray(horizon),
        rgb2=np.asarray(zenith),
        width=128,
        height=768,
    )


def add_light(spec: mujoco.MjSpec, direction: ArrayLike, brightness: float) -> None:
    """One sun with shadows along `direction` (3,), a weaker one against it without, and light from everywhere, scaled by brightness.

    Light from everywhere is the headlight's: a light with shadows loses its own where it is shadowed. The headlight gives nothing else:
    what a camera sees must not depend on where it stands.
    """
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = np.full(3, 0.46 * brightness), np.zeros(3), np.zeros(3)
    towards = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    for name, way, diffuse in (("sun", towards, 0.50), ("fill", towards * (-1, -1, 0.35), 0.24)):
        light = spec.worldbody.add_light(name=name, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=name == "sun")
        light.pos, light.dir = -12.0 * way, way
        light.diffuse, light.ambient, light.specular = np.full(3, brightness * diffuse), np.zeros(3), np.full(3, 0.1)


def set_view(spec: mujoco.MjSpec, extent: ArrayLike, near: float = 0.03) -> None:
    """How the scene is drawn: [[xmin, ymin], [xmax, ymax]] m of it, nothing nearer than `near` m cut off, shadows over all of it.

    Shadow map and slices are small and there is no multisampling: on a processor they cost more than they show (panoramas smooth by themselves).
    """
    low, high = np.asarray(extent, dtype=np.float64)
    radius = float(np.hypot(*(high - low))) / 2
    spec.stat.extent = radius
    spec.stat.center = np.array([*(low + high) / 2, 1.0])
    view = spec.visual
    view.map.znear, view.map.zfar, view.map.shadowclip = near / radius, 6.0, 1.0
    view.global_.offwidth = view.global_.offheight = 4096
    view.quality.shadowsize, view.quality.offsamples = 1024, 0
    view.quality.numslices, view.quality.numstacks = 16, 10
