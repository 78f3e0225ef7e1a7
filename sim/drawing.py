"""The truth of a view drawn on its image: boxes of what is seen and of whole bodies, key points and the bones between them."""

from __future__ import annotations

import cv2
import numpy as np

from sim.pictures import colour_of
from tracker.annotations import HIDDEN, VISIBLE, ViewTruth
from tracker.geometry import Array
from tracker.measurements import Image

BONES = (
    (0, 1), (0, 2), (1, 3), (2, 4), (5, 6), (5, 7), (7, 9), (6, 8), (8, 10), (5, 11), (6, 12), (11, 12),
    (11, 13), (13, 15), (12, 14), (14, 16),
)  # fmt: skip
"""Pairs of key points, after COCO's skeleton."""


def draw_truth(image: Image, view: ViewTruth, seam: bool) -> Image:
    """Copy of a view's image with its truth: thick what is seen of each person, thin the whole body; key points that are visible as dots,
    hidden ones as rings. seam: the image is a panorama, and what lies over its seam is drawn on both sides.
    """
    out = np.ascontiguousarray(image).copy()
    shifts = (-image.shape[1], 0, image.shape[1]) if seam else (0,)
    points = {int(p): k for k, p in enumerate(view.keypoints.person)}
    for k, person in enumerate(view.boxes.person.tolist()):
        colour = colour_of(person)
        for shift in shifts:
            _box(out, view.boxes.full[k] + [shift, 0, shift, 0], colour, 1)
            if view.boxes.visible[k] > 0:
                _box(out, view.boxes.seen[k] + [shift, 0, shift, 0], colour, 2)
        if person in points:
            row = points[person]
            _body(out, view.keypoints.pixels[row], view.keypoints.visibility[row], shifts)
    return out


def _box(image: Image, edges: Array, colour: tuple[int, int, int], thick: int) -> None:
    left, top, right, bottom = edges.round().astype(int).tolist()
    cv2.rectangle(image, (left, top), (right - 1, bottom - 1), colour, thick)


def _body(image: Image, pixels: Array, visibility: Array, shifts: tuple[int, ...]) -> None:
    there = visibility > 0
    if not there.any():
        return
    # All of one body on one side of the seam.
    u = pixels[:, 0].copy()
    if len(shifts) > 1:
        first, width = u[there][0], image.shape[1]
        u = first + np.mod(u - first + width / 2, width) - width / 2
    for shift in shifts:
        at = np.column_stack([u + shift, pixels[:, 1]]).astype(int).tolist()
        for a, b in BONES:
            if there[a] and there[b]:
                cv2.line(image, at[a], at[b], (255, 255, 255), 1, cv2.LINE_AA)
        for k in np.flatnonzero(there):
            colour = {VISIBLE: (60, 255, 60), HIDDEN: (255, 60, 60)}[int(visibility[k])]
            cv2.circle(image, at[k], 2, colour, -1 if visibility[k] == VISIBLE else 1, cv2.LINE_AA)
