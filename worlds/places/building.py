"""The world of a file: it is read by its kind."""

from __future__ import annotations

import numpy as np

from worlds.places.mesh_place import build_mesh
from worlds.places.model_place import build_model
from worlds.places.place import HEIGHT_MAP, MESH, place_of
from worlds.places.terrain_place import build_terrain
from worlds.world import World


def build_place(name: str, rng: np.random.Generator) -> World:
    """The world of the name of a file, with its choices. Raises ValueError, which says what to change, where it cannot be used."""
    place = place_of(name)
    try:
        if place.kind == HEIGHT_MAP:
            return build_terrain(place, rng)
        return build_mesh(place, rng) if place.kind == MESH else build_model(place, rng)
    except ValueError as error:
        raise ValueError(f"{place.source}: {str(error).removeprefix(f'{place.source}: ')}") from None
