"""The world of a user's file, by the kind of file. A height map becomes textured ground with free space where it is not too steep."""

from __future__ import annotations

import numpy as np

from worlds.engine import mujoco
from worlds.places.entrances import entrances_of
from worlds.places.height_map import Relief, orthophoto, read_height_map
from worlds.places.mesh_place import build_mesh
from worlds.places.model_place import build_model
from worlds.places.place import HEIGHT_MAP, MESH, Place, place_of
from worlds.terrain.free_space import walkers_spaces
from worlds.textures.materials import FAIR_SKY, HIGH_SUN, Image, add_light, add_picture, add_sky, set_view
from worlds.textures.soils import Soil, soil
from worlds.world import World

LEAST_FREE = 20.0
"""m²: least free area of people, and of rovers."""
GRASS = Soil((112, 124, 72), (140, 132, 86), (146, 124, 94), 0.5, 6.0)
PIXELS = 4096


def build_place(name: str, rng: np.random.Generator) -> World:
    """The world of a file name with choices. Raises ValueError, which says what to change, if the file cannot be used."""
    place = place_of(name)
    try:
        if place.kind == HEIGHT_MAP:
            return _terrain(place, rng)
        return build_mesh(place, rng) if place.kind == MESH else build_model(place, rng)
    except ValueError as error:
        raise ValueError(f"{place.source}: {str(error).removeprefix(f'{place.source}: ')}") from None


def _terrain(place: Place, rng: np.random.Generator) -> World:
    """The world of a height map. Raises ValueError as read_height_map, and if people or rovers have too little free space."""
    relief = read_height_map(place)
    ground = relief.ground
    spec = mujoco.MjSpec()
    spec.modelname = place.name
    add_picture(spec, "ground", _picture(place, relief, rng), 0.04)
    ground.add_to(spec, "ground", "ground").castshadow = False
    add_sky(spec, *FAIR_SKY)
    add_light(spec, HIGH_SUN, 1.0)
    set_view(spec, ground.extent)
    feet, wheels = walkers_spaces(place.name, ground, relief.holes, (LEAST_FREE, LEAST_FREE))
    spawn = entrances_of(place, feet, rng)
    found = relief.found | {"found_extent": ground.extent.ravel().tolist()}
    return World(place.name, spec, ground, feet, wheels, spawn, place=place.toml(found, relief.notes))


def _picture(place: Place, relief: Relief, rng: np.random.Generator) -> Image:
    """The picture (rows, columns, 3) of the ground, north up: the orthophoto, or grass and bare slopes."""
    if place.texture is not None:
        return orthophoto(place.texture, relief.window, PIXELS)
    return soil(rng, relief.ground, GRASS).image()
