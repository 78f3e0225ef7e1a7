"""Parts of an image that are searched a second time at twice the size, because the network finds small bodies better there.

A part is the bounding rectangle of connected tiles with peaks of small bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.geometry import Image, Mask
from tracker.person_detector.found_boxes import FoundBoxes

SHARED = 0.85
"""Bodies above this share of the largest magnified height are also taken from the picture itself. Suppression keeps one box of each."""
TILE, MARGIN, SLACK = 32, 52, 6
"""px: side of a tile, margin that is magnified around a part, and largest distance of a body outside it that belongs to it.

The margin holds half of the tallest body that is magnified (MAGNIFIED in search_levels.py) and the slack.
"""
MOST_AREA = 1 << 20
"""px²: larger parts are divided, so that the memory is bounded."""
ENDS = 2.0
"""px: a body whose edge is nearer to an inner side of a magnified part may be cut there."""
LARGEST_SHARE = 1.0
"""Largest area of all parts with their margins, as a share of the picture; it determines the time."""


@dataclass(frozen=True)
class Part:
    """A rectangle of a picture, px: `core` holds the middles of its bodies, `seen` is what is magnified. Both are left, top, right, bottom."""

    core: tuple[int, int, int, int]
    seen: tuple[int, int, int, int]

    @property
    def area(self) -> int:
        """Area of `seen`, px²."""
        left, top, right, bottom = self.seen
        return (right - left) * (bottom - top)

    def whole(self, peaks: FoundBoxes, height: int) -> Mask:
        """Which boxes (n,) do not end with `seen` above or below, inside of the image, which is `height` px high."""
        _, top, _, bottom = self.seen
        cut_above, cut_below = peaks.box[:, 1] < top + ENDS, peaks.box[:, 1] + peaks.box[:, 3] > bottom - ENDS
        return np.asarray(~(cut_above & (top > 0) | cut_below & (bottom < height)))

    def holds(self, peaks: FoundBoxes, slack: float = 0.0) -> Mask:
        """Which peaks (n,) have their middles in the core, or at most `slack` px beside it."""
        x, y = peaks.middle.T
        left, top, right, bottom = self.core
        return np.asarray((x >= left - slack) & (x < right + slack) & (y >= top - slack) & (y < bottom + slack))

    def cut_out(self, image: Image) -> Image:
        """`seen` of an image (H, W, 3), at twice its size; columns beyond the seam are those of the other side."""
        left, top, right, bottom = self.seen
        part = image[top:bottom].take(np.arange(left, right) % image.shape[1], axis=1)
        return np.asarray(cv2.resize(part, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR), np.uint8)


def magnified_parts(small: FoundBoxes, shape: tuple[int, ...], wraps: bool) -> list[Part]:
    """The parts of an image of shape (H, W, …) with peaks of small bodies, those with the highest peak first, up to LARGEST_SHARE of the image."""
    height, width = shape[:2]
    if not len(small):
        return []
    tiles = np.zeros((-(-height // TILE), -(-width // TILE)), np.uint8)
    column, row = (small.middle // TILE).astype(int).T
    column = column % tiles.shape[1] if wraps else np.clip(column, 0, tiles.shape[1] - 1)
    row = np.clip(row, 0, tiles.shape[0] - 1)
    tiles[row, column] = 1
    count, label, boxes, _ = cv2.connectedComponentsWithStats(tiles, connectivity=4)
    surest = np.full(count, -np.inf)
    np.maximum.at(surest, label[row, column], small.score)
    out, left = [], LARGEST_SHARE * height * width
    for k in (1 + np.argsort(-surest[1:], kind="stable")).tolist():
        parts = _parts(boxes[k, :4].tolist(), (width, height), wraps)
        area = sum(part.area for part in parts)
        if area <= left:
            out += parts
            left -= area
    return out


def _parts(tiles: list[int], size: tuple[int, int], wraps: bool) -> list[Part]:
    """The parts of a rectangle of tiles (column, row, number of columns and rows), one if it is small."""
    across, down, columns, rows = tiles
    part = _part(tiles, size, wraps)
    if part.area <= MOST_AREA or columns == rows == 1:
        return [part]
    if columns > rows:
        halves = [across, down, columns // 2, rows], [across + columns // 2, down, columns - columns // 2, rows]
    else:
        halves = [across, down, columns, rows // 2], [across, down + rows // 2, columns, rows - rows // 2]
    return [one for half in halves for one in _parts(half, size, wraps)]


def _part(tiles: list[int], size: tuple[int, int], wraps: bool) -> Part:
    """The part of a rectangle of tiles: column, row, number of columns and rows."""
    across, down, columns, rows = tiles
    core = across * TILE, down * TILE, min((across + columns) * TILE, size[0]), min((down + rows) * TILE, size[1])
    seen = core[0] - MARGIN, max(core[1] - MARGIN, 0), core[2] + MARGIN, min(core[3] + MARGIN, size[1])
    if not wraps:
        seen = max(seen[0], 0), seen[1], min(seen[2], size[0]), seen[3]
    return Part(core, seen)
