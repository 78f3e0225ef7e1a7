"""A picture of the twin of a recording beside its source: one frame of a view in both, with the true boxes of the twin."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np

from sim.datasets.pets_twin_picture import beside, boxed, titled
from sim.datasets.recorded_twin import TrueMotion
from sim.visualization.overlays import save_png
from tracker.geometry import Image
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes


def side_by_side(motion: TrueMotion, folder: Path) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the source has no image of the twin's cameras and frames.

    View and frame are those with most people among the images that are there. Boxes are the true ones of the twin, in both images.
    Raises ValueError where an image of the source cannot be read.
    """
    boxes = read_boxes(folder)
    for frame, name in sorted(boxes, key=lambda key: (-len(boxes[key].person), key)):
        if name not in motion.images:
            continue
        camera = motion.cameras[name].camera
        real = next(motion.images[name].cut(frame, frame + 1).images(1, (camera.height, camera.width)), None)
        if real is None:
            continue
        tick = next(islice(read_sequence(folder).ticks, frame, None))
        image = next(view.image for view in tick.views if view.camera == name)
        assert image is not None
        truth = boxes[frame, name]
        pictures = [_with_boxes(image, truth, f"twin, {name}, frame {frame}"), _with_boxes(real, truth, "the source, with the twin's true boxes")]
        save_png(folder / "twin.png", beside(pictures))
        return folder / "twin.png"
    return None


def _with_boxes(image: Image, truth: Boxes, title: str) -> Image:
    out = np.ascontiguousarray(image).copy()
    for person, edges in zip(truth.person.tolist(), truth.full.tolist(), strict=True):
        boxed(out, edges, person, max(1, image.shape[1] // 900))
    return titled(out, title)
