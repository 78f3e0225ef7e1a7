"""Visible parts of found people: the part of a box that nearer people do not cover, by the order of their feet in the image.

The network finds whole bodies only. A person with lower feet is nearer, and the middle of that person's box hides what is behind it.
So occlusion by people is modelled. People behind furniture, walls and things count as fully visible.
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array

BODY = 0.5
"""Share of the width of a box that a body fills, whether it covers or is covered."""
SAMPLES = (25, 41)
"""Points of a box, across and down, at which it is covered or not."""
COVERED = 0.8
"""Probability of being covered from which a point is outside the visible box. Cutting off a visible edge costs more than keeping a hidden one."""


def visible_parts(box: Array, score: Array, period: float | None) -> tuple[Array, Array]:
    """The visible parts of boxes (n, 4) left, top, width, height px with probabilities (n,) that they are people.

    Returns boxes (n, 4) px around the visible part of each, the whole box if nothing is visible, and the visible share (n,) of the body.
    period: width of an image that wraps, px.
    """
    across, down = ((np.arange(count) + 0.5) / count for count in SAMPLES)
    body = np.abs(across - 0.5) <= BODY / 2
    parts, shares, bottom = np.array(box), np.ones(len(box)), box[:, 1] + box[:, 3]
    for k, (left, top, width, height) in enumerate(box.tolist()):
        nearer = np.flatnonzero(bottom > bottom[k])
        middle = box[nearer, 0] + box[nearer, 2] / 2
        apart = (left + across * width)[:, None] - middle
        if period is not None:
            apart -= period * np.round(apart / period)
        columns = np.abs(apart) < BODY / 2 * box[nearer, 2]
        rows = (top + down * height)[:, None]
        rows = (rows > box[nearer, 1]) & (rows < bottom[nearer])
        seen = np.prod(1 - score[nearer] * (rows[:, None] & columns[None]), axis=2)
        shares[k] = seen[:, body].mean()
        open_ = seen > 1 - COVERED
        if open_.any():
            (first, last), (upper, lower) = (_ends(open_.any(axis=axis)) for axis in (0, 1))
            parts[k] = left + first * width, top + upper * height, (last - first) * width, (lower - upper) * height
    return parts, shares


def _ends(open_: Array) -> tuple[float, float]:
    """First and end of the open cells of a line of cells, as shares of its length."""
    rows = np.flatnonzero(open_)
    return rows[0] / len(open_), (rows[-1] + 1) / len(open_)
