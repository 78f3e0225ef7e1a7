"""Appearance: a canvas with drawing operations for textures of floors, walls and furniture; materials, light and sky."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worlds.engine import mujoco
from worlds.terrain.heightfield import Heightfield
from worlds.terrain.polygons import turned
from worlds.terrain.relief import Pattern, fractal, noise

Image = NDArray[np.uint8]
Box = tuple[float, float, float, float]


@final
class Canvas:
    """A picture that is being painted, with `scale` pixels per metre: x from 0 (left) to width, y from base (bottom) to height, metres.

    A box is (x0, y0, x1, y1) m; parts off the canvas are not painted. Colours are (3,) in [0, 255].
    """

    def __init__(self, width: float, height: float, scale: float, colour: ArrayLike, base: float = 0.0) -> None:
        self.width, self.height, self.scale, self.base = width, height, scale, base
        shape = (max(2, round((height - base) * scale)), max(2, round(width * scale)), 3)
        self.pixels: Pattern = np.empty(shape, dtype=np.float32)
        self.pixels[:] = np.asarray(colour, dtype=np.float32)

    def image(self) -> Image:
        """(rows, columns, 3) uint8, row 0 on top."""
        return np.clip(self.pixels, 0, 255).astype(np.uint8)

    @property
    def box(self) -> Box:
        return 0.0, self.base, self.width, self.height

    def window(self, box: Box) -> Pattern:
        """The pixels (a view, maybe empty) within a box, at least one pixel thick."""
        rows, columns, _ = self.pixels.shape
        x0, x1 = (round(v * self.scale) for v in (box[0], box[2]))
        y0, y1 = (round((v - self.base) * self.scale) for v in (box[1], box[3]))
        left, right = max(0, x0), min(columns, max(x1, x0 + 1))
        top, bottom = max(0, rows - max(y1, y0 + 1)), min(rows, rows - y0)
        return self.pixels[top : max(top, bottom), left : max(left, right)]

    def fill(self, box: Box, colour: ArrayLike, opacity: float = 1.0) -> None:
        w = self.window(box)
        w += np.float32(opacity) * (np.asarray(colour, dtype=np.float32) - w)

    def frame(self, box: Box, colour: ArrayLike, thickness: float) -> None:
        """A border of that thickness m within the box."""
        x0, y0, x1, y1 = box
        for side in (
            (x0, y0, x1, y0 + thickness),
            (x0, y1 - thickness, x1, y1),
            (x0, y0, x0 + thickness, y1),
            (x1 - thickness, y0, x1, y1),
        ):
            self.fill(side, colour)

    def disc(self, centre: tuple[float, float], radius: float, colour: ArrayLike) -> None:
        x, y = centre
        w = self.window((x - radius, y - radius, x + radius, y + radius))
        v, u = np.mgrid[-1 : 1 : w.shape[0] * 1j, -1 : 1 : w.shape[1] * 1j]
        w[u**2 + v**2 <= 1] = np.asarray(colour, dtype=np.float32)

    def shade(self, box: Box, amount: ArrayLike) -> None:
        """Brightness changed by a factor 1 + amount, which broadcasts over the box's (rows, columns)."""
        w = self.window(box)
        w *= np.broadcast_to(1 + np.asarray(amount, dtype=np.float32), w.shape[:2])[..., None]

    def mottle(self, rng: np.random.Generator, box: Box, strength: float, period: float, octaves: int = 4) -> None:
        """Lighter and darker patches in `octaves` sizes: the largest are `period` m across, each next size is half as large."""
        w = self.window(box)
        if w.size:
            self.shade(box, strength * fractal(rng, w.shape[:2], period * self.scale, octaves))

    def speckle(self, rng: np.random.Generator, box: Box, strength: float, share: float) -> None:
        """Specks a pixel or two across, over a share of the box, lighter or darker by up to the strength."""
        w = self.window(box)
        if w.size:
            grain = noise(rng, w.shape[:2], 1.7)
            self.shade(box, strength * np.where(np.abs(grain) > np.quantile(np.abs(grain[::4, ::4]), 1 - share), grain, 0.0))

    def writing(self, rng: np.random.Generator, box: Box, colour: ArrayLike, line: float) -> None:
        """Lines of illegible writing, `line` m high, ragged on the right."""
        x0, y0, x1, y1 = box
        y = y1 - line
        while y >= y0:
            x, end = x0, x0 + (x1 - x0) * rng.uniform(0.45, 1.0)
            while x < end:
                word = line * rng.uniform(0.6, 3.5)
                self._word(rng, (x, y, min(x + word, x1), y + 0.62 * line), colour)
                x += word + 0.45 * line
            y -= 1.25 * line

    def _word(self, rng: np.random.Generator, box: Box, colour: ArrayLike) -> None:
        w = self.window(box)
        if w.size:
            ink = rng.random(w.shape[:2], dtype=np.float32) < 0.6
            w[ink] = np.asarray(colour, dtype=np.float32)

    def picture(self, rng: np.random.Generator, box: Box, colours: ArrayLike) -> None:
        """An abstract picture: three colours (3, 3) in cloudy shapes."""
        w = self.window(box)
        if w.size:
            palette = np.asarray(colours, dtype=np.float32)
            shape, period = w.shape[:2], max(w.shape[:2]) / 2.5
            a, b = (np.clip(0.5 + 1.4 * fractal(rng, shape, period, 5), 0, 1)[..., None] for _ in range(2))
            w[:] = (palette[0] * (1 - a) + palette[1] * a) * (1 - b) + palette[2] * b


