"""Files of places that tests write from formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
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
