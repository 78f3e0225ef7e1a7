"""Files of places that tests write from formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image


def hills(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights, m, of gentle hills."""
    return np.asarray(3 + 1.8 * np.sin(x / 9) * np.cos(y / 11) + 0.4 * np.sin(x / 5 + 1) * np.sin(y / 6))


def pixel_centres(size: float, pixels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x and y, m, of the pixels of a square map around the origin, row 0 in the north."""
    edge = (np.arange(pixels) + 0.5) * size / pixels - size / 2
    x, y = np.meshgrid(edge, edge[::-1])
    return x, y


def write_png(path: Path, size: float = 40.0, pixels: int = 160) -> str:
    """A 16-bit PNG of the hills, and the name of its world."""
    z = hills(*pixel_centres(size, pixels))
    Image.fromarray(np.round((z - z.min()) / np.ptp(z) * 65535).astype(np.uint16)).save(path)
    return f"{path}:size={size},low={z.min()},high={z.max()}"


def house() -> trimesh.Scene:
    """A house of 10 x 10 m on a lawn, z up, metres: a door of 2 m, a table, four steps of 17 cm to a platform, a slope of 10° beside, a flat roof."""
    scene = trimesh.Scene()

    def box(name: str, low: tuple[float, float, float], high: tuple[float, float, float], colour: tuple[int, int, int]) -> None:
        extents = np.subtract(high, low)
        solid = trimesh.creation.box(extents=extents, transform=trimesh.transformations.translation_matrix(np.add(low, high) / 2))
        solid.visual = trimesh.visual.ColorVisuals(solid, face_colors=[*colour, 255])
        scene.add_geometry(solid, node_name=name, geom_name=name)

    box("ground", (-10, -8, -0.5), (10, 8, 0), (120, 130, 90))
    for k, (x0, y0, x1, y1) in enumerate([(-5, -5, -4.8, 5), (5, -5, 5.2, 5), (-5, -5, -1, -4.8), (1, -5, 5, -4.8), (-5, 4.8, 5.2, 5)]):
        box(f"wall_{k}", (x0, y0, 0), (x1, y1, 3), (180, 160, 150))
    box("lintel", (-1, -5, 2.2), (1, -4.8, 3), (200, 120, 100))
    box("roof", (-5.3, -5.3, 3), (5.5, 5.3, 3.2), (150, 60, 50))
    box("table", (-3, 1, 0.7), (-1.5, 2, 0.75), (120, 80, 40))
    for k in range(4):
        box(f"step_{k}", (1.5 + 0.3 * k, 2, 0), (1.5 + 0.3 * (k + 1), 4.8, 0.17 * (k + 1)), (140, 140, 150))
    box("podest", (2.7, 2, 0), (5, 4.8, 0.68), (140, 140, 150))
    rise = np.tan(np.radians(10)) * 3
    points = np.array([(-9, -6, 0), (-6, -6, rise), (-6, -3, rise), (-9, -3, 0), (-6, -6, 0), (-6, -3, 0)], dtype=float)
    faces = [(0, 1, 2), (0, 2, 3), (0, 4, 1), (3, 2, 5), (1, 4, 5), (1, 5, 2), (0, 3, 5), (0, 5, 4)]
    scene.add_geometry(trimesh.Trimesh(points, faces, process=False), node_name="slope", geom_name="slope")
    return scene


def write_house(path: Path, unit: float = 1.0) -> str:
    """The house as a file; y is up in glTF, z in others. unit: m of its coordinates."""
    scene = house()
    if path.suffix == ".glb":
        scene.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    scene.apply_scale(1 / unit)
    if path.suffix == ".obj":
        path.write_text(scene.to_mesh().export(file_type="obj", include_color=False))
    else:
        path.write_bytes(scene.export(file_type="glb") if path.suffix == ".glb" else scene.to_mesh().export(file_type=path.suffix[1:]))
    return str(path)


MODEL = """<mujoco model="site">
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0 0 1" width="32" height="32"/>
    <hfield name="bump" nrow="3" ncol="3" size="1 1 0.1 0.1" elevation="0 0 0 0 1 0 0 0 0"/>
  </asset>
  <worldbody>
    <light pos="0 0 5" dir="0 0 -1" directional="true"/>
    <camera name="gate" pos="-6 0 3" xyaxes="0 -1 0 0.5 0 0.87" fovy="60"/>
    <geom name="floor" type="plane" size="8 6 0.1"/>
    <geom name="stones" type="hfield" hfield="bump" pos="4 3 0"/>
    <geom name="crate" type="box" size="0.5 0.5 0.5" pos="2 -2 0.5"/>
    <body name="robot_0" pos="-3 2 1"><freejoint/><geom name="ball" type="sphere" size="0.4" mass="3"/></body>
  </worldbody>
  <keyframe><key qpos="0 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""
"""A site with a finite floor, an obstacle, a height field, a camera and a ball that falls; its names are those that a scene has, too."""
