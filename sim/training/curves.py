"""Pictures of a training: the parts of the loss, the reliability of the scores, precision over recall, and frames with boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import matplotlib.figure
import numpy as np

from sim.training.evaluation import SEEN, FoundImage, heights_of, judged
from sim.training.optimization import PARTS
from sim.training.scene_rendering import ImageSet
from tracker.geometry import Array
from tracker.geometry.image_boxes import edges_of
from tracker.io.atomic import new_file
from tracker.metrics.box_detection import WantedBodies

DPI, SHOWN = 110, (480, 360)

LINES = ((80, 200, 60), 2), ((30, 130, 255), 2), ((60, 220, 240), 1)
"""BGR and width, px, of bodies, of found boxes and of their visible parts."""


def draw_curves(rows: list[tuple[float, ...]], kinds: dict[str, list[FoundImage]], calibration: tuple[Array, Array, float], file: Path) -> None:
    """Write the page as PNG. rows: of the curve. kinds: kind of image → held-out images. calibration: logits, probabilities, overlap."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure: Any = matplotlib.figure.Figure(figsize=(15, 4.6), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    loss, precision, reliability = figure.subplots(1, 3)
    table = np.array(rows)
    for k, name in enumerate(PARTS, 1):
        loss.semilogy(table[:, 0], np.maximum(table[:, k], 1e-3), label=name)
    loss.set(xlabel="step", title="parts of the loss")
    loss.legend()
    for kind, images in kinds.items():
        low, high = heights_of(kind)
        logits, hits, count = judged(images, WantedBodies((low, high), SEEN), calibration[2])
        order = np.argsort(-logits, kind="stable")
        right = np.cumsum(hits[order])
        precision.plot(right / max(count, 1), right / np.arange(1, len(order) + 1), label=f"{kind}, {count} bodies, {low:.0f}-{high:.0f} px")
        score = np.interp(logits, calibration[0], calibration[1])
        which = np.minimum((score * 10).astype(int), 9)
        shown = [k for k in range(10) if (which == k).sum() >= 10]
        reliability.plot([score[which == k].mean() for k in shown], [hits[which == k].mean() for k in shown], "o-", label=kind)
    precision.set(xlabel="recall", ylabel="precision", xlim=(0, 1), ylim=(0, 1.02), title="held-out worlds, seen at least by half")
    reliability.plot([0, 1], [0, 1], color="0.6")
    reliability.set(xlabel="score", ylabel="share of bodies", title="reliability of the scores")
    for axis in (precision, reliability):
        axis.legend()
    canvas.draw()
    with new_file(file) as part:
        figure.savefig(part, dpi=DPI)


def draw_frames(shown: list[tuple[ImageSet, int, FoundImage]], calibration: tuple[Array, Array, float], file: Path, least: float = 0.5) -> None:
    """Write images as PNG: bodies seen at least by half in green, boxes with a score of at least `least` in orange.

    Visible parts of these boxes are yellow. shown: set, index, boxes.
    """
    pictures = []
    for images, index, image in shown:
        picture = np.ascontiguousarray(np.asarray(images.colour[index])[..., ::-1])
        found = image.suppressed(calibration[2])
        found = found.select(np.interp(found.score, calibration[0], calibration[1]) >= least)
        drawn = image.boxes[image.visible >= 0.5], edges_of(found.box), edges_of(found.visible)
        for boxes, (colour, wide) in zip(drawn, LINES, strict=True):
            for left, top, right, bottom in np.rint(boxes).astype(int).tolist():
                cv2.rectangle(picture, (left, top), (right, bottom), colour, wide)
        pictures.append(cv2.resize(picture, SHOWN, interpolation=cv2.INTER_AREA))
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % 2)
    with new_file(file) as part:
        cv2.imwrite(str(part), np.vstack([np.hstack(pictures[k : k + 2]) for k in range(0, len(pictures), 2)]))
