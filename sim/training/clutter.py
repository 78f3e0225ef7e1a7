"""Things to paste into images that are not people: noise textures, cones, poles, boxes, signs and heaps. All are drawn from a generator."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""(H, W, 3) RGB."""
TEXTURES, TEXTURE_SIZE = 48, 512
"""Number of textures of a bank, and their edge, px. A fresh texture for every crop costs more time than the rest of the augmentation."""
KINDS = ("cone", "pole", "box", "sign", "heap", "tripod")
SEPARATE = 3
"""Number of coarsest octaves, at one of which the noise of a texture begins."""


def texture_bank(rng: np.random.Generator) -> list[Picture]:
    """TEXTURES pictures of coloured noise, of rows of bricks and of stripes."""
    return [_texture(rng, k) for k in range(TEXTURES)]


def _texture(rng: np.random.Generator, number: int) -> Picture:
    size = TEXTURE_SIZE
    field = np.zeros((size, size), np.float32)
    for octave in range(int(rng.integers(0, SEPARATE)), 9):
        cells = min(size, 2 ** (octave + 1))
        weight = rng.uniform(0.3, 0.9) ** octave
        field += weight * cv2.resize(rng.standard_normal((cells, cells), np.float32), (size, size), interpolation=cv2.INTER_CUBIC)
    if number % 3 == 1:
        field += _bricks(rng, size)
    elif number % 3 == 2:
        angle, period = rng.uniform(0, np.pi), rng.uniform(6, 80)
        x, y = np.meshgrid(np.arange(size), np.arange(size))
        field += rng.uniform(0.5, 2.5) * np.sign(np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)).astype(np.float32)
    field = (field - field.min()) / max(float(np.ptp(field)), 1e-6)
    dark, bright = rng.uniform(0, 160, 3), rng.uniform(60, 255, 3)
    return np.asarray(dark + field[..., None] * (bright - dark), dtype=np.float32).clip(0, 255).astype(np.uint8)


