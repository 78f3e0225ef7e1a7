"""The images in which people are searched: those of videos, of folders of images, and of sequences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tracker.geometry import Image
from tracker.io.image_files import decode_image, image_size
from tracker.io.video_files import open_video
from tracker.person_detector.detected_ticks import sites_of
from tracker.person_detector.detector import CameraPlace
from tracker.person_detector.pixels import MOST_PIXELS
from tracker.types import Sequence

PICTURES = (".jpg", ".jpeg", ".png")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg")
FASTEST = 1000.0
"""Frames a second that a video may name."""


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """An image of a camera: frame from 0, camera, image (H, W, 3) RGB, what is known of the camera's place, and the images of a second."""

    frame: int
    camera: str
    image: Image
    site: CameraPlace
    rate: float = 10.0


def is_pictures(path: Path) -> bool:
    """Whether `path` is a video, an image, or a folder with images or videos in it."""
    if path.is_file():
        return path.suffix.lower() in (*PICTURES, *VIDEOS)
    return path.is_dir() and any(one.suffix.lower() in (*PICTURES, *VIDEOS) for one in path.iterdir())


def frames_of_pictures(path: Path) -> Iterator[PictureFrame]:
    """The frames of a video, an image, or a folder. Images of a folder, in the order of their names, are one camera, and videos are one each.

    Where frames of a video change size, OpenCV scales them to the size of the first.
    Raises ValueError with the path for a damaged or too large image, and for a video that ends early.
    """
    files = _files(path)
    images = [file for file in files if file.suffix.lower() in PICTURES]
    for index, file in enumerate(images):
        yield PictureFrame(index, path.stem, _picture(file), CameraPlace())
    for file in files:
        if file.suffix.lower() in VIDEOS:
            yield from _video(file)


def number_of_pictures(path: Path) -> int:
    """About how many frames `frames_of_pictures` has: videos name a number, which may be wrong. Raises ValueError for what is no video."""
    number = 0
    for file in _files(path):
        if file.suffix.lower() in PICTURES:
            number += 1
        else:
            video = open_video(file)
            number += max(0, round(video.get(cv2.CAP_PROP_FRAME_COUNT)))
            video.release()
    return number


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(one for one in path.iterdir() if one.suffix.lower() in (*PICTURES, *VIDEOS))


def _picture(file: Path) -> Image:
    data = file.read_bytes()
    size = image_size(data)
    try:
        if size is None:
            raise ValueError("is no PNG or JPEG")
        if size[0] * size[1] > MOST_PIXELS:
            raise ValueError(f"is {size[1]} x {size[0]} px, needs at most {MOST_PIXELS} px")
        image = decode_image(data, size, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def _video(file: Path) -> Iterator[PictureFrame]:
    video, index = open_video(file), 0
    said, rate = round(video.get(cv2.CAP_PROP_FRAME_COUNT)), video.get(cv2.CAP_PROP_FPS)
    rate = rate if 0 < rate <= FASTEST else PictureFrame.rate
    try:
        while True:
            success, image = video.read()
            if not success:
                break
            yield PictureFrame(index, file.stem, np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8), CameraPlace(), rate)
            index += 1
    finally:
        video.release()
    if index < said:
        raise ValueError(f"{file}: ends after {index} of the {said} frames that it names")


def frames_of_sequence(sequence: Sequence) -> Iterator[PictureFrame]:
    """The images of all cameras of a sequence, tick by tick."""
    sites, rate = sites_of(sequence.setup), 1 / sequence.setup.period
    for tick in sequence.ticks:
        for view in tick.views:
            if view.image is not None:
                yield PictureFrame(tick.index, view.camera, view.image, sites[view.camera], rate)
