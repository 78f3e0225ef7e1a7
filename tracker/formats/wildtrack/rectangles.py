"""rectangles.pom of the probabilistic occupancy map (Fleuret et al. 2008): the box of a person at each grid cell in each camera; writer.

There is one line for each camera and cell; cameras count from 0, and cells are positionIDs.
The line is "RECTANGLE camera cell left top right bottom", px of the first and last column and row, or "RECTANGLE camera cell notvisible".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.wildtrack.files import HIDDEN, GroundGrid
from tracker.geometry import Array, Ints
from tracker.recordings import RecordingCamera

HEIGHT, RADIUS = 1.75, 0.25
"""m: of the upright cylinder that models a person."""
CORNERS = 8
"""Points around each end of the cylinder."""
MIN_DEPTH = 0.2
"""m: a cylinder with a point of smaller depth is not visible."""
CELLS_AT_ONCE = 50_000
"""Cells that are projected together, to bound the memory."""


def rectangles(camera: RecordingCamera, feet: Array) -> Ints:
    """Boxes (n, 4) px of people at feet (n, 3) m: left, top, right, bottom, clipped to the image.

    All four are −1 for people outside the image.
    """
    around = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = RADIUS * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    body = np.concatenate([ring, ring + np.array([0.0, 0.0, HEIGHT])])
    points = camera.pose.inverse().apply((feet[:, None] + body).reshape(-1, 3))
    pixels = camera.camera.pixels_from_bearings(points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9))[0]
    pixels = np.where(points[:, :1] > MIN_DEPTH, pixels, np.nan).reshape(len(feet), len(body), 2)
    last = np.array([camera.camera.width, camera.camera.height]) - 1
    low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1))
    # NaN, of points that have no pixel, is shown nowhere.
    shown = (high >= 0).all(axis=1) & (low <= last).all(axis=1)
    boxes = np.tile(np.array(HIDDEN, dtype=np.int64), (len(feet), 1))
    boxes[shown] = np.concatenate([np.clip(low[shown], 0, last), np.clip(high[shown], 0, last)], axis=1)
    return boxes


def write_rectangles(path: Path, grid: GroundGrid, cameras: Sequence[RecordingCamera], ground: Callable[[Array], Array]) -> None:
    """Write a line for each camera and cell, about 30 bytes each. ground: x, y (n, 2) m → heights (n,) m."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        for number, camera in enumerate(cameras):
            for first in range(0, grid.columns * grid.rows, CELLS_AT_ONCE):
                cells = np.arange(first, min(first + CELLS_AT_ONCE, grid.columns * grid.rows))
                positions = grid.points(cells)
                found = rectangles(camera, np.column_stack([positions, ground(positions)]))
                file.writelines(_lines(number, cells, found))


def _lines(camera: int, cells: Ints, found: Ints) -> Iterable[str]:
    for cell, (left, top, right, bottom) in zip(cells.tolist(), found.tolist(), strict=True):
        yield f"RECTANGLE {camera} {cell} notvisible\n" if left < 0 else f"RECTANGLE {camera} {cell} {left} {top} {right} {bottom}\n"
