"""Boxes of people in an image, and the choice of one box for each person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array

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


def ious(one: Array, others: Array, period: float | None = None) -> Array:
    """IoU (n,) of a box (4,) with others (n, 4): left, top, width, height px. period: width of an image that wraps, px."""
    shift = others[:, 0] - one[0]
    if period is not None:
        # The nearest copy of each box, by the middles.
        middle = shift + (others[:, 2] - one[2]) / 2
        shift = shift - period * np.round(middle / period)
    across = np.minimum(shift + others[:, 2], one[2]) - np.maximum(shift, 0.0)
    up = np.minimum(others[:, 1] + others[:, 3], one[1] + one[3]) - np.maximum(others[:, 1], one[1])
    both = np.maximum(across, 0.0) * np.maximum(up, 0.0)
    return np.asarray(both / np.maximum(others[:, 2] * others[:, 3] + one[2] * one[3] - both, 1e-9))


def one_for_each(found: FoundBoxes, iou: float, period: float | None = None) -> FoundBoxes:
    """Non-maximum suppression: of boxes that are one person, the surest.

    Two boxes are one person if they overlap by `iou`. Where the areas of the feet overlap as well, a little less is enough.
    People who stand behind each other have feet at different heights of the image. period: width of an image that wraps, px.
    """
    return found.select(kept_rows(found.box, found.probability, iou, period))


def kept_rows(boxes: Array, score: Array, iou: float, period: float | None) -> Ints:
    """Rows of boxes (n, 4) with scores (n,) that `one_for_each` keeps, the surest first."""
    order = np.lexsort((boxes[:, 0], boxes[:, 1], -score))
    box = boxes[order]
    feet = np.column_stack([box[:, 0], box[:, 1] + (1 - FEET) * box[:, 3], box[:, 2], FEET * box[:, 3]])
    alive, kept = np.ones(len(box), dtype=bool), []
    for k in range(len(box)):
        if not alive[k]:
            continue
        kept.append(k)
        overlap = ious(box[k], box[k + 1 :], period)
        same = (overlap > iou) | ((overlap > SOFTER * iou) & (ious(feet[k], feet[k + 1 :], period) > SAME_FEET))
        alive[k + 1 :] &= ~same
    return np.asarray(order[np.array(kept, dtype=np.int64)])
