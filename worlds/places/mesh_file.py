"""Meshes of a user, read by trimesh: parts with their colours, in metres, z up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worlds.places.place import AXES, UNITS, Found, Place
from worlds.terrain.heightfield import Array

MOST_TRIANGLES, MOST_READ = 1_000_000, 8_000_000
"""Meshes of more triangles than the first are simplified; of more than the second, refused."""
SMALLEST, LARGEST = 3.0, 2000.0
"""m: bounds of the sides of a place."""
FAR = 1000.0
"""m: a place farther from its origin is moved to it, since images are drawn with 32-bit floats."""
PALETTE = 64
"""Side, in colours, of the square palette picture for colours of vertices: 16 levels per channel."""


@dataclass(frozen=True, eq=False)
class Part:
    """A piece of a mesh: vertices (n, 3) m, faces (k, 3); uv (n, 2) and image (rows, columns, 3) or None; colour (4,) in [0, 1].

    words: names of its node, geometry and material.
    """

    words: str
    vertices: Array
    faces: NDArray[np.int64]
    uv: Array | None
    image: NDArray[np.uint8] | None
    colour: Array


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The parts of a mesh, metres, z up; notes for the user; found: what was guessed, as choices of the place."""

    parts: list[Part]
    notes: list[str]
    found: Found


def read_mesh(place: Place) -> MeshFile:
    """The mesh of a place. Raises ValueError, which says what to change, for a file that cannot be read, or sides out of bounds."""
    parts = _parts(place.source)
    total = sum(len(part.faces) for part in parts)
    if not total:
        raise ValueError("has no triangles")
    if total > MOST_READ:
        raise ValueError(f"has {total / 1e6:.1f} million triangles, needs at most {MOST_READ / 1e6:g} million: reduce it (Blender: Decimate)")
    up = place.up or ("y" if place.source.suffix.lower() in (".glb", ".gltf") else _guessed_up(parts))
    turn = _upright(up)
    parts = [replace(part, vertices=part.vertices @ turn.T) for part in parts]
    bounds = _bounds(parts)
    unit = place.unit or _guessed_unit(bounds)
    sides = (bounds[1] - bounds[0])[:2] * unit
    if sides.max() > LARGEST or sides.min() < SMALLEST:
        size = f"{sides[0]:.3g} x {sides[1]:.3g} m"
        raise ValueError(f"is {size} (unit {unit:g} m, {up} up), needs {SMALLEST:g} to {LARGEST:g} m a side; tell unit= (m, cm, mm, in, ft) or up=")
    middle = bounds.mean(axis=0) * unit
    shift = np.where(np.abs(middle) > FAR, -middle, 0.0)
    parts = [replace(part, vertices=part.vertices * unit + shift) for part in parts]
    axis = f"{up} points up ({_told(place.up)}), unit {unit:g} m ({_told(place.unit)})"
    notes = [f"{place.source.name}: {sides[0]:.4g} x {sides[1]:.4g} m, {total} triangles; {axis}"]
    found: Found = {"up": up, "unit": unit}
    if shift.any():
        notes.append(f"it is moved by {', '.join(f'{v:.2f}' for v in shift)} m towards the origin")
        found["found_shift"] = shift.tolist()
    if total > MOST_TRIANGLES:
        parts = [_reduced(part, MOST_TRIANGLES / total) for part in parts]
        notes.append(f"its triangles are reduced to {sum(len(part.faces) for part in parts)}")
    return MeshFile(parts, notes, found)


def _told(value: object) -> str:
    return "guessed" if value is None else "told"


def _parts(path: Path) -> list[Part]:
    try:
        scene: Any = trimesh.load_scene(path, process=False)
        nodes = [(name, *scene.graph[name]) for name in sorted(scene.graph.nodes_geometry)]
        return [_part(scene.geometry[geometry], T, f"{name} {geometry}") for name, T, geometry in nodes if hasattr(scene.geometry[geometry], "faces")]
    # trimesh documents no type of exception for a broken file.
    except Exception as error:
        raise ValueError(f"no mesh that can be read ({type(error).__name__}: {' '.join(str(error).split())[:100]})") from None


def _part(mesh: Any, T: Array, words: str) -> Part:
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64) @ T[:3, :3].T + T[:3, 3], np.asarray(mesh.faces, dtype=np.int64)
    if (np.linalg.det(T[:3, :3]) < 0) != bool(mesh.is_watertight and mesh.volume < 0):
        faces = faces[:, ::-1]
    corners = vertices[faces]
    solid = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 1e-12
    faces = faces[solid & np.isfinite(corners).all(axis=(1, 2))]
    visual, material = mesh.visual, getattr(mesh.visual, "material", None)
    words = f"{words} {getattr(material, 'name', '') or ''}"
    if material is None:
        return _coloured(Part(words, vertices, faces, None, None, np.array([0.62, 0.62, 0.6, 1.0])), visual)
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv = getattr(visual, "uv", None)
    colour = np.asarray(material.main_color, dtype=np.float64)[:4] / 255
    if picture is None or uv is None or len(uv) != len(vertices):
        return Part(words, vertices, faces, None, None, colour)
    picture = picture.convert("RGB")
    picture.thumbnail((4096, 4096))
    return Part(words, vertices, faces, np.asarray(uv, dtype=np.float64), np.asarray(picture), np.ones(4))


