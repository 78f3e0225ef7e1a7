"""Texture atlas of all people: heads with skin and hair, fabrics, shoes and bags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from worlds.engine import mujoco
from worlds.terrain.relief import Pattern, fractal, noise

Colour = tuple[int, int, int]
Colours = tuple[Colour, ...]


@dataclass(frozen=True)
class Palette:
    """Colours to draw from with equal weights: skins, hairs, cloths of upper garments and bags, and legs."""

    skins: Colours
    hairs: Colours
    cloths: Colours
    legs: Colours


LEATHER = ((28, 26, 26), (226, 224, 220), (92, 54, 34), (150, 36, 38), (56, 68, 92))
"""Shoes and belts."""
_HAIRS = ((22, 18, 16), (64, 42, 28), (112, 78, 46), (196, 160, 98), (138, 136, 134), (104, 56, 34))
PLAIN = Palette(
    skins=((246, 206, 178), (232, 186, 150), (202, 150, 112), (146, 102, 74), (96, 66, 48)),
    hairs=_HAIRS,
    cloths=(
        (196, 34, 38), (34, 66, 156), (228, 226, 220), (36, 36, 42), (44, 118, 66), (236, 196, 52), (128, 58, 130), (234, 128, 44), (104, 174, 208),
        (134, 136, 142), (110, 30, 44), (224, 150, 172), (92, 84, 60), (30, 92, 98), (176, 140, 96),
    ),
    legs=((38, 48, 86), (30, 30, 32), (88, 88, 92), (146, 124, 92), (66, 74, 56), (78, 104, 150), (106, 72, 48), (170, 160, 140)),
)  # fmt: skip
"""Many bright colours, by which people are easy to distinguish."""

_DARK = ((24, 24, 27), (30, 30, 34), (38, 38, 42), (26, 30, 44), (32, 38, 58), (44, 40, 38), (52, 44, 36), (46, 50, 44), (58, 58, 62), (40, 28, 34))
_MUTED = ((92, 94, 98), (128, 130, 132), (156, 150, 140), (96, 92, 72), (110, 84, 62), (72, 92, 122))
VARIED = Palette(
    skins=(
        (229, 199, 182), (226, 194, 175), (230, 197, 166), (218, 183, 149), (200, 159, 120), (149, 106, 69), (121, 77, 54), (89, 55, 42),
        (54, 41, 34), (38, 30, 26),
    ),
    hairs=(*_HAIRS, (12, 11, 11), (30, 24, 22), (190, 188, 184)),
    cloths=(*_DARK, *_MUTED, (232, 230, 226), (206, 204, 198), (150, 40, 42), (36, 78, 150), (206, 176, 66), (60, 116, 84)),
    legs=(*_DARK, (50, 60, 92), (70, 88, 122), (108, 108, 110), (150, 138, 116)),
)  # fmt: skip
"""Colours as in streets. Skins: the ten tones of Monk (2019), The Monk Skin Tone Scale, equally frequent. They are multiplied by
(0.93, 0.84, 0.80), since a swatch is a colour in a picture, while a texture is lit. Upper garments: 10 of 22 dark, 6 muted,
2 light, 4 bright. Trousers and skirts: 10 of 14 dark, 2 of denim, 2 light. The shares are chosen, not measured."""


NAME = "people"
"""Name of the texture and of the material."""
TILE, ACROSS = 256, 8
"""Pixels along a tile, tiles along the atlas."""
HEADS, TOPS, BOTTOMS, SHOES, BAGS = range(20), range(20, 42), range(42, 54), range(54, 59), range(59, 64)
"""Indices of the tiles: heads with skin and hair, upper and lower garments, shoes, bags and hats."""
BALD = 7
"""Every BALD-th head has no hair."""
HAIR, FACE, SKIN = (0.0, 0.01, 1.0, 0.13), (0.0, 0.14, 1.0, 0.80), (0.0, 0.83, 1.0, 0.98)
"""Regions of a head's tile (u0, v0, u1, v1), v downwards: strands, the whole head from crown to throat, bare skin."""
CROWN, THROAT = 0.182, 0.045
"""Heights of the top and the bottom of FACE above the shoulders, shares of stature."""


