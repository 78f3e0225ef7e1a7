"""Pictures of people, as posters and cardboard figures show them.

A picture is a cell of an atlas, WIDTH × HEIGHT m at the person's own size, with its middle at x = 0 and its foot at z = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worlds.terrain.heightfield import Array
from worlds.textures.materials import Canvas, tint

WIDTH, HEIGHT = 0.9, 1.8
"""m: a cell; the person in it is 1.7 m tall."""
ACROSS, DOWN = 4, 2
"""Cells in a row, and rows of them."""
COUNT = ACROSS * DOWN
_SCALE = 160.0
_SKINS = ((246, 206, 178), (202, 150, 112), (146, 102, 74), (96, 66, 48))
_CLOTHS = ((196, 34, 38), (34, 66, 156), (228, 226, 220), (36, 36, 42), (44, 118, 66), (236, 196, 52), (104, 174, 208), (110, 30, 44))
_TROUSERS = ((38, 48, 86), (30, 30, 32), (88, 88, 92), (146, 124, 92))

Part = tuple[str, Array]


def silhouette(cell: int) -> list[Part]:
    """Convex parts of the person in a cell: the name of its colour, and its corners (k, 2) m of x and z, anticlockwise.

    Cells differ in their stance: legs together or apart, arms hanging, on the hip or at the head; three of the eight wear a skirt.
    """
    apart, raised, skirt = 0.03 + 0.05 * (cell % 3), (0.0, 0.5, 2.3, 0.1)[cell % 4], cell % 3 == 1
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    head = np.stack([0.085 * np.cos(angle), 1.585 + 0.115 * np.sin(angle)], axis=1)
    hair = np.stack([0.095 * np.cos(angle[:9]), 1.6 + 0.105 * np.sin(angle[:9])], axis=1)
    parts: list[Part] = []
    for side in (-1.0, 1.0):
        foot = side * (0.06 + apart)
        parts.append(("skin" if skirt else "trousers", _limb((side * 0.08, 0.95), (foot, 0.06), (0.085, 0.055))))
        parts.append(("shoes", _limb((foot - 0.05, 0.035), (foot + 0.05, 0.035), (0.035, 0.035))))
        # The arm at −x hangs; the pose of the other arm depends on the cell.
        lift = 0.15 if side < 0 else 0.15 + raised
        elbow = side * (0.19 + 0.28 * np.sin(lift)), 1.38 - 0.28 * np.cos(lift)
        bend = {0.5: -0.9, 2.3: 1.9}.get(raised, 0.2)
        hand = elbow[0] + side * 0.26 * np.sin(lift + side * bend * (side > 0)), elbow[1] - 0.26 * np.cos(lift + bend * (side > 0))
        parts += [("top", _limb((side * 0.19, 1.38), elbow, (0.055, 0.045))), ("skin", _limb(elbow, hand, (0.04, 0.035)))]
    if skirt:
        parts.append(("trousers", np.array([[-0.26, 0.45], [0.26, 0.45], [0.16, 1.0], [-0.16, 1.0]])))
    parts.append(("top", np.array([[-0.17, 0.88], [0.17, 0.88], [0.22, 1.38], [0.12, 1.45], [-0.12, 1.45], [-0.22, 1.38]])))
    return [*parts, ("skin", _limb((0.0, 1.42), (0.0, 1.52), (0.055, 0.05))), ("skin", head), ("hair", hair)]


def picture_box(cell: int) -> Array:
    """Texture coordinates [[u0, v0], [u1, v1]] of a cell, v downwards in the picture."""
    low = np.array([cell % ACROSS, cell // ACROSS], dtype=np.float64)
    return np.array([low, low + 1]) / np.array([ACROSS, DOWN])


def texture_of(cell: int, points: Array) -> Array:
    """Texture coordinates (n, 2) of points (n, 2) m of x and z in a cell."""
    low, high = picture_box(cell)
    share = np.column_stack([points[:, 0] / WIDTH + 0.5, 1.0 - points[:, 1] / HEIGHT])
    return np.asarray(low + np.clip(share, 0.0, 1.0) * (high - low))


def pictures(rng: np.random.Generator) -> Canvas:
    """The atlas: cell k in row k // ACROSS from the top, column k % ACROSS; people in front of coloured backgrounds."""
    canvas = Canvas(ACROSS * WIDTH, DOWN * HEIGHT, _SCALE, (128, 128, 128))
    for cell in range(COUNT):
        x, y = cell % ACROSS * WIDTH, (DOWN - 1 - cell // ACROSS) * HEIGHT
        frame = (x, y, x + WIDTH, y + HEIGHT)
        canvas.picture(rng, frame, [tint(rng, _CLOTHS[int(rng.integers(len(_CLOTHS)))], 40) for _ in range(3)])
        canvas.writing(rng, (x + 0.03, y + 0.02, x + 0.25, y + 0.4), tint(rng, (240, 240, 240)), 0.05)
        skin, top, trousers = (tint(rng, colours[int(rng.integers(len(colours)))], 10) for colours in (_SKINS, _CLOTHS, _TROUSERS))
        colours = {"skin": skin, "top": top, "trousers": trousers, "shoes": np.full(3, 35.0), "hair": tint(rng, (60, 42, 30), 25)}
        for kind, corners in silhouette(cell):
            window = canvas.window(frame)
            inside = _inside(corners, window.shape[:2])
            window[inside] = colours[kind]
        canvas.mottle(rng, frame, 0.12, 0.3)
    return canvas


def _limb(a: tuple[float, float], b: tuple[float, float], half: tuple[float, float]) -> Array:
    """Corners (6, 2) m of a limb from a to b with half widths there, and blunt ends; anticlockwise."""
    p, q = np.array(a), np.array(b)
    along = (q - p) / np.linalg.norm(q - p)
    aside = np.array([-along[1], along[0]])
    return np.array([p - half[0] * along, p - half[0] * aside, q - half[1] * aside, q + half[1] * along, q + half[1] * aside, p + half[0] * aside])


def _inside(corners: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels (rows, columns) of a cell whose middles are within a convex polygon (k, 2) m, anticlockwise."""
    rows, columns = shape
    x, z = np.meshgrid(((np.arange(columns) + 0.5) / columns - 0.5) * WIDTH, (1 - (np.arange(rows) + 0.5) / rows) * HEIGHT)
    inside = np.ones(shape, dtype=np.bool_)
    for (ax, az), (bx, bz) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (bx - ax) * (z - az) - (bz - az) * (x - ax) >= 0
    return inside