def _coloured(part: Part, visual: Any) -> Part:
    """The part with the colours of its faces or vertices as a picture: each face takes one colour of a palette."""
    if not visual.defined or not len(part.faces) or len(visual.face_colors) < len(part.faces):
        return part
    colours = np.asarray(visual.vertex_colors)[:, :3][part.faces].mean(axis=1)
    if np.ptp(colours, axis=0).max() < 2:
        return replace(part, colour=np.append(colours[0] / 255, 1.0))
    level = np.clip(np.rint(colours / 17), 0, 15).astype(np.int64)
    index = level @ [256, 16, 1]
    at = (np.stack([index % PALETTE, index // PALETTE], axis=1) + 0.5) / PALETTE
    every = np.arange(PALETTE**2)
    palette = np.stack([every // 256, every // 16 % 16, every % 16], axis=1).reshape(PALETTE, PALETTE, 3) * 17
    uv = np.repeat(at, 3, axis=0) * [1, -1] + [0, 1]
    vertices, faces = part.vertices[part.faces].reshape(-1, 3), np.arange(3 * len(part.faces)).reshape(-1, 3)
    return replace(part, vertices=vertices, faces=faces, uv=uv, image=palette.astype(np.uint8), colour=np.ones(4))


def _bounds(parts: list[Part]) -> Array:
    points = np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in parts])
    return np.array([points.min(axis=0), points.max(axis=0)])


def _guessed_up(parts: list[Part]) -> str:
    """The axis, y or z, along which more area faces up; y only if it has 1.2 times as much."""
    corners = np.concatenate([part.vertices[part.faces] for part in parts])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    share = np.where(normal[:, 1:] > 0.9 * area[:, None], normal[:, 1:], 0.0).sum(axis=0)
    return "y" if share[0] > 1.2 * share[1] else "z"


def _upright(up: str) -> Array:
    """The rotation (3, 3) that turns the axis `up` to z; the first of the two other axes becomes x."""
    k = AXES.index(up) % 3
    sign = -1.0 if up.startswith("-") else 1.0
    rows = np.zeros((3, 3))
    rows[2, k] = sign
    # y up as in glTF: x stays, −z becomes y.
    rows[0, {0: 1, 1: 0, 2: 0}[k]] = 1.0
    rows[1] = np.cross(rows[2], rows[0])
    return rows


def _guessed_unit(bounds: Array) -> float:
    """m per unit: the first of m, mm and cm with plausible sides, else m."""
    sides = bounds[1] - bounds[0]
    for name in ("m", "mm", "cm"):
        wide, high = sides[:2] * UNITS[name], sides[2] * UNITS[name]
        if wide.min() >= SMALLEST and wide.max() <= (500.0 if name == "m" else 100.0) and high <= 150.0:
            return UNITS[name]
    return 1.0


def _reduced(part: Part, share: float) -> Part:
    """The part with about a share of its triangles (Garland & Heckbert 1997); texture coordinates are those of the nearest vertices."""
    try:
        import fast_simplification
    except ImportError:
        needs = "pip install 'pilsim[places]'"
        raise ValueError(f"has more than {MOST_TRIANGLES} triangles; reducing them needs the extra places: {needs}") from None
    if len(part.faces) < 100:
        return part
    merged, index = np.unique(part.vertices.round(6), axis=0, return_inverse=True)
    vertices, faces = fast_simplification.simplify(merged.astype(np.float32), index[part.faces].astype(np.int32), target_reduction=1 - share)
    vertices, faces = vertices.astype(np.float64), faces.astype(np.int64)
    if part.uv is None or (np.ptp(of_faces := part.uv[part.faces], axis=1) > 0).any():
        uv = None if part.uv is None else part.uv[KDTree(part.vertices).query(vertices)[1]]
        return replace(part, vertices=vertices, faces=faces, uv=uv)
    # Each face has one colour of a palette: between two of its colours lie others, so that no face may have two.
    nearest = KDTree(part.vertices[part.faces].mean(axis=1)).query(vertices[faces].mean(axis=1))[1]
    vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    return replace(part, vertices=vertices, faces=faces, uv=of_faces[nearest].reshape(-1, 2))