def add_clothing_textures(spec: mujoco.MjSpec, rng: np.random.Generator, palette: Palette = PLAIN) -> None:
    """Add the texture and the material NAME to `spec`; `rng` draws colours and patterns."""
    side = TILE * ACROSS
    texture = spec.add_texture(name=NAME, type=mujoco.mjtTexture.mjTEXTURE_2D, width=side, height=side, nchannel=3)
    texture.data = texture_atlas(rng, palette).tobytes()
    material = spec.add_material(name=NAME, specular=0.08, shininess=0.1)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = NAME


def texture_atlas(rng: np.random.Generator, palette: Palette = PLAIN) -> NDArray[np.uint8]:
    """The image (2048, 2048, 3). Tile k is in row k // ACROSS from the top, column k % ACROSS."""
    side = TILE * ACROSS
    picture = np.zeros((side, side, 3), np.uint8)
    for k in range(ACROSS**2):
        if k in HEADS:
            tile = _head(rng, k, palette)
        elif k in TOPS:
            tile = _top(rng, k, palette)
        elif k in BOTTOMS:
            tile = _bottom(rng, k, palette)
        else:
            tile = _shoe(rng, k) if k in SHOES else _bag(rng, k, palette)
        row, column = k // ACROSS * TILE, k % ACROSS * TILE
        picture[row : row + TILE, column : column + TILE] = np.clip(tile, 4, 255)
    return picture


