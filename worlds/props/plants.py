"""Trees, bushes, logs and stumps. Wood is solid; leaves collide with nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from worlds.engine import mujoco
from worlds.props.meshes import PERIOD, hull, wrapped
from worlds.props.shapes import Shape, joined
from worlds.terrain.heightfield import Array
from worlds.terrain.relief import fractal, noise
from worlds.textures.materials import Canvas, tint

BARK, LEAVES, NEEDLES = "bark", "leaves", "needles"
"""Names of the materials, which `canvases` paints."""
SIDES = 9


@dataclass(frozen=True, eq=False)
class Plant:
    """The meshes of a plant, with the foot of the stem as origin.

    wood: solid and convex. leaves: a mesh or None. radius: of the solid part on the ground, m. foliage: the material of the leaves.
    """

    wood: Shape
    leaves: Shape | None
    radius: float
    foliage: str = LEAVES

    def stand(self, spec: mujoco.MjSpec, name: str, place: ArrayLike, yaw: float) -> None:
        """Put it at place (3,) m, turned by yaw rad, as geoms `name` and `name-leaves`."""
        self.wood.add_to(spec, name, BARK, place, yaw)
        if self.leaves is not None:
            crown = self.leaves.add_to(spec, f"{name}-leaves", self.foliage, place, yaw)
            crown.contype = crown.conaffinity = 0


def canvases(rng: np.random.Generator, autumn: float = 0.0) -> dict[str, Canvas]:
    """Material → picture, PERIOD m wide and high; autumn in [0, 1] turns leaves from green to gold."""
    bark = Canvas(PERIOD, PERIOD, 96.0, tint(rng, (104, 84, 64), 8))
    shape = bark.pixels.shape[:2]
    bark.shade(bark.box, 0.5 * noise(rng, shape, (60.0, 5.0)) + 0.2 * noise(rng, shape, (20.0, 2.5)))
    bark.mottle(rng, bark.box, 0.3, 0.8, 6)
    green, gold = np.array([82, 112, 48]), np.array([176, 128, 48])
    leaves = _foliage(rng, (1 - autumn) * green + autumn * gold, (3.0, 3.0))
    return {BARK: bark, LEAVES: leaves, NEEDLES: _foliage(rng, np.array([50, 78, 52]), (7.0, 2.0))}


def _foliage(rng: np.random.Generator, colour: Array, grain: tuple[float, float]) -> Canvas:
    """Leaves in light and in the shade of others, with gaps that are nearly black."""
    canvas = Canvas(PERIOD, PERIOD, 96.0, tint(rng, colour, 8))
    shape = canvas.pixels.shape[:2]
    single = noise(rng, shape, grain) + 0.7 * noise(rng, shape, (2.2 * grain[0], 2.2 * grain[1]))
    canvas.shade(canvas.box, 0.42 * single)
    canvas.shade(canvas.box, -0.55 * (single < -0.75))
    warm = np.clip(1.5 * fractal(rng, shape, 60.0, 5), -1, 1)[..., None]
    canvas.pixels += warm * np.array([22, 10, -6], dtype=np.float32)
    canvas.mottle(rng, canvas.box, 0.3, 1.2, 6)
    return canvas


def broadleaf(rng: np.random.Generator, height: float) -> Plant:
    """A tree about `height` m high; its crown is a group of leaf clusters above people's heads."""
    radius = 0.028 * height * rng.uniform(0.8, 1.25)
    stem = 0.62 * height
    lean = rng.normal(0, 0.02, 2) * height
    wood = _stem(rng, radius, stem, lean)
    clouds = []
    for k in range(int(rng.integers(4, 7))):
        size = height * rng.uniform(0.13, 0.2) * np.array([1, 1, rng.uniform(0.7, 0.9)])
        angle, out = 2.4 * k + rng.uniform(0, 1), height * rng.uniform(0.06, 0.17)
        lowest = max(0.42 * height, 2.3 + size[2])
        middle = np.array([lean[0] + out * np.cos(angle), lean[1] + out * np.sin(angle), rng.uniform(lowest, 0.86 * height)])
        clouds.append(_cloud(rng, middle, size))
    return Plant(wood, joined(clouds), 1.35 * radius)


