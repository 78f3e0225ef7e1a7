"""Colours of skin, hair and clothes, as RGB in [0, 255]."""

from __future__ import annotations

from dataclasses import dataclass

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
"""Many bright colours: people are told apart easily."""

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
"""What streets show. Skins: the ten tones of Monk (2019), The Monk Skin Tone Scale, alike frequent. They are multiplied by (0.93, 0.84, 0.80),
since a swatch is what a picture shows, while a texture is lit. Upper garments: 10 of 22 dark, 6 muted,
2 light, 4 bright. Trousers and skirts: 10 of 14 dark, 2 of denim, 2 light. The shares are chosen, not measured."""
