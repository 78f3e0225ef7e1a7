"""A picture of a PETS 2009 twin beside the recording: one frame of View_001 in both, with the annotated boxes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from sim.datasets.pets_twin import ANNOTATED, Twin, annotated_frames
from sim.visualization.overlays import colour_of, save_png
from tracker.geometry import Array, Image
from tracker.io.video_files import open_video
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes

NAME = f"View_{ANNOTATED:03d}"
DARK = 24
"""Grey value of the margins."""


def side_by_side(twin: Twin, folder: Path, video: Path | None = None) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the twin has no View_001.

    The left image is the twin's. True boxes of whole bodies are thick and annotated boxes thin, in the colour of each person.
    The right image is the same frame of `video`, the real View_001, with the annotated boxes. It is left out without a video. The frame is the
    one with the most people. video: where None, S2.L1/video/View_001.mp4 for S2.L1/annotations/*.xml.
    """
    if ANNOTATED not in twin.views:
        return None
    annotations = annotated_frames(twin)
    frame = max(annotations, key=lambda k: (len(annotations[k][0]), -k))
    ids, boxes = annotations[frame]
    tick = next(islice(read_sequence(folder).ticks, frame, None))
    image = next(view.image for view in tick.views if view.camera == NAME)
    assert image is not None
    truth = read_boxes(folder).get((frame, NAME))
    left = image.copy()
    if truth is not None:
        for person, (x0, y0, x1, y1) in zip(truth.person.tolist(), truth.full.tolist(), strict=True):
            boxed(left, (x0, y0, x1, y1), person, 2)
    pictures = [titled(_annotated(left, ids.tolist(), boxes), f"twin, frame {frame}: own boxes thick, annotated boxes thin")]
    video_file = twin.annotations.parent.parent / "video" / f"{NAME}.mp4" if video is None else video
    real = _frame_of(video_file, frame)
    if real is not None:
        pictures.append(titled(_annotated(real, ids.tolist(), boxes), f"PETS 2009 {NAME}, the same frame: annotated boxes"))
    path = folder / "twin.png"
    save_png(path, beside(pictures))
    return path


def beside(pictures: list[Image]) -> Image:
    """Pictures side by side, with dark margins."""
    height = max(len(picture) for picture in pictures)
    pictures = [cv2.copyMakeBorder(p, 0, height - len(p), 0, 6, cv2.BORDER_CONSTANT, value=(DARK,) * 3).astype(np.uint8) for p in pictures]
    return np.hstack(pictures)


def _annotated(image: Image, ids: list[int], boxes: Array) -> Image:
    """A copy of the image with boxes (n, 4): left, top, width, height, px. Pixel centres lie at whole numbers."""
    out = image.copy()
    for person, (left, top, width, height) in zip(ids, boxes.tolist(), strict=True):
        boxed(out, (left + 0.5, top + 0.5, left + width + 0.5, top + height + 0.5), person, 1)
    return out


def boxed(image: Image, edges: Sequence[float], person: int, thickness: int) -> None:
    """Draw the edges left, top, right, bottom px of a person's box, in place."""
    left, top, right, bottom = (round(edge) for edge in edges)
    cv2.rectangle(image, (left, top), (right - 1, bottom - 1), colour_of(person), thickness)


def titled(image: Image, title: str) -> Image:
    """The image under a line of text."""
    out = cv2.copyMakeBorder(image, 30, 0, 0, 0, cv2.BORDER_CONSTANT, value=(DARK,) * 3)
    cv2.putText(out, title, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (235, 235, 235), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)


def _frame_of(video_file: Path, number: int) -> Image | None:
    """The frame of a video, RGB, or None where the video or the frame is missing."""
    if not video_file.is_file():
        return None
    reader = open_video(video_file)
    try:
        reader.set(cv2.CAP_PROP_POS_FRAMES, number)
        found, picture = reader.read()
    finally:
        reader.release()
    return np.ascontiguousarray(picture[:, :, ::-1], dtype=np.uint8) if found else None
