"""Boxes of people in an image, and the choice of one box for each person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array
from tracker.geometry.image_boxes import box_overlaps

FEET = 0.15
"""Lowest share of a box that counts as the area of its feet."""
SAME_FEET = 0.45
"""Two boxes whose areas of the feet overlap by this IoU are one person already at SOFTER times the usual IoU."""
SOFTER = 0.8


@dataclass(frozen=True, eq=False)
class FoundBoxes:
    """Boxes of whole people in an image, the surest first.

    box (n, 4): left, top, width, height px. In an image that wraps, left is in [0, W) and left + width may pass W.
    probability (n,): that the box is a person at an IoU of 0.5. sigma (n, 4) px: standard deviations of left, top, right and bottom,
    or None where the network has none.
    """

    box: Array
    probability: Array
    sigma: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.box)
        set_array(self, "box", (n, 4))
        set_array(self, "probability", (n,))
        if self.sigma is not None:
            set_array(self, "sigma", (n, 4))

    @staticmethod
    def none() -> FoundBoxes:
        """No boxes."""
        return FoundBoxes(np.zeros((0, 4)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.box)

    def select(self, rows: Mask | Ints) -> FoundBoxes:
        """The boxes in `rows`."""
        return FoundBoxes(self.box[rows], self.probability[rows], None if self.sigma is None else self.sigma[rows])


def one_for_each(found: FoundBoxes, iou: float, period: float | None = None) -> FoundBoxes:
    """Non-maximum suppression: of boxes that are one person, the surest.

    Two boxes are one person if they overlap by `iou`. Where the areas of the feet overlap as well, a little less is enough.
    People who stand behind each other have feet at different heights of the image. period: width of an image that wraps, px.
    """
    return found.select(kept_rows(found.box, found.probability, iou, period))


def kept_rows(boxes: Array, score: Array, iou: float, period: float | None) -> Ints:
    """Rows of boxes (n, 4) with scores (n,) that `one_for_each` keeps, the surest first."""
    order = np.lexsort((boxes[:, 0], boxes[:, 1], -score))
    left, top, width, height = boxes[order].T
    box = np.column_stack([left, top, left + width, top + height])
    feet = np.column_stack([left, top + (1 - FEET) * height, left + width, top + height])
    alive, kept = np.ones(len(box), dtype=bool), []
    for k in range(len(box)):
        if not alive[k]:
            continue
        kept.append(k)
        overlap, stand = (box_overlaps(edges[k : k + 1], edges[k + 1 :], period)[0] for edges in (box, feet))
        same = (overlap > iou) | ((overlap > SOFTER * iou) & (stand > SAME_FEET))
        alive[k + 1 :] &= ~same
    return np.asarray(order[np.array(kept, dtype=np.int64)])