def _bricks(rng: np.random.Generator, size: int) -> NDArray[np.float32]:
    """Dark joints, and a random shade of every brick."""
    out = np.zeros((size, size), np.float32)
    height = int(rng.integers(8, 60))
    width = int(height * rng.uniform(1.0, 3.0))
    for row, top in enumerate(range(0, size, height)):
        for left in range(-(row % 2) * width // 2, size, width):
            out[top + 1 : top + height - 1, max(left + 1, 0) : max(left + width - 1, 0)] = rng.uniform(0.6, 1.8)
    return out


def piece(rng: np.random.Generator, height: int) -> tuple[Picture, NDArray[np.uint8]]:
    """A thing of about `height` px: its picture (h, w, 3), and its mask (h, w), 255 inside."""
    kind = KINDS[int(rng.integers(len(KINDS)))]
    width = max(4, int(height * {"cone": 0.6, "pole": 0.15, "box": 0.8, "sign": 0.4, "heap": 1.2, "tripod": 0.6}[kind] * rng.uniform(0.6, 1.4)))
    height = max(6, int(height * {"heap": 0.4, "box": 0.7, "cone": 0.6}.get(kind, 1.0)))
    mask = np.zeros((height, width), np.uint8)
    colour = np.empty((height, width, 3), np.float32)
    colour[:] = _colour(rng)
    _DRAW[kind](rng, mask, colour)
    shade = np.linspace(rng.uniform(0.5, 1.2), rng.uniform(0.5, 1.2), width, dtype=np.float32)[None, :, None]
    colour *= shade * np.linspace(rng.uniform(0.8, 1.2), rng.uniform(0.6, 1.0), height, dtype=np.float32)[:, None, None]
    colour += rng.standard_normal(colour.shape, np.float32) * rng.uniform(0, 10)
    return colour.clip(0, 255).astype(np.uint8), mask


def _colour(rng: np.random.Generator) -> NDArray[np.float32]:
    """A colour: often dark or grey, else a signal colour or any."""
    kind = rng.random()
    if kind < 0.4:
        return np.full(3, rng.uniform(10, 220), np.float32) + rng.normal(0, 8, 3).astype(np.float32)
    if kind < 0.6:
        return np.array([rng.uniform(190, 255), rng.uniform(40, 140), rng.uniform(0, 50)], np.float32)
    return rng.uniform(0, 255, 3).astype(np.float32)


def _bands(rng: np.random.Generator, colour: NDArray[np.float32]) -> None:
    """Horizontal bands in another colour."""
    height, other = len(colour), _colour(rng) if rng.random() < 0.5 else np.full(3, rng.uniform(200, 250), np.float32)
    for _ in range(int(rng.integers(1, 4))):
        top = int(rng.integers(height))
        colour[top : top + max(1, int(height * rng.uniform(0.08, 0.3)))] = other


def _cone(rng: np.random.Generator, mask: Picture, colour: NDArray[np.float32]) -> None:
    height, width = mask.shape
    _bands(rng, colour)
    tip, foot = width * rng.uniform(0.04, 0.12), width * rng.uniform(0.3, 0.42)
    points = [[width / 2 - tip, 0], [width / 2 + tip, 0], [width / 2 + foot, height * 0.92], [width / 2 - foot, height * 0.92]]
    cv2.fillPoly(mask, [np.array(points, np.int32)], 255)
    mask[int(height * 0.92) :] = 255


def _pole(rng: np.random.Generator, mask: Picture, colour: NDArray[np.float32]) -> None:
    if rng.random() < 0.5:
        _bands(rng, colour)
    mask[:] = 255
    if rng.random() < 0.5:
        cv2.ellipse(mask, (mask.shape[1] // 2, 2), (mask.shape[1] // 2, 2), 0, 0, 360, 255, -1)


def _box(rng: np.random.Generator, mask: Picture, colour: NDArray[np.float32]) -> None:
    mask[:] = 255
    height, width = mask.shape
    for _ in range(int(rng.integers(0, 4))):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        colour[y : y + int(rng.integers(1, height)), x : x + int(rng.integers(1, width))] = _colour(rng)


def _sign(rng: np.random.Generator, mask: Picture, colour: NDArray[np.float32]) -> None:
    height, width = mask.shape
    post, plate = max(1, int(width * rng.uniform(0.08, 0.3)) // 2), int(height * rng.uniform(0.2, 0.6))
    mask[:, width // 2 - post : width // 2 + post] = 255
    if rng.random() < 0.5:
        mask[:plate] = 255
    else:
        cv2.ellipse(mask, (width // 2, plate // 2), (width // 2, max(1, plate // 2)), 0, 0, 360, 255, -1)
    colour[:plate] = _colour(rng)
    _bands(rng, colour[:plate])


def _heap(rng: np.random.Generator, mask: Picture, colour: NDArray[np.float32]) -> None:
    height, width = mask.shape
    for _ in range(int(rng.integers(3, 9))):
        part = np.zeros_like(mask)
        centre = int(rng.uniform(0.2, 0.8) * width), int(rng.uniform(0.5, 1.0) * height)
        size = max(1, int(rng.uniform(0.1, 0.3) * width)), max(1, int(rng.uniform(0.2, 0.5) * height))
        cv2.ellipse(part, centre, size, rng.uniform(-30, 30), 0, 360, 255, -1)
        colour[part > 0] = _colour(rng)
        mask |= part


def _tripod(rng: np.random.Generator, mask: Picture, _: NDArray[np.float32]) -> None:
    height, width = mask.shape
    thick, top = max(1, int(width * rng.uniform(0.03, 0.12))), int(height * rng.uniform(0.1, 0.4))
    for foot in (0, width // 2, width - 1):
        cv2.line(mask, (width // 2, top), (foot, height - 1), 255, thick)
    half = int(width * rng.uniform(0.15, 0.4))
    mask[:top, width // 2 - half : width // 2 + half] = 255


_DRAW = {"cone": _cone, "pole": _pole, "box": _box, "sign": _sign, "heap": _heap, "tripod": _tripod}
