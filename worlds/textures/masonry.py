"""Textures of walls: plaster, brick or concrete, each `width` m wide, from `base` m (0 is the floor) up to `height` m; and of rock and hewn stone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worlds.terrain.relief import fractal, noise
from worlds.textures.materials import Canvas, tint

# Pixels a metre: from 1.5 m away a panorama of 1024 pixels sees about 110 of them in a metre.
SCALE = 112.0


def plaster(rng: np.random.Generator, width: float, height: float, base: float) -> Canvas:
    """Painted plaster, often in two tones, one above the other, with marks of wear."""
    upper = tint(rng, [(214, 208, 196), (198, 208, 204), (210, 200, 182), (192, 202, 214)][int(rng.integers(4))], 6)
    canvas = Canvas(width, height, SCALE, upper, base)
    if rng.uniform() < 0.7:
        edge = rng.uniform(0.9, 1.25)
        canvas.fill((0, base, width, edge), tint(rng, [(118, 138, 134), (140, 128, 110), (104, 122, 146), (150, 142, 128)][int(rng.integers(4))], 8))
        canvas.fill((0, edge, width, edge + 0.04), tint(rng, (92, 92, 90)))
    canvas.mottle(rng, canvas.box, 0.16, 1.6, 6)
    canvas.speckle(rng, canvas.box, 0.12, 0.04)
    for _ in range(int(3 * width)):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        canvas.mottle(rng, (x, y, x + rng.uniform(0.05, 0.5), y + rng.uniform(0.01, 0.06)), rng.uniform(0.2, 0.5), 0.08, 2)
    return canvas


def brick(rng: np.random.Generator, width: float, height: float, base: float) -> Canvas:
    """Bricks of different tones, with lighter and darker patches."""
    canvas = Canvas(width, height, SCALE, (172, 162, 150), base)
    tone = tint(rng, [(158, 96, 74), (176, 164, 146), (146, 110, 92)][int(rng.integers(3))], 8)
    long, high, joint = 0.25, 0.083, 0.012
    for row in range(int(base / high) - 1, int(height / high) + 1):
        shift = (row % 2) * long / 2 + rng.uniform(-0.03, 0.03)
        for column in range(-1, int(width / long) + 2):
            x, y = column * long + shift, row * high
            canvas.fill((x, y, x + long - joint, y + high - joint), tone * rng.uniform(0.68, 1.22) + rng.normal(0, 5, 3))
    canvas.mottle(rng, canvas.box, 0.25, 1.3, 7)
    canvas.speckle(rng, canvas.box, 0.22, 0.06)
    return canvas


def concrete(rng: np.random.Generator, width: float, height: float, base: float) -> Canvas:
    """Cast concrete: panels with their tie holes and stains."""
    canvas = Canvas(width, height, SCALE, tint(rng, (168, 166, 160), 6), base)
    x = 0.0
    while x < width:
        panel = rng.uniform(0.9, 1.6)
        for y0, y1 in ((base, 1.4), (1.4, height)):
            canvas.shade((x, y0, x + panel, y1), rng.uniform(-0.12, 0.08))
            for u in (0.2, 0.8):
                canvas.disc((x + u * panel, y0 + 0.5 * (y1 - y0) + rng.uniform(-0.05, 0.05)), 0.018, (92, 90, 86))
        canvas.fill((x - 0.006, base, x + 0.006, height), (120, 118, 112))
        x += panel
    canvas.fill((0, 1.395, width, 1.405), (118, 116, 110))
    canvas.mottle(rng, canvas.box, 0.30, 1.4, 7)
    canvas.speckle(rng, canvas.box, 0.22, 0.05)
    return canvas


def skirting(canvas: Canvas, rng: np.random.Generator) -> None:
    """Dirt that settles low on a wall, and a skirting board."""
    foot = (0, canvas.base, canvas.width, 0.45)
    rows = canvas.window(foot).shape[0]
    canvas.shade(foot, np.linspace(0.0, -0.22, rows)[:, None])
    board = (0, canvas.base, canvas.width, 0.12)
    canvas.fill(board, tint(rng, (92, 88, 82), 8))
    canvas.mottle(rng, board, 0.3, 0.5, 5)


def rock(rng: np.random.Generator, colour: ArrayLike, size: float = 8.0) -> Canvas:
    """Bare rock with beds, cracks and stains, size x size m, that repeats without a seam."""
    canvas = Canvas(size, size, SCALE, tint(rng, colour, 8))
    shape = canvas.pixels.shape[:2]
    canvas.shade(canvas.box, 0.16 * noise(rng, shape, (14.0, 160.0)) + 0.30 * fractal(rng, shape, 1.3 * SCALE, 7))
    # Cracks are zero crossings of one pattern; facets meet at zero crossings of another one.
    canvas.shade(canvas.box, -0.4 * np.exp(-((fractal(rng, shape, 1.1 * SCALE, 6) / 0.012) ** 2)))
    canvas.shade(canvas.box, 0.14 * np.tanh(fractal(rng, shape, 0.6 * SCALE, 6) / 0.04))
    warm = np.clip(fractal(rng, shape, 0.9 * SCALE, 5), 0, 1)[..., None]
    canvas.pixels += warm * np.array([26, 8, -16], dtype=np.float32)
    canvas.speckle(rng, canvas.box, 0.25, 0.07)
    return _seamless(canvas)


def ashlar(rng: np.random.Generator, colour: ArrayLike, size: float = 8.0) -> Canvas:
    """Courses of different hewn stones, size x size m, that repeat without a seam."""
    canvas = Canvas(size, size, SCALE, np.asarray(colour) * 0.62)
    y = 0.0
    while y < size - 0.02:
        high = min(rng.uniform(0.2, 0.36), size - y)
        x = shift = -rng.uniform(0, 0.5)
        while x < size + shift - 0.02:
            long = min(rng.uniform(0.28, 0.75), size + shift - x)
            tone = tint(rng, colour, 5) * rng.uniform(0.74, 1.14)
            # The part of a stone beyond the left edge continues at the right edge.
            for left in (x, x + size):
                canvas.fill((left + 0.012, y + 0.012, left + long - 0.004, y + high - 0.004), tone)
                canvas.shade((left + 0.012, y + high - 0.03, left + long - 0.004, y + high - 0.004), 0.12)
            x += long
        y += high
    grain = Canvas(size, size, SCALE, (255, 255, 255))
    grain.mottle(rng, grain.box, 0.32, 1.3, 7)
    grain.speckle(rng, grain.box, 0.25, 0.07)
    canvas.pixels *= _seamless(grain).pixels / 255
    return canvas


def _seamless(canvas: Canvas) -> Canvas:
    """The picture, blended near its edges with a copy shifted by half its size, so that opposite edges match."""
    rows, columns, _ = canvas.pixels.shape
    moved = np.roll(canvas.pixels, (rows // 2, columns // 2), axis=(0, 1))
    y, x = (np.minimum(np.arange(n), n - 1 - np.arange(n)) / (0.12 * n) for n in (rows, columns))
    own = np.clip(np.minimum(y[:, None], x[None]), 0, 1).astype(np.float32)[..., None]
    canvas.pixels[:] = own * canvas.pixels + (1 - own) * moved
    return canvas
