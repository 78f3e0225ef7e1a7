"""Images for the network: any picture as RGB of 8 bits, levels of scale, and the seam of panoramas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Image
from tracker.io.image_files import MOST_PIXELS, eight_bits
from tracker.person_detector.network import MULTIPLE

SEAM = 96
"""px of a level by which an image that wraps is continued on both sides."""


def rgb_image(picture: NDArray[Any]) -> Image:
    """A picture as (H, W, 3) uint8 RGB: grey (H, W) or (H, W, 1), RGB, or RGBA, whose alpha is dropped; of 8 or, as eight_bits, 16 bits.

    Raises ValueError for another shape or type, and for more than MOST_PIXELS pixels.
    """
    image = np.asarray(picture)
    if image.ndim == 2:
        image = image[:, :, None]
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4) or image.dtype not in (np.uint8, np.uint16) or not image.size:
        raise ValueError(f"picture is {image.dtype} {np.shape(picture)}, needs uint8 or uint16, grey, RGB or RGBA, at least one pixel")
    if image.shape[0] * image.shape[1] > MOST_PIXELS:
        raise ValueError(f"picture is {image.shape[1]} x {image.shape[0]} px, needs at most {MOST_PIXELS} px")
    if image.shape[2] == 4:
        image = image[:, :, :3]
    return np.ascontiguousarray(np.broadcast_to(eight_bits(image), (*image.shape[:2], 3)), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Level:
    """An image for the network: pixels (1, 3, H, W) RGB in 0 to 1. A point p px of the level is (p − origin) · scale px of the picture."""

    pixels: NDArray[np.float32]
    origin: tuple[int, int]
    scale: float


def level_of(image: Image, halvings: int, wraps: bool, rows: tuple[int, int] | None = None) -> Level:
    """A level of an image (H, W, 3), 2^halvings times smaller.

    wraps: whether the right edge of the image continues at the left one.
    rows: first row and end of the part that is searched, None for all; the first is a multiple of 2^halvings.
    """
    first, end = rows or (0, len(image))
    part: NDArray[Any] = image[first:end]
    height, width = (max(1, -(-side >> halvings)) for side in part.shape[:2])
    scale = 2.0**halvings
    if halvings:
        # A side that is not a multiple of the scale is padded first, so that a pixel of the level is a square of pixels.
        fill = height * 2**halvings - part.shape[0], width * 2**halvings - part.shape[1]
        part = cv2.copyMakeBorder(part, 0, fill[0], 0, fill[1], cv2.BORDER_REPLICATE)
        part = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
    pad = SEAM if wraps else 0
    if pad:
        # A panorama narrower than the padding repeats several times.
        columns = np.arange(-pad, width + pad) % width
        part = part[:, columns]
    return Level(_input_of(part), (pad, -(first >> halvings)), scale)


def level_of_part(part: Image, corner: tuple[int, int]) -> Level:
    """A level of a part of a picture at twice its size. corner: column and row of the part in the picture, px."""
    return Level(_input_of(part), (-2 * corner[0], -2 * corner[1]), 0.5)


def _input_of(part: NDArray[Any]) -> NDArray[np.float32]:
    """A picture (h, w, 3) as input (1, 3, H, W) of the network, padded to multiples of MULTIPLE."""
    below, right = -len(part) % MULTIPLE, -part.shape[1] % MULTIPLE
    part = cv2.copyMakeBorder(part, 0, below, 0, right, cv2.BORDER_REPLICATE)
    pixels = np.ascontiguousarray(part.transpose(2, 0, 1)[None], dtype=np.float32)
    pixels *= np.float32(1 / 255)
    return pixels
