"""Pictures of a twin beside its source: one frame of a view in both, with boxes of people."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from sim.datasets.twin_sources import TrueMotion
from sim.visualization.overlays import colour_of, save_png
from tracker.geometry import Array, Image, Ints
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes

DARK = 24
"""Grey value of the margins."""


def draw_twin(motion: TrueMotion, folder: Path) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the source has neither boxes nor images of its cameras and frames.

    The left image is the twin's, the right one the source's, where there is one. Boxes of both are annotated ones of the source, where these are
    known; the twin's own boxes of whole bodies are then thick. Otherwise both have the true boxes of the twin.
    View and frame are those with most people. Raises ValueError where an image of the source cannot be read.
    """
    own = read_boxes(folder)
    shown = motion.boxes or {key: (boxes.person, boxes.full) for key, boxes in own.items() if key[1] in motion.images}
    for frame, name in sorted(shown, key=lambda key: (-len(shown[key][0]), key)):
        camera, (ids, edges) = motion.cameras[name].camera, shown[frame, name]
        source = motion.images.get(name)
        real = None if source is None else next(source.cut(frame, frame + 1).images(1, (camera.height, camera.width)), None)
        if real is None and not motion.boxes:
            continue
        thin, image, note = max(1, camera.width // 900), _image_of(folder, frame, name), "the twin's true boxes"
        if motion.boxes:
            boxes, note = own.get((frame, name), Boxes.none()), "annotated boxes"
            image = _boxed(image, boxes.person, boxes.full, 2 * thin)
        pictures = [_titled(_boxed(image, ids, edges, thin), f"twin, {name}, frame {frame}{': own boxes thick' if motion.boxes else ''}")]
        pictures += [] if real is None else [_titled(_boxed(real, ids, edges, thin), f"the source, with {note}")]
        padded = [cv2.copyMakeBorder(p, 0, 0, 0, 6, cv2.BORDER_CONSTANT, value=(DARK,) * 3).astype(np.uint8) for p in pictures]
        save_png(folder / "twin.png", np.hstack(padded))
        return folder / "twin.png"
    return None


def _image_of(folder: Path, frame: int, camera: str) -> Image:
    tick = next(islice(read_sequence(folder).ticks, frame, None))
    image = next(view.image for view in tick.views if view.camera == camera)
    assert image is not None
    return image


def _boxed(image: Image, ids: Ints, boxes: Array, thickness: int) -> Image:
    """A copy of the image with boxes (n, 4): left, top, right, bottom, px, in the colours of their people."""
    out = np.ascontiguousarray(image).copy()
    for person, edges in zip(ids.tolist(), boxes.tolist(), strict=True):
        left, top, right, bottom = (round(edge) for edge in edges)
        cv2.rectangle(out, (left, top), (right - 1, bottom - 1), colour_of(person), thickness)
    return out


def _titled(image: Image, title: str) -> Image:
    """The image under a line of text."""
    out = cv2.copyMakeBorder(image, 30, 0, 0, 0, cv2.BORDER_CONSTANT, value=(DARK,) * 3)
    cv2.putText(out, title, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (235, 235, 235), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)
