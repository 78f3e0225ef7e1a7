"""A texture atlas with all surfaces of furniture. Each face shows a random part of a surface."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from worlds.terrain.heightfield import Array
from worlds.terrain.relief import noise
from worlds.textures.materials import Box, Canvas, tint

# Each surface is a square tile of TILE metres, at SCALE pixels per metre; ACROSS tiles in a row.
TILE = 1.6
SCALE = 200.0
ACROSS = 4
_INSET = 0.02


class Surface(IntEnum):
    OAK = 0
    WALNUT = 1
    STEEL = 2
    WHITE = 3
    CARDBOARD = 4
    LABELS = 5
    BLUE = 6
    RED = 7
    GREEN = 8
    YELLOW = 9
    DARK = 10
    BOOKS = 11
    SCREEN = 12
    CONCRETE = 13
    PARTS = 14
    DRAWERS = 15


def atlas(rng: np.random.Generator) -> Canvas:
    """The picture: surface k in row k // ACROSS from the top, column k % ACROSS."""
    rows = -(-len(Surface) // ACROSS)
    canvas = Canvas(ACROSS * TILE, rows * TILE, SCALE, (128, 128, 128))
    for surface in Surface:
        x, y = surface % ACROSS * TILE, (rows - 1 - surface // ACROSS) * TILE
        _paint(canvas, rng, surface, (x, y, x + TILE, y + TILE))
    return canvas


def crop(rng: np.random.Generator, surface: Surface, size: tuple[float, float]) -> Array:
    """Texture coordinates [[u0, v0], [u1, v1]] of a random piece of a surface, size (width, height) m, v downwards in the picture.

    Pieces larger than the tile are squeezed into it.
    """
    rows = -(-len(Surface) // ACROSS)
    extent = np.minimum(np.array(size), TILE - 2 * _INSET)
    low = _INSET + rng.uniform(0, 1, 2) * (TILE - 2 * _INSET - extent)
    tile = np.array([surface % ACROSS, surface // ACROSS]) * TILE
    return (tile + np.array([low, low + extent])) / (TILE * np.array([ACROSS, rows]))


_COLOURS: dict[Surface, tuple[int, int, int]] = {
    Surface.OAK: (186, 148, 102),
    Surface.WALNUT: (122, 86, 60),
    Surface.STEEL: (150, 154, 158),
    Surface.WHITE: (222, 220, 214),
    Surface.CARDBOARD: (178, 142, 100),
    Surface.LABELS: (184, 150, 108),
    Surface.BLUE: (58, 96, 152),
    Surface.RED: (168, 62, 52),
    Surface.GREEN: (70, 122, 84),
    Surface.YELLOW: (210, 168, 62),
    Surface.DARK: (62, 62, 66),
    Surface.BOOKS: (90, 80, 70),
    Surface.SCREEN: (34, 40, 52),
    Surface.CONCRETE: (170, 166, 158),
    Surface.PARTS: (120, 124, 128),
    Surface.DRAWERS: (168, 172, 170),
}


def _paint(canvas: Canvas, rng: np.random.Generator, surface: Surface, box: Box) -> None:
    canvas.fill(box, _COLOURS[surface])
    if surface in (Surface.OAK, Surface.WALNUT):
        w = canvas.window(box)
        canvas.shade(box, 0.16 * noise(rng, w.shape[:2], (4.0, 90.0)) + 0.07 * noise(rng, w.shape[:2], (1.5, 30.0)))
    if surface is Surface.LABELS:
        _labels(canvas, rng, box)
    elif surface is Surface.BOOKS:
        _books(canvas, rng, box)
    elif surface is Surface.SCREEN:
        _screens(canvas, rng, box)
    elif surface in (Surface.PARTS, Surface.DRAWERS):
        _drawers(canvas, rng, box, 0.1 if surface is Surface.PARTS else 0.27)
    elif surface in (Surface.BLUE, Surface.RED, Surface.GREEN, Surface.YELLOW, Surface.DARK):
        _ribs(canvas, rng, box)
    canvas.mottle(rng, box, 0.14 if surface is not Surface.CONCRETE else 0.3, 0.6, 6)
    canvas.speckle(rng, box, 0.22, 0.05)


def _labels(canvas: Canvas, rng: np.random.Generator, box: Box) -> None:
    """Cartons: tape, labels, arrows and stamps."""
    x0, y0, x1, y1 = box
    for y in np.arange(y0 + 0.1, y1 - 0.1, 0.33):
        canvas.fill((x0, y, x1, y + 0.05), (206, 180, 134), 0.7)
    for _ in range(26):
        a, b = rng.uniform(x0, x1 - 0.2), rng.uniform(y0, y1 - 0.15)
        w, h = rng.uniform(0.08, 0.2), rng.uniform(0.05, 0.13)
        canvas.fill((a, b, a + w, b + h), tint(rng, (234, 230, 222), 10))
        canvas.writing(rng, (a + 0.01, b + 0.01, a + w - 0.01, b + h - 0.005), (40, 40, 44), 0.02)
        canvas.fill((a, b + h - 0.015, a + w, b + h), tint(rng, (150, 60, 50), 60))


def _books(canvas: Canvas, rng: np.random.Generator, box: Box) -> None:
    """Backs of books and folders, shelf above shelf."""
    x0, y0, x1, y1 = box
    for y in np.arange(y0, y1 - 0.1, 0.32):
        canvas.fill((x0, y, x1, y + 0.03), (150, 116, 80))
        x = x0
        while x < x1 - 0.02:
            w, h = min(rng.uniform(0.02, 0.075), x1 - x), rng.uniform(0.19, 0.27)
            colour = tint(rng, [(150, 58, 50), (54, 84, 130), (210, 200, 180), (64, 104, 76), (46, 46, 52), (204, 160, 70)][int(rng.integers(6))], 22)
            canvas.fill((x, y + 0.03, x + w, y + 0.03 + h), colour)
            canvas.fill((x, y + 0.03, x + 0.004, y + 0.03 + h), colour * 0.5)
            canvas.writing(rng, (x + 0.008, y + 0.08, x + w - 0.006, y + 0.03 + 0.8 * h), (228, 222, 206), 0.022)
            x += w


def _screens(canvas: Canvas, rng: np.random.Generator, box: Box) -> None:
    """Windows of programs on dark glass."""
    x0, y0, x1, y1 = box
    for _ in range(24):
        a, b = rng.uniform(x0, x1 - 0.3), rng.uniform(y0, y1 - 0.25)
        w, h = rng.uniform(0.12, 0.3), rng.uniform(0.1, 0.22)
        canvas.fill((a, b, a + w, b + h), tint(rng, (64, 78, 96), 30))
        canvas.fill((a, b + h - 0.015, a + w, b + h), tint(rng, (150, 158, 170), 20))
        ink = [(160, 210, 160), (220, 190, 120), (150, 180, 230)][int(rng.integers(3))]
        canvas.writing(rng, (a + 0.01, b + 0.01, a + w - 0.01, b + h - 0.02), ink, 0.018)


def _drawers(canvas: Canvas, rng: np.random.Generator, box: Box, size: float) -> None:
    """Fronts of drawers or small parts bins, labelled."""
    x0, y0, x1, y1 = box
    bins = size < 0.2
    for y in np.arange(y0, y1, size * 0.8):
        for x in np.arange(x0, x1, size if bins else 0.53):
            w = size if bins else 0.53
            tone = [(150, 58, 50), (64, 92, 140), (196, 158, 70), (86, 122, 92)][int(rng.integers(4))] if bins else _COLOURS[Surface.DRAWERS]
            front = (x + 0.006, y + 0.006, min(x + w, x1) - 0.006, min(y + size * 0.8, y1) - 0.006)
            canvas.fill(front, tint(rng, tone, 14))
            canvas.shade((front[0], front[1], front[2], front[1] + 0.02), -0.35)
            middle = 0.5 * (front[0] + front[2])
            canvas.fill((middle - 0.03, front[3] - 0.045, middle + 0.03, front[3] - 0.015), (232, 230, 222))
            canvas.writing(rng, (middle - 0.027, front[3] - 0.042, middle + 0.027, front[3] - 0.017), (50, 50, 54), 0.014)


def _ribs(canvas: Canvas, rng: np.random.Generator, box: Box) -> None:
    """Moulded plastic or sheet metal: ribs, rims and stickers."""
    x0, y0, x1, y1 = box
    y = y0
    while y < y1:
        canvas.shade((x0, y, x1, min(y + 0.018, y1)), rng.uniform(-0.35, -0.15))
        canvas.shade((x0, min(y + 0.018, y1 - 0.01), x1, min(y + 0.03, y1)), 0.18)
        y += rng.uniform(0.07, 0.22)
    for _ in range(14):
        a, b = rng.uniform(x0, x1 - 0.15), rng.uniform(y0, y1 - 0.1)
        w, h = rng.uniform(0.04, 0.14), rng.uniform(0.03, 0.09)
        canvas.fill((a, b, a + w, b + h), tint(rng, (226, 222, 210), 16))
        canvas.writing(rng, (a + 0.008, b + 0.006, a + w - 0.008, b + h - 0.004), (44, 44, 50), 0.02)
