"""The world of a mesh: its drawn parts, a height field with which wheels collide, and the free space of one level."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from worlds.engine import mujoco
from worlds.places.entrances import entrances_of
from worlds.places.mesh_file import Part, read_mesh
from worlds.places.place import Place
from worlds.places.surfaces import Level, find_level
from worlds.semantics import kind_of
from worlds.terrain.free_space import FEET, free_space, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield
from worlds.textures.materials import FAIR_SKY, HIGH_SUN, add_light, add_picture, add_sky, set_view
from worlds.world import World

LEAST_FREE = (6.0, 3.0)
"""m²: least free area of people, and of rovers."""
HIDDEN = 4
"""Group of geoms that collide, but are neither drawn nor hit by rays of cameras."""


def grid_over(place: Place, bounds: Array) -> Heightfield:
    """The grid of free space over bounds (2, 3) m, or over the area of the place."""
    low, high = bounds[:, :2] if place.area is None else np.clip(np.reshape(place.area, (2, 2)), *bounds[:, :2])
    if not (high - low > 2.0).all():
        whose = "the place is" if place.area is None else "area covers"
        raise ValueError(f"{whose} {max(high[0] - low[0], 0):.3g} x {max(high[1] - low[1], 0):.3g} m, needs more than 2 m a side")
    spacing = place.grid_spacing(float((high - low).max()))
    # The shift keeps grid points off edges at whole metres, where a vertical line would touch two faces.
    return Heightfield.flat([low + 0.37 * spacing, high], spacing)


def level_of(place: Place, triangles: Array) -> tuple[Level, list[str]]:
    """The walkable level of triangles (k, 3, 3) m, and notes about it for the user."""
    points = triangles.reshape(-1, 3)
    grid = grid_over(place, np.array([points.min(axis=0), points.max(axis=0)]))
    level = find_level(triangles, grid, place.level, np.reshape(place.entrances, (-1, 2)))
    surface = level.terrain.on_grid
    floor = surface.heights[free_space(surface, level.blocked[0], FEET).free]
    notes = [f"people walk between {floor.min().round(2) + 0.0:.2f} and {floor.max().round(2) + 0.0:.2f} m of height"]
    if level.others > 0:
        notes.append(f"other levels (floors, roofs) are left out: {level.others}; level=Z, m, chooses another")
    return level, notes


@lru_cache(maxsize=2)
def _analysed(place: Place, _time: int) -> tuple[tuple[Part, ...], Level, tuple[str, ...], str]:
    """Parts, level, notes and the text of place.toml, none of which is random. _time: modification time of the file, ns."""
    mesh = read_mesh(place)
    level, notes = level_of(place, np.concatenate([part.vertices[part.faces] for part in mesh.parts]))
    said = (*mesh.notes, *notes)
    return tuple(mesh.parts), level, said, place.toml(mesh.found, said)


def build_mesh(place: Place, rng: np.random.Generator) -> World:
    """The world of a mesh. Raises ValueError as read_mesh and find_level, and if people or rovers have too little free space."""
    parts, level, _, text = _analysed(place, place.source.stat().st_mtime_ns)
    spec = mujoco.MjSpec()
    spec.modelname = place.name
    counts = np.cumsum([0, *(len(part.faces) for part in parts)])
    number = 0
    for k, (part, (first, last)) in enumerate(zip(parts, pairwise(counts), strict=True)):
        material = _add_material(spec, part, k)
        for kind, chosen in _kinds(part, level.decks[first:last]):
            if chosen.any():
                _add_part(spec, part, part.faces[chosen], f"{kind}{number}", material)
                number += 1
    met = level.contact.add_to(spec, "ground")
    met.group, met.rgba = HIDDEN, [0, 0, 0, 0]
    add_sky(spec, *FAIR_SKY)
    add_light(spec, HIGH_SUN, 1.0)
    return world_of_level(place, spec, level, rng, text)


def world_of_level(place: Place, spec: mujoco.MjSpec, level: Level, rng: np.random.Generator, text: str) -> World:
    """The world of a scene and its walkable level. text: its place.toml."""
    ground = level.terrain.ground
    set_view(spec, ground.extent)
    feet, wheels = walkers_spaces(place.name, level.terrain.on_grid, level.blocked, LEAST_FREE)
    return World(place.name, spec, ground, feet, wheels, entrances_of(place, feet, rng), level.terrain.decks, place=text)


def _kinds(part: Part, decks: NDArray[np.bool_]) -> list[tuple[str, NDArray[np.bool_]]]:
    """Kinds and masks of their faces: one kind by the part's names, else ground for walked faces and beam for the others."""
    kind = kind_of(part.words)
    if kind is not None:
        return [(kind, np.ones(len(part.faces), dtype=bool))]
    return [("ground", decks), ("beam", ~decks)]


def _add_material(spec: mujoco.MjSpec, part: Part, number: int) -> str:
    name = f"material{number}"
    if part.image is not None:
        add_picture(spec, name, part.image, 0.05)
    else:
        spec.add_material(name=name, rgba=[*part.colour[:3], 1.0], specular=0.05, shininess=0.3)
    return name


def _add_part(spec: mujoco.MjSpec, part: Part, faces: NDArray[np.int64], name: str, material: str) -> None:
    """Faces of a part as a geom that is drawn and hit by rays, but never collides: wheels collide with the height field."""
    used, index = np.unique(faces, return_inverse=True)
    vertices, uv, index = part.vertices[used], None if part.uv is None else part.uv[used], index.reshape(-1, 3)
    if len(vertices) < 4:
        # MuJoCo refuses a single triangle, but takes its two halves.
        vertices = np.vstack([vertices, vertices[:2].mean(axis=0)])
        uv = None if uv is None else np.vstack([uv, uv[:2].mean(axis=0)])
        index = np.concatenate([[np.where(face == end, 3, face) for end in (0, 1)] for face in index])
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel(), userface=index.ravel())
    # A shell needs neither volume nor closed surfaces.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    if uv is not None:
        mesh.usertexcoord = (uv * [1, -1] + [0, 1]).ravel()
    geom = spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=material)
    geom.group, geom.contype, geom.conaffinity = 1, 0, 0
