"""Training targets of a crop: the desired output of the network in every cell, from boxes of whole bodies.

The heat of a body is a Gaussian whose axes follow the box (Liu et al. 2020, TTFNet); its peak is 1 in the cell of the centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Mask
from tracker.person_detector.found_boxes import hidden_shares

STRIDE = 4
"""px: edge of a cell."""
SPREAD, NARROWEST = 0.54 / 6, 0.35
"""Sigma of the heat as a share of the box, and its lower bound in cells."""
EDGE_HEAT = 0.2
"""Least heat of a cell whose edges are trained."""
LEAST_VISIBLE, HIDDEN = 0.1, 0.03
"""Least visible share of a body to be found. Bodies with less are ignored; those below HIDDEN count as background."""
WEIGHTS = (0.1, 0.5), (0.35, 1.0)
"""Visible shares, and the weights of bodies at these shares: where little is seen, the extent of the whole body is uncertain."""
LEAST_INSIDE, CUT_WEIGHT = 0.2, 0.5
"""Least share of a body's box inside of the crop for it to be found, and the weight of bodies cut by a border."""
LEAST_HEIGHT = 11.0
"""px: smaller bodies are ignored."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of a crop of S px, on S/4 x S/4 cells.

    heat (1, h, w) in [0, 1]. counted (1, h, w): 0 where a cell without a body is ignored, else 1.
    edges (4, h, w): distances px from the cell's centre to left, top, right and bottom. weight (1, h, w): of the edges, 0 for none;
    where heat is 1, also the weight of the score. hidden (4, h, w): shares of the box beyond the visible part at left, top, right and bottom.
    """

    heat: NDArray[np.float32]
    counted: NDArray[np.float32]
    edges: NDArray[np.float32]
    weight: NDArray[np.float32]
    hidden: NDArray[np.float32]


def targets_of(boxes: Array, visible: Array, cut: Mask, size: int, seen: Array | None = None) -> Targets:
    """Targets for bodies with boxes (n, 4) px and visible shares (n,), cut (n,) by the border of their image, in a crop of `size` px.

    seen (n, 4): left, top, right, bottom px of the visible part of each, the whole box by default.
    A body whose middle lies outside of the crop has the box of its part inside. The detector clips boxes at the border, too.
    """
    cells = size // STRIDE
    heat, counted = np.zeros((cells, cells), np.float32), np.ones((cells, cells), np.float32)
    edges, weight = np.ones((4, cells, cells), np.float32), np.zeros((cells, cells), np.float32)
    hidden = np.zeros((4, cells, cells), np.float32)
    centres = (np.arange(cells, dtype=np.float32) + 0.5) * STRIDE
    boxes, cut, inside = _within(boxes, cut, size)
    beyond = np.zeros(boxes.shape) if seen is None else hidden_shares(boxes, seen)
    skipped = (inside < LEAST_INSIDE) | (visible < LEAST_VISIBLE) | (boxes[:, 3] - boxes[:, 1] < LEAST_HEIGHT)
    worth = np.interp(visible, *WEIGHTS) * np.where(cut, CUT_WEIGHT, 1.0)
    for box, share in zip(boxes[skipped], visible[skipped], strict=True):
        left, top, right, bottom = np.clip(np.rint(box / STRIDE), 0, cells).astype(int)
        if share >= HIDDEN:
            counted[top : bottom + 1, left : right + 1] = 0
    for box, worthy, share in zip(boxes[~skipped], worth[~skipped], beyond[~skipped], strict=True):
        middle, extent = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
        column, row = np.floor(middle / STRIDE).astype(int)
        if not (0 <= column < cells and 0 <= row < cells):
            continue
        sigma = np.maximum(SPREAD * extent, NARROWEST * STRIDE)
        across = np.exp(-((centres - (column + 0.5) * STRIDE) ** 2) / (2 * sigma[0] ** 2))
        along = np.exp(-((centres - (row + 0.5) * STRIDE) ** 2) / (2 * sigma[1] ** 2))
        own = np.outer(along, across).astype(np.float32)
        best = (own > heat) & (own >= EDGE_HEAT)
        rows, columns = np.nonzero(best)
        x, y = centres[columns], centres[rows]
        edges[:, rows, columns] = np.maximum(np.stack([x - box[0], y - box[1], box[2] - x, box[3] - y]), 0.5)
        weight[rows, columns] = worthy * own[rows, columns]
        hidden[:, rows, columns] = share[:, None]
        np.maximum(heat, own, out=heat)
    return Targets(heat[None], counted[None], edges, weight[None], hidden)


def _within(boxes: Array, cut: Mask, size: int) -> tuple[Array, Mask, Array]:
    """Boxes (n, 4) px, clipped if their middle is outside the crop; whether a border cuts each (n,); and shares (n,) of their areas inside."""
    clipped = np.clip(boxes, 0, size)
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    outside: Mask = np.any((middle < 0) | (middle >= size), axis=1)
    share = np.prod(clipped[:, 2:] - clipped[:, :2], axis=1) / np.maximum(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1), 1e-9)
    return np.where(outside[:, None], clipped, boxes), cut | outside, share
