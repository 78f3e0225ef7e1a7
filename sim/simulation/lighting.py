"""Kinds of light with their skies, and wet ground: changes of a compiled model that affect only pixels.

A shader adds ambient, diffuse and specular light without reflections of objects. Wet ground is darker and reflects only the sun.
"""

from __future__ import annotations

import numpy as np

from sim.scenario import BUILT_LIGHT, Scenario
from tracker.geometry import Array
from worlds.engine import mujoco

WET_DARKNESS = 0.45
"""Share of the diffuse light that wet ground absorbs: albedo falls to about a half (Lekner & Dorf 1988, Applied Optics 27(7))."""
WET_SPECULAR, WET_SHININESS = 0.7, 0.3
"""Specular and shininess of wet ground in MuJoCo's units; the film of water is rough at the scale of the texture."""
SKIES = {
    "overcast": (0.85, (0.86, 0.88, 0.90)),
    "low": (0.15, (1.0, 0.91, 0.80)),
    "dim": (0.3, (0.42, 0.43, 0.48)),
    "lamps": (0.9, (0.30, 0.29, 0.27)),
}
"""Kind of light → share by which the sky turns grey, and the factors of its red, green and blue."""
LAMP_HEIGHT, LAMP_GRID = 3.6, 2
"""m above the floor, and lamps along each side of the scene."""
LAMP_COLOURS = ((1.0, 0.78, 0.52), (1.0, 0.92, 0.80), (0.88, 0.95, 1.0))
"""Lamps of about 2700, 4000 and 6500 K, as RGB of linear light."""


def apply(model: mujoco.MjModel, scenario: Scenario) -> None:
    """Give a model the light of a scenario and its wet ground, in place. Nothing changes by default."""
    if scenario.light != BUILT_LIGHT:
        set_light(model, scenario.light, scenario.stream("light"))
        set_sky(model, scenario.light)
    if scenario.wet:
        wet_ground(model, scenario.wet)


def set_light(model: mujoco.MjModel, kind: str, rng: np.random.Generator) -> None:
    """Change the lights of a model to a kind of LIGHTS. Only parallel lights change direction.

    built: unchanged. overcast: soft and without shadows. low: a low warm sun, 8 to 30° high. dim: half of all light.
    """
    elevation, azimuth = rng.uniform(np.radians(8), np.radians(30)), rng.uniform(-np.pi, np.pi)
    warm, strength = np.array([1.0, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)]), rng.uniform(0.7, 1.2)
    parallel = model.light_type == int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    headlight = model.vis.headlight
    if kind == "overcast":
        model.light_diffuse[parallel] *= 0.35
        model.light_ambient[parallel] += 0.3 * strength
        model.light_castshadow[parallel] = 0
    elif kind == "low":
        direction = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)]
        model.light_dir[parallel] = direction
        model.light_diffuse[parallel] *= warm * strength
    elif kind == "dim":
        for values in (model.light_diffuse, model.light_ambient, headlight.diffuse, headlight.ambient):
            values[:] *= 0.5


def set_sky(model: mujoco.MjModel, kind: str) -> None:
    """Colour the sky of a model for a kind of light, in place."""
    if kind not in SKIES:
        return
    grey, factors = SKIES[kind]
    for k in np.flatnonzero(model.tex_type == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)):
        size = int(model.tex_height[k]) * int(model.tex_width[k])
        pixels = model.tex_data[model.tex_adr[k] :][: 3 * size].reshape(size, 3)
        colour = pixels + grey * (pixels.mean(axis=1, keepdims=True) - pixels)
        pixels[:] = np.clip(colour * np.array(factors), 0, 255).astype(np.uint8)


def wet_ground(model: mujoco.MjModel, wet: float) -> None:
    """Make the ground darker and shiny, in place. wet: in [0, 1], 1 for a film of water everywhere."""
    ground = [k for k in range(model.ngeom) if model.geom(k).name.startswith(("ground", "deck"))]
    for material in np.unique(model.geom_matid[ground]):
        if material >= 0:
            model.mat_rgba[material, :3] *= 1 - WET_DARKNESS * wet
            model.mat_specular[material], model.mat_shininess[material] = WET_SPECULAR * wet, WET_SHININESS
    parallel = model.light_type == int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    model.light_specular[parallel] = np.maximum(model.light_specular[parallel], 0.9 * wet * model.light_diffuse[parallel] / 0.5)


def add_lamps(spec: mujoco.MjSpec, extent: Array, floor: float, rng: np.random.Generator) -> None:
    """Lamps of a room in place of the sun: point lights of one colour in a grid under a ceiling that is not drawn.

    extent: [[xmin, ymin], [xmax, ymax]] m of the scene. floor: m, its height.
    """
    for light in spec.lights:
        light.active = False
    low, high = np.asarray(extent)
    colour = np.array(LAMP_COLOURS[int(rng.integers(len(LAMP_COLOURS)))])
    spread = float(np.min(high - low)) / LAMP_GRID
    for i in range(LAMP_GRID):
        for j in range(LAMP_GRID):
            share = (np.array([i, j]) + 0.5 + rng.uniform(-0.15, 0.15, 2)) / LAMP_GRID
            lamp = spec.worldbody.add_light(name=f"room_lamp{i}{j}", type=mujoco.mjtLightType.mjLIGHT_POINT, castshadow=False)
            lamp.pos = [*(low + share * (high - low)), floor + LAMP_HEIGHT]
            lamp.diffuse, lamp.ambient, lamp.specular = rng.uniform(0.6, 1.0) * colour, np.zeros(3), np.full(3, 0.3)
            lamp.attenuation = [1.0, 0.0, 1.0 / (0.6 * spread + 2.0) ** 2]
    headlight = spec.visual.headlight
    headlight.ambient = 0.6 * headlight.ambient * colour
