"""rectangles.pom, of the probabilistic occupancy map (Fleuret et al. 2008): what somebody who stands on a cell covers of every camera's image.

A line a camera and cell, cameras from 0 and cells as positionID: "RECTANGLE camera cell left top right bottom" px, the first and the last column and
row, or "RECTANGLE camera cell notvisible". Written and read side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.wildtrack import HIDDEN, Calibrated, Region
from tracker.geometry import Array, Ints

HEIGHT, RADIUS = 1.75, 0.25
"""m: of the upright cylinder that stands for a person."""
CORNERS = 8
"""Points around each end of the cylinder."""
NEAREST = 0.2
"""m before a camera; who is nearer is not visible."""
CELLS_AT_ONCE = 50_000
"""What is projected together: it bounds the memory, whatever the region."""


def rectangles(camera: Calibrated, feet: Array, size: tuple[int, int]) -> Ints:
    """(n, 4) px: left, top, right, bottom of people at feet (n, 3) m, cut at the image of size (height, width).

    All −1 where it shows nothing of them.
    """
    around = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = RADIUS * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    body = np.concatenate([ring, ring + np.array([0.0, 0.0, HEIGHT])])
    points = feet[:, None] + body
    before = (camera.depths(points.reshape(-1, 3)) > NEAREST).reshape(len(feet), -1).all(axis=1)
    out = np.tile(np.array(HIDDEN, dtype=np.int64), (len(feet), 1))
    pixels = camera.pixels(points[before].reshape(-1, 3)).reshape(-1, len(body), 2)
    last = np.array(size[::-1]) - 1
    low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1))
    shown = (high >= 0).all(axis=1) & (low <= last).all(axis=1)
    edges = np.concatenate([np.clip(low, 0, last), np.clip(high, 0, last)], axis=1).astype(np.int64)
    out[np.flatnonzero(before)[shown]] = edges[shown]
    return out


def write_rectangles(path: Path, region: Region, cameras: Sequence[Calibrated], size: tuple[int, int], ground: Callable[[Array], Array]) -> None:
    """All cells of all cameras; ground: (n, 2) m → (n,) m, the height that people stand at. Millions of lines: some 30 bytes each."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        for number, camera in enumerate(cameras):
            for first in range(0, region.columns * region.rows, CELLS_AT_ONCE):
                cells = np.arange(first, min(first + CELLS_AT_ONCE, region.columns * region.rows))
                places = region.points(cells)
                found = rectangles(camera, np.column_stack([places, ground(places)]), size)
                file.writelines(_lines(number, cells, found))


def _lines(camera: int, cells: Ints, found: Ints) -> Iterable[str]:
    for cell, (left, top, right, bottom) in zip(cells.tolist(), found.tolist(), strict=True):
        yield f"RECTANGLE {camera} {cell} notvisible\n" if left < 0 else f"RECTANGLE {camera} {cell} {left} {top} {right} {bottom}\n"


def read_rectangles(path: Path, cameras: int, cells: int) -> Ints:
    """(cameras, cells, 4) px, all −1 where nobody shows.

    Raises ValueError, with file and line, for a line that is wrong, and where a cell is left out.
    """
    out = np.full((cameras, cells, 4), -2, dtype=np.int64)
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            try:
                camera, cell, edges = int(words[1]), int(words[2]), [int(word) for word in words[3:]] if words[3] != "notvisible" else list(HIDDEN)
                if words[0] != "RECTANGLE" or len(edges) != 4 or not (0 <= camera < cameras and 0 <= cell < cells):
                    raise ValueError
                out[camera, cell] = edges
            except (ValueError, IndexError):
                raise ValueError(f"{path}: line {number} is {line.strip()[:60]!r}, needs RECTANGLE camera cell left top right bottom") from None
    missing = np.argwhere(out[..., 0] == -2)
    if len(missing):
        raise ValueError(f"{path}: has no line of camera {missing[0][0]} and cell {missing[0][1]}")
    return out