def tint(rng: np.random.Generator, colour: ArrayLike, spread: float = 12.0) -> Pattern:
    """A random colour (3,) near a colour; spread: about its standard deviation, in [0, 255]."""
    return np.clip(np.asarray(colour) + rng.normal(0, spread, 3) * 0.5 + rng.normal(0, spread) * 0.7, 0, 255).astype(np.float32)


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


NEAREST = 0.03
"""m: distance of the near clipping plane from a camera."""
FAIR_SKY = (0.36, 0.56, 0.84), (0.84, 0.89, 0.94)
"""Colours of a fair sky at the zenith and at the horizon."""
HIGH_SUN = (0.5, 0.35, -1.0)
"""Direction of the light of a high sun."""


def add_sky(spec: mujoco.MjSpec, zenith: ArrayLike, horizon: ArrayLike) -> None:
    """A sky without features, from one colour (3,) in [0, 1] to another: points at infinity must not look like landmarks."""
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
    """A sun with shadows along `direction` (3,), a weaker light without shadows from the other side, and ambient light, scaled by brightness.

    The headlight gives the ambient light, since a light with shadows loses its ambient part in shadow. The headlight gives nothing else,
    since appearance must not depend on the position of the camera.
    """
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = np.full(3, 0.46 * brightness), np.zeros(3), np.zeros(3)
    towards = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    for name, way, diffuse in (("sun", towards, 0.50), ("fill", towards * (-1, -1, 0.35), 0.24)):
        light = spec.worldbody.add_light(name=name, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=name == "sun")
        light.pos, light.dir = -12.0 * way, way
        light.diffuse, light.ambient, light.specular = np.full(3, brightness * diffuse), np.zeros(3), np.full(3, 0.1)


def add_open_air(spec: mujoco.MjSpec, rng: np.random.Generator, ground: Heightfield, sky: tuple[ArrayLike, ArrayLike], low: float) -> None:
    """Add the ground, of the material "ground"; a sky, colours at the zenith and at the horizon; a sun of random azimuth; and the view.

    low: horizontal metres of the sun's rays per metre of descent.
    """
    # Shadows of the ground are too small to justify drawing it a second time.
    ground.add_to(spec, "ground", "ground").castshadow = False
    add_sky(spec, *sky)
    add_light(spec, [*turned([low, 0.0], rng.uniform(-np.pi, np.pi)), -1.0], 1.0)
    set_view(spec, ground.extent)


def set_view(spec: mujoco.MjSpec, extent: ArrayLike) -> None:
    """Set clipping planes, shadows and buffers for an extent [[xmin, ymin], [xmax, ymax]] m. The near plane is at NEAREST.

    The shadow map and slices are small, and there is no multisampling: on a CPU they cost more than they show (resampling smooths panoramas).
    """
    low, high = np.asarray(extent, dtype=np.float64)
    radius = float(np.hypot(*(high - low))) / 2
    spec.stat.extent = radius
    spec.stat.center = np.array([*(low + high) / 2, 1.0])
    view = spec.visual
    view.map.znear, view.map.zfar, view.map.shadowclip = NEAREST / radius, 6.0, 1.0
    view.global_.offwidth = view.global_.offheight = 4096
    view.quality.shadowsize, view.quality.offsamples = 1024, 0
    view.quality.numslices, view.quality.numstacks = 16, 10
