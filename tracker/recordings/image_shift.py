"""A shift of frame numbers between the images of a fixed camera and its boxes, by what moves before the background."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from tracker.geometry import Array
from tracker.recordings.calibration_errors import Finding
from tracker.recordings.images import ImageSource
from tracker.recordings.recording import FrameBoxes, RecordingCamera

SAMPLED, AT_LEAST = 150, 25
"""Frames from the first one with boxes that are looked at, and fewer tell nothing."""
WIDTH = 240
"""px to which images are scaled."""
SHIFTS = (-2, -1, 1, 2)
"""Frames by which images may be off."""
SURE, CLEARLY = 4.0, 0.03
"""Standard errors, and share of the contrast, by which another frame's boxes have to fit better."""


def shifted_images(name: str, camera: RecordingCamera, source: ImageSource, boxes: FrameBoxes) -> list[Finding]:
    """A finding where images fit the boxes of another frame clearly better. Where people hardly move, no shift is seen."""
    frames = sorted(frame for frame, (box, _) in boxes.items() if len(box))
    if len(frames) < AT_LEAST or camera.robot is not None:
        return []
    change = dict(_changes(camera, source, range(frames[0], min(frames[-1], frames[0] + SAMPLED) + 1)))
    if len(change) < AT_LEAST:
        return []
    scale = WIDTH / camera.camera.width
    fit = {shift: np.array([_inside(change[f], boxes, f + shift, scale) for f in sorted(change)]) for shift in (0, *SHIFTS)}
    gains = {shift: gain for shift in SHIFTS if (gain := _gain(fit[0], fit[shift])) > CLEARLY}
    if not gains:
        return []
    shift = max(gains, key=lambda one: gains[one])
    n, way = abs(shift), "low" if shift > 0 else "high"
    words = f"{name}: images look numbered {n} too {way}: image n fits the boxes of frame n {'+' if shift > 0 else '−'} {n}"
    return [Finding("images-shifted", (name,), words)]


def _changes(camera: RecordingCamera, source: ImageSource, frames: range) -> Iterator[tuple[int, Array]]:
    """Frame → absolute difference (h, w) of its small image from the median of all."""
    size, small = (camera.camera.height, camera.camera.width), dict[int, Array]()
    target = WIDTH, max(1, round(WIDTH * size[0] / size[1]))
    try:
        for frame, image in enumerate(source.images(frames.stop, size)):
            if image is not None and frame in frames:
                small[frame] = cv2.resize(image, target, interpolation=cv2.INTER_AREA).mean(axis=2)
    except ValueError:
        pass  # An image that is missing or damaged is told elsewhere.
    if small:
        background = np.median(np.array(list(small.values())), axis=0)
        yield from ((frame, np.abs(one - background)) for frame, one in small.items())


def _inside(change: Array, boxes: FrameBoxes, frame: int, scale: float) -> float:
    """Mean change within the boxes of a frame, less that of the whole image; NaN without boxes in it."""
    values = []
    for left, top, width, height in boxes.get(frame, (np.zeros((0, 4)), None))[0] * scale:
        part = change[max(0, round(top)) : max(0, round(top + height)), max(0, round(left)) : max(0, round(left + width))]
        if part.size:
            values.append(float(part.mean()))
    return float(np.mean(values) - change.mean()) if values else np.nan


def _gain(own: Array, other: Array) -> float:
    """Share of the contrast by which the other frame's boxes fit better; 0 where this is within SURE standard errors."""
    known = np.isfinite(own) & np.isfinite(other)
    if known.sum() < AT_LEAST:
        return 0.0
    better = (other - own)[known]
    error = float(better.std(ddof=1)) / np.sqrt(len(better))
    return float(better.mean()) / max(float(own[known].mean()), 1.0) if better.mean() > SURE * error else 0.0