def region(tile: int, part: tuple[float, float, float, float]) -> Array:
    """Texture coordinates (u0, v0, u1, v1) of a part of a tile. It is inset, so that mip maps do not mix in neighbouring tiles."""
    return np.asarray((np.tile([tile % ACROSS, tile // ACROSS], 2) + np.clip(part, 0.012, 0.988)) / ACROSS)


def _head(rng: np.random.Generator, k: int, palette: Palette) -> Pattern:
    """A head: strands of hair on top, then the unrolled head with the face in the middle, then skin."""
    skin = _varied_colour(rng, palette.skins[k % len(palette.skins)], 6)
    hair = _varied_colour(rng, palette.hairs[int(rng.integers(len(palette.hairs)))], 4)
    tile = _cloth(rng, skin, 0.05)
    strands = hair * (1 + 0.35 * noise(rng, (TILE, TILE), (60.0, 2.2)) + 0.15 * noise(rng, (TILE, TILE), (20.0, 6.0)))[..., None]
    rows, columns = np.mgrid[0:TILE, 0:TILE]
    aside = np.abs(columns - 127.5) / 128
    if k % BALD:
        # Height of the hairline from the forehead (aside 0) past the ears to the nape (1).
        line = np.interp(aside, [0.0, 0.20, 0.27, 0.33, 0.38, 1.0], [_row(0.157), _row(0.152), _row(0.122), _row(0.110), _row(0.085), _row(0.075)])
        covered = (rows < line + 3 * noise(rng, (TILE, TILE), (40.0, 4.0))) & (rows < 0.81 * TILE)
        tile[covered] = strands[covered]
    tile[: round(0.138 * TILE)] = strands[: round(0.138 * TILE)]
    beard = rng.random() < 0.3
    if beard:
        chin = (np.abs(columns - 127.5) < 44) & (rows > _row(0.094)) & (rows < _row(0.052)) & ~_ellipse((127.5, _row(0.081)), (15, 7))
        tile[chin] = 0.45 * tile[chin] + 0.55 * strands[chin]
    _face(tile, skin, 0.7 * hair if k % BALD else 0.5 * skin)
    return tile


def _face(tile: Pattern, skin: Pattern, brow: Pattern) -> None:
    """Eyes, brows, nose and mouth."""
    eye, mouth, nose = _row(0.124), _row(0.081), _row(0.098)
    lips, dark = skin * [0.82, 0.58, 0.56], skin * 0.45
    for side in (-1.0, 1.0):
        at = 127.5 + 17.5 * side
        for centre, radii, colour, opacity in (
            ((at, eye), (13, 10), skin * 0.86, 0.6),
            ((at, eye), (8.5, 4.6), np.array([238, 236, 232]), 1.0),
            ((at, eye), (3.4, 4.2), np.array([64, 44, 30]), 1.0),
            ((at, eye), (1.6, 2.0), np.array([8, 8, 8]), 1.0),
            ((at, eye - 4.6), (9.5, 1.5), dark, 0.9),
            ((at + side, eye - 13), (11, 2.4), brow, 0.9),
            ((127.5 + 4 * side, nose + 3), (2.4, 1.6), dark, 0.8),
            ((127.5 + 30 * side, _row(0.098)), (13, 14), skin * [1.0, 0.9, 0.88], 0.35),
            ((127.5 + 7 * side, nose), (3.0, 6.0), skin * 0.82, 0.5),
        ):
            mask = _ellipse(centre, radii)
            tile[mask] += opacity * (np.asarray(colour, dtype=np.float32) - tile[mask])
    for centre, radii, colour in (
        ((127.5, mouth), (13, 4.2), lips),
        ((127.5, mouth - 0.3), (13, 0.9), 0.6 * lips),
        ((127.5, mouth + 9), (8, 2), skin * 0.85),
    ):
        tile[_ellipse(centre, radii)] = colour


def _top(rng: np.random.Generator, k: int, palette: Palette) -> Pattern:
    """Shirts, jumpers and jackets; the number of the tile sets the pattern."""
    base, other = (_varied_colour(rng, palette.cloths[i], 10) for i in rng.choice(len(palette.cloths), 2, replace=False))
    style = (k - TOPS.start) % 8
    tile = _cloth(rng, base, 0.13)
    rows, columns = np.mgrid[0:TILE, 0:TILE]
    width = int(rng.integers(5, 14))
    if style == 1:
        tile[rows % (2 * width) < width] = _cloth(rng, other, 0.13)[rows % (2 * width) < width]
    elif style == 2:
        for lines in (rows, columns):
            tile[lines % (3 * width) < width] = 0.5 * tile[lines % (3 * width) < width] + 0.5 * other
    elif style == 3:
        tile *= (1 + 0.22 * np.sin(rows * 1.1) * np.sign(np.sin(columns * 0.8)))[..., None]
    elif style == 4:
        _print(rng, tile, other)
    elif style == 5:
        _jacket(tile, other)
    elif style == 6:
        _buttons(tile)
    elif style == 7:
        tile[(rows > 80) & (rows < 80 + 3 * width)] = _cloth(rng, other, 0.13)[(rows > 80) & (rows < 80 + 3 * width)]
    return tile


def _print(rng: np.random.Generator, tile: Pattern, colour: Pattern) -> None:
    """A print on the chest, and one on the back across the seam."""
    for left, top, width, height in ((92, 62, 72, 56), (0, 70, 26, 50), (230, 70, 26, 50)):
        shape = fractal(rng, (height, width), 22.0, 3)
        area = tile[top : top + height, left : left + width]
        area[shape > 0.0] = colour
        area[shape > 0.3] = 255 - colour


def _jacket(tile: Pattern, lining: Pattern) -> None:
    """A zip with a strip of lining, pockets, seams over the shoulders."""
    tile[:, 126:130] = 0.35 * tile[:, 126:130]
    tile[:70, 120:136] = lining
    for left in (66, 160):
        tile[132:136, left : left + 34] *= 0.5
    tile[36:38] *= 0.6
    tile[176:180] *= 0.6


def _buttons(tile: Pattern) -> None:
    """A placket with buttons, a collar, a pocket on the left breast."""
    tile[:, 121:123] *= 0.75
    tile[:, 133:135] *= 0.75
    for row in range(16, 200, 24):
        tile[_ellipse((128, row), (2.6, 2.6))] = 240
    tile[:14, 96:160] *= 1.15
    tile[14:16, 96:160] *= 0.6
    tile[74:76, 150:180] *= 0.65
    tile[76:106, [150, 179]] *= 0.75


def _bottom(rng: np.random.Generator, k: int, palette: Palette) -> Pattern:
    """Trousers and skirts, a belt along the upper edge."""
    base = _varied_colour(rng, palette.legs[int(rng.integers(len(palette.legs)))], 9)
    tile = _cloth(rng, base, 0.14)
    rows, columns = np.mgrid[0:TILE, 0:TILE]
    style = (k - BOTTOMS.start) % 4
    if style == 1:
        tile *= (1 + 0.16 * noise(rng, (TILE, TILE), (3.0, 1.2)))[..., None]
        tile[80:] *= (1 + 0.30 * np.exp(-(((columns[80:] % 128 - 64) / 26.0) ** 2)))[..., None]
    elif style == 2:
        for lines in (rows, columns):
            tile[lines % 18 < 3] *= 1.25
    elif style == 3:
        tile *= (1 + 0.12 * np.sign(np.sin(columns * 0.9)))[..., None]
    tile[:, [2, 64, 192]] *= 0.7
    tile[6:17] = _varied_colour(rng, LEATHER[int(rng.integers(3))], 8)
    tile[7:16, 122:134] = (190, 180, 150)
    return tile


def _shoe(rng: np.random.Generator, k: int) -> Pattern:
    """A shoe: laces on the instep in the middle, the sole along both edges."""
    tile = _cloth(rng, _varied_colour(rng, LEATHER[(k - SHOES.start) % len(LEATHER)], 8), 0.08)
    light = np.full(3, 225 if k % 2 else 60, np.float32)
    for row in range(110, 200, 14):
        tile[row : row + 4, 108:148] = light
    tile[:, :62] = tile[:, 194:] = light
    return tile


def _bag(rng: np.random.Generator, k: int, palette: Palette) -> Pattern:
    """Cloth of one colour with zips and seams; the first bag is knitted."""
    tile = _cloth(rng, _varied_colour(rng, palette.cloths[int(rng.integers(len(palette.cloths)))], 12), 0.1)
    rows, columns = np.mgrid[0:TILE, 0:TILE]
    if k == BAGS.start:
        tile *= (1 + 0.25 * np.sign(np.sin(columns * 0.6)) * np.cos(rows * 0.7))[..., None]
    else:
        for row in (60, 150):
            tile[row : row + 4] *= 0.4
            tile[row + 4 : row + 6] *= 1.3
    return tile


def _cloth(rng: np.random.Generator, colour: Pattern, folds: float) -> Pattern:
    """A tile (TILE, TILE, 3) of one colour with soft folds and fine grain."""
    shade = folds * fractal(rng, (TILE, TILE), 70.0, 3) + 0.04 * noise(rng, (TILE, TILE), 1.5)
    return np.asarray(colour * (1 + shade)[..., None], dtype=np.float32)


def _varied_colour(rng: np.random.Generator, colour: Colour, spread: float) -> Pattern:
    return np.clip(np.asarray(colour) + rng.normal(0.0, spread, 3), 6, 250).astype(np.float32)


def _row(z: float) -> float:
    """Row of a head's tile at height z above the shoulders, a share of stature."""
    return TILE * float(FACE[1] + (FACE[3] - FACE[1]) * (CROWN - z) / (CROWN - THROAT))


def _ellipse(centre: tuple[float, float], radii: tuple[float, float]) -> NDArray[np.bool_]:
    """Mask (TILE, TILE) of the ellipse about (column, row)."""
    rows, columns = np.ogrid[0:TILE, 0:TILE]
    return ((columns - centre[0]) / radii[0]) ** 2 + ((rows - centre[1]) / radii[1]) ** 2 <= 1
