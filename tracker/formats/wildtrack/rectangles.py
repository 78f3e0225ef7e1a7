"""rectangles.pom of the probabilistic occupancy map (Fleuret et al. 2008): the box of a person at each grid cell in each camera; writer.

There is one line for each camera and cell; cameras count from 0, and cells are positionIDs.
The line is "RECTANGLE camera cell left top right bottom", px of the first and last column and row, or "RECTANGLE camera cell notvisible".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.wildtrack.files import HIDDEN, GroundGrid, OpenCvCamera
from tracker.geometry import Array, Ints

HEIGHT, RADIUS = 1.75, 0.25
"""m: of the upright cylinder that models a person."""
CORNERS = 8
"""Points around each end of the cylinder."""
MIN_DEPTH = 0.2
"""m: a cylinder with a point of smaller depth is not visible."""
CELLS_AT_ONCE = 50_000
"""Cells that are projected together, to bound the memory."""


def rectangles(camera: OpenCvCamera, feet: Array, size: tuple[int, int]) -> Ints:
    """Boxes (n, 4) px of people at feet (n, 3) m: left, top, right, bottom, clipped to the image of size (height, width).

    All four are −1 for people outside the image.
    """
    around = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = RADIUS * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    body = np.concatenate([ring, ring + np.array([0.0, 0.0, HEIGHT])])
    points = feet[:, None] + body
    in_front = (camera.depths(points.reshape(-1, 3)) > MIN_DEPTH).reshape(len(feet), -1).all(axis=1)
    boxes = np.tile(np.array(HIDDEN, dtype=np.int64), (len(feet), 1))
    pixels = camera.pixels(points[in_front].reshape(-1, 3)).reshape(-1, len(body), 2)
    last = np.array(size[::-1]) - 1
    low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1))
    shown = (high >= 0).all(axis=1) & (low <= last).all(axis=1)
    edges = np.concatenate([np.clip(low, 0, last), np.clip(high, 0, last)], axis=1).astype(np.int64)
    boxes[np.flatnonzero(in_front)[shown]] = edges[shown]
    return boxes


def write_rectangles(path: Path, grid: GroundGrid, cameras: Sequence[OpenCvCamera], size: tuple[int, int], ground: Callable[[Array], Array]) -> None:
    """Write a line for each camera and cell, about 30 bytes each. ground: x, y (n, 2) m → heights (n,) m."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        for number, camera in enumerate(cameras):
            for first in range(0, grid.columns * grid.rows, CELLS_AT_ONCE):
                cells = np.arange(first, min(first + CELLS_AT_ONCE, grid.columns * grid.rows))
                positions = grid.points(cells)
                found = rectangles(camera, np.column_stack([positions, ground(positions)]), size)
                file.writelines(_lines(number, cells, found))


def _lines(camera: int, cells: Ints, found: Ints) -> Iterable[str]:
    for cell, (left, top, right, bottom) in zip(cells.tolist(), found.tolist(), strict=True):
        yield f"RECTANGLE {camera} {cell} notvisible\n" if left < 0 else f"RECTANGLE {camera} {cell} {left} {top} {right} {bottom}\n"
