"""Pictures of a twin beside its source: one frame of a view in both, with boxes of people."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from sim.datasets.pets_twin import ANNOTATED, Twin, annotated_frames
from sim.datasets.recorded_twin import TrueMotion
from sim.visualization.overlays import colour_of, save_png
from tracker.geometry import Array, Image, Ints
from tracker.recordings.images import VideoFile
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes

NAME = f"View_{ANNOTATED:03d}"
DARK = 24
"""Grey value of the margins."""


def draw_pets_twin(twin: Twin, folder: Path) -> Path:
    """Write `twin.png` into the folder of a twin with View_001, and return its path.

    The left image is the twin's. True boxes of whole bodies are thick and annotated boxes thin, in the colour of each person.
    The right image is the same frame of the real View_001 with the annotated boxes; it is left out where the video is missing.
    For S2.L1/annotations/*.xml the video is S2.L1/video/View_001.mp4. The frame is the one with the most people.
    """
    annotations = annotated_frames(twin)
    frame = max(annotations, key=lambda k: (len(annotations[k][0]), -k))
    ids, boxes = annotations[frame]
    # Pixel centres of annotations lie at whole numbers.
    edges = np.column_stack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]]) + 0.5
    image, truth = _image_of(folder, frame, NAME), read_boxes(folder).get((frame, NAME))
    left = image if truth is None else _boxed(image, truth.person, truth.full, 2)
    pictures = [_titled(_boxed(left, ids, edges, 1), f"twin, frame {frame}: own boxes thick, annotated boxes thin")]
    video = twin.annotations.parent.parent / "video" / f"{NAME}.mp4"
    if video.is_file():
        (real,) = VideoFile(video, frame).images(1, image.shape[:2])
        assert real is not None
        pictures.append(_titled(_boxed(real, ids, edges, 1), f"PETS 2009 {NAME}, the same frame: annotated boxes"))
    return _save_beside(folder, pictures)


def draw_recorded_twin(motion: TrueMotion, folder: Path) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the source has no image of the twin's cameras and frames.

    View and frame are those with most people among the images that are there. Boxes are the true ones of the twin, in both images.
    Raises ValueError where an image of the source cannot be read.
    """
    boxes = read_boxes(folder)
    for frame, name in sorted(boxes, key=lambda key: (-len(boxes[key].person), key)):
        if name not in motion.images:
            continue
        camera, truth = motion.cameras[name].camera, boxes[frame, name]
        real = next(motion.images[name].cut(frame, frame + 1).images(1, (camera.height, camera.width)), None)
        if real is None:
            continue
        titled = ((_image_of(folder, frame, name), f"twin, {name}, frame {frame}"), (real, "the source, with the twin's true boxes"))
        thick = max(1, camera.width // 900)
        return _save_beside(folder, [_titled(_boxed(image, truth.person, truth.full, thick), title) for image, title in titled])
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


def _save_beside(folder: Path, pictures: Sequence[Image]) -> Path:
    """Write pictures side by side, with dark margins."""
    height = max(len(picture) for picture in pictures)
    padded = [cv2.copyMakeBorder(p, 0, height - len(p), 0, 6, cv2.BORDER_CONSTANT, value=(DARK,) * 3).astype(np.uint8) for p in pictures]
    save_png(folder / "twin.png", np.hstack(padded))
    return folder / "twin.png"
