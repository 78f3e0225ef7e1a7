"""A picture of a detector's scores: the reliability of the scores, how many boxes have them, and precision over recall."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np

from tracker.io.atomic import new_file
from tracker.metrics.box_detection import BINS, JudgedBoxes, reliability

DPI = 110
SHARE, COUNT = "#0072b2", "#999999"


def draw_reliability(judged: JudgedBoxes, path: Path) -> None:
    """Write the picture as PNG. judged: boxes at an IoU of 0.5. Raises OSError where the file cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure: Any = matplotlib.figure.Figure(figsize=(10, 4.6), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    found = reliability(judged)
    if found is None:
        left.text(0.5, 0.5, "scores are no probabilities", ha="center", va="center", transform=left.transAxes)
    else:
        middles = (np.arange(BINS) + 0.5) / BINS
        left.plot([0, 1], [0, 1], color="0.6", linewidth=1)
        left.bar(middles, found.boxes / max(found.boxes.max(), 1), 0.9 / BINS, color=COUNT, alpha=0.35, label="boxes, most common = 1")
        left.plot(found.score, found.share, "o-", color=SHARE, label="share of boxes that are bodies")
        left.legend(loc="upper left")
        left.set(title=f"reliability, expected calibration error {found.expected_error:.3f}")
    left.set(xlabel="score", ylabel="share", xlim=(0, 1), ylim=(0, 1.02))
    order = np.argsort(-judged.score, kind="stable")
    hits = np.cumsum(judged.hit[order])
    right.plot(hits / max(judged.bodies.sum(), 1), hits / np.arange(1, len(order) + 1), color=SHARE)
    title = f"average precision {judged.average_precision():.3f} at IoU 0.5"
    right.set(xlabel="recall", ylabel="precision", xlim=(0, 1), ylim=(0, 1.02), title=title)
    for axis in (left, right):
        axis.grid(alpha=0.25)
    canvas.draw()
    with new_file(path) as part:
        figure.savefig(part, format="png", dpi=DPI, facecolor="white")
