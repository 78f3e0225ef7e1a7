"""Training targets of a crop: the desired output of the network in every cell, from boxes of whole bodies.

The heat of a body is a Gaussian whose axes follow the box (Liu et al. 2020, TTFNet); its peak is 1 in the cell of the centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from tracker.person_detector.found_boxes import hidden_shares

STRIDE = 4
"""px: edge of a cell."""
SPREAD, NARROWEST = 0.54 / 6, 0.35
"""Sigma of the heat as a share of the box, and its lower bound in cells."""
EDGE_HEAT = 0.2
"""Least heat of a cell whose edges are trained."""
LEAST_VISIBLE, HIDDEN = 0.1, 0.03
"""Least visible share of a body to be found. Bodies with less are ignored; those below HIDDEN count as background."""
WEIGHTS = (0.1, 0.5), (0.7, 1.0)
"""Visible shares, and the weights of bodies at these shares: where little is seen, the extent of the whole body is uncertain."""
LEAST_INSIDE = 0.2
"""Least share of a body's box inside of the crop for it to be found."""
LEAST_HEIGHT = 11.0
"""px: smaller bodies are ignored."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of a crop of S px, on S/4 x S/4 cells.

    heat (1, h, w) in [0, 1]. counted (1, h, w): 0 where a cell without a body is ignored, else 1.
    worth (1, h, w): weight of the score where heat is 1, else 0. edges (4, h, w): distances px from the cell's centre to left, top, right and
    bottom. weight (1, h, w): of the edges, 0 for none. All cells of a body together weigh its worth by the logarithm of its area in cells.
    So near bodies do not outweigh the many far ones. hidden (4, h, w): shares of the box beyond the visible part at left, top, right and bottom.
    """

    heat: NDArray[np.float32]
    counted: NDArray[np.float32]
    worth: NDArray[np.float32]
    edges: NDArray[np.float32]
    weight: NDArray[np.float32]
    hidden: NDArray[np.float32]


def targets_of(boxes: Array, visible: Array, size: int, seen: Array | None = None) -> Targets:
    """Targets for bodies with boxes (n, 4) px and visible shares (n,) in a crop of `size` px.

    seen (n, 4): left, top, right, bottom px of the visible part of each, the whole box by default.
    Boxes end at the border of the crop, as true and found boxes end at the border of an image.
    """
    cells = size // STRIDE
    heat, counted, worth = np.zeros((cells, cells), np.float32), np.ones((cells, cells), np.float32), np.zeros((cells, cells), np.float32)
    edges, weight = np.ones((4, cells, cells), np.float32), np.zeros((cells, cells), np.float32)
    hidden = np.zeros((4, cells, cells), np.float32)
    centres = (np.arange(cells, dtype=np.float32) + 0.5) * STRIDE
    inside = areas(np.clip(boxes, 0, size)) / np.maximum(areas(boxes), 1e-9)
    boxes = np.clip(boxes, 0, size)
    beyond = np.zeros(boxes.shape) if seen is None else hidden_shares(boxes, np.clip(seen, 0, size))
    skipped = (inside < LEAST_INSIDE) | (visible < LEAST_VISIBLE) | (boxes[:, 3] - boxes[:, 1] < LEAST_HEIGHT)
    for box, share in zip(boxes[skipped], visible[skipped], strict=True):
        left, top, right, bottom = np.clip(np.rint(box / STRIDE), 0, cells).astype(int)
        if share >= HIDDEN:
            counted[top : bottom + 1, left : right + 1] = 0
    for box, worthy, share in zip(boxes[~skipped], np.interp((visible * inside)[~skipped], *WEIGHTS), beyond[~skipped], strict=True):
        middle, extent = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
        column, row = np.minimum(middle // STRIDE, cells - 1).astype(int)
        sigma = np.maximum(SPREAD * extent, NARROWEST * STRIDE)
        across = np.exp(-((centres - (column + 0.5) * STRIDE) ** 2) / (2 * sigma[0] ** 2))
        along = np.exp(-((centres - (row + 0.5) * STRIDE) ** 2) / (2 * sigma[1] ** 2))
        own = np.outer(along, across).astype(np.float32)
        best = (own > heat) & (own >= EDGE_HEAT)
        rows, columns = np.nonzero(best)
        x, y = centres[columns], centres[rows]
        edges[:, rows, columns] = np.maximum(np.stack([x - box[0], y - box[1], box[2] - x, box[3] - y]), 0.5)
        importance = worthy * np.log(max(extent.prod() / STRIDE**2, 2.0))
        weight[rows, columns] = importance * own[rows, columns] / own[own >= EDGE_HEAT].sum()
        hidden[:, rows, columns] = share[:, None]
        worth[row, column] = max(worth[row, column], worthy)
        np.maximum(heat, own, out=heat)
    return Targets(heat[None], counted[None], worth[None], edges, weight[None], hidden)


def areas(boxes: Array) -> Array:
    """Areas (n,) px² of boxes (n, 4) left, top, right, bottom."""
    return np.asarray(np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0), axis=1))