def conifer(rng: np.random.Generator, height: float) -> Plant:
    """A spruce or a pine: tiers of hanging branches, the lowest above people's heads."""
    radius = 0.024 * height * rng.uniform(0.8, 1.2)
    wood = _stem(rng, radius, 0.9 * height, np.zeros(2))
    storeys = int(rng.integers(4, 6))
    levels = np.linspace(max(0.3 * height, 2.4), 0.8 * height, storeys)
    parts = []
    for k, level in enumerate(levels):
        reach = 0.2 * height * (1 - 0.75 * k / storeys) * rng.uniform(0.85, 1.1)
        angle = np.linspace(0, 2 * np.pi, 2 * SIDES, endpoint=False)
        ragged = reach * np.where(np.arange(2 * SIDES) % 2, 0.72, 1.0) * rng.uniform(0.85, 1.1, 2 * SIDES)
        rim = np.column_stack([ragged * np.cos(angle), ragged * np.sin(angle), level - 0.12 * ragged])
        tip = [0, 0, level + 0.27 * height]
        under = [0, 0, level + 0.04 * height]
        n = len(rim)
        nxt = (np.arange(n) + 1) % n
        faces = np.concatenate([
            np.column_stack([np.arange(n), nxt, np.full(n, n)]), np.column_stack([nxt, np.arange(n), np.full(n, n + 1)])
        ])  # fmt: skip
        parts.append(wrapped(np.concatenate([rim, [tip, under]]), faces, rng.uniform(0, PERIOD, 2)))
    return Plant(wood, joined(parts), 1.35 * radius, NEEDLES)


def bush(rng: np.random.Generator, size: float) -> Plant:
    """A bush `size` m high and about as wide, which people and rovers cannot cross."""
    clouds = [_cloud(rng, np.array([*rng.uniform(-0.25, 0.25, 2) * size, 0.42 * size]), np.array([0.42, 0.42, 0.46]) * size) for _ in range(3)]
    return Plant(_stem(rng, 0.05 * size, 0.4 * size, np.zeros(2)), joined(clouds), 0.55 * size)


def stump(rng: np.random.Generator) -> Plant:
    """The stump of a felled tree."""
    radius = rng.uniform(0.16, 0.3)
    return Plant(_stem(rng, radius, rng.uniform(0.25, 0.6), np.zeros(2)), None, 1.35 * radius)


def log(rng: np.random.Generator, length: float, radius: float) -> Shape:
    """A fallen stem around the origin along x, length and radius m."""
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    rings = [(-length / 2, radius), (length / 2, 0.8 * radius)]
    points = np.concatenate([np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(SIDES, z)]) for z, r in rings])
    # The upright stem gets its texture first, so that the grain runs along it; then it is laid down.
    upright = hull(points, rng.uniform(0, PERIOD, 2))
    x, y, z = upright.vertices.T
    return Shape(np.column_stack([z, y, -x]), upright.faces, upright.texcoord)


def _stem(rng: np.random.Generator, radius: float, height: float, lean: Array) -> Shape:
    """A stem that gets thinner upwards, flared at its foot, leaning by `lean` (2,) m at its top; it reaches 0.4 m into the ground."""
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    rings = []
    for level, wide in ((-0.4, 1.35), (0.04 * height, 1.12), (0.5 * height, 0.8), (height, 0.35)):
        r = radius * wide * rng.uniform(0.94, 1.06, SIDES)
        share = max(level, 0.0) / height
        rings.append(np.column_stack([share * lean[0] + r * np.cos(angle), share * lean[1] + r * np.sin(angle), np.full(SIDES, level)]))
    return hull(np.concatenate(rings), rng.uniform(0, PERIOD, 2))


def _cloud(rng: np.random.Generator, middle: Array, half: Array) -> Shape:
    """A lump of leaves: a ball with dents, half lengths (3,) m."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices = np.asarray(ball.vertices) * rng.uniform(0.78, 1.12, (len(ball.vertices), 1)) * half
    return wrapped(vertices + middle, np.asarray(ball.faces, dtype=np.int64), rng.uniform(0, PERIOD, 2))
