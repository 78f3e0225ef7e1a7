"""The images in which people are searched: those of videos, of folders of images, and of sequences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tracker.geometry import Image
from tracker.io.image_files import PICTURES
from tracker.io.picture_folders import READ, content_checksum, read_picture, say_order, visible_files
from tracker.io.video_files import VIDEOS, number_of_frames, open_video
from tracker.person_detector.detected_ticks import sites_of
from tracker.person_detector.detector import CameraPlace
from tracker.types import Sequence

FASTEST = 1000.0
"""Largest frame rate of a video, frames/s, that is believed."""


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """An image of a camera: frame from 0, camera, image (H, W, 3) RGB, what is known of the camera's place, and rate, images/s."""

    frame: int
    camera: str
    image: Image
    site: CameraPlace
    rate: float = 10.0


def is_pictures(path: Path) -> bool:
    """Whether `path` is a video, an image, or a folder with images or videos in it."""
    if path.is_file():
        return path.suffix.lower() in READ
    return path.is_dir() and any(one.suffix.lower() in READ and not one.name.startswith(".") for one in path.iterdir())


def frames_of_pictures(path: Path) -> Iterator[PictureFrame]:
    """The frames of a video, an image, or a folder. Images of a folder, in the order of the numbers in their names, are one camera, and each
    video is one. A camera has the name of the folder, or that of the file without its suffix.

    Where frames of a video change size, OpenCV scales them to the size of the first. Images are turned upright by EXIF orientation, with a message.
    Raises ValueError with the path for an image that cannot be decoded or is too large.
    Raises it, too, for a file that is no video, and for two cameras of one name.
    """
    cameras = _cameras(path)
    for camera, files in cameras.items():
        if files[0].suffix.lower() in VIDEOS:
            yield from _video(files[0], camera)
            continue
        for index, file in enumerate(files):
            yield PictureFrame(index, camera, read_picture(file), CameraPlace())


def _cameras(path: Path) -> dict[str, list[Path]]:
    """Camera → its image files, or its video."""
    if path.is_file():
        return {path.stem: [path]}
    files, name = visible_files(path), path.resolve().name or "images"
    images = [file for file in files if file.suffix.lower() in PICTURES]
    say_order(str(path), images)
    out = {name: images} if images else {}
    for file in files:
        if file.suffix.lower() in VIDEOS:
            if file.stem in out:
                raise ValueError(f"{file}: would be camera {file.stem}, as {out[file.stem][0].name} is; needs another name")
            out[file.stem] = [file]
    return out


def number_of_pictures(path: Path) -> int:
    """How many frames `frames_of_pictures` has, by the packets of videos. Raises ValueError for what is no video, and for a video that ends early."""
    files = [file for camera in _cameras(path).values() for file in camera]
    return sum(number_of_frames(file) if file.suffix.lower() in VIDEOS else 1 for file in files)


def pictures_checksum(path: Path) -> str:
    """A checksum of all images and videos of `frames_of_pictures`."""
    return content_checksum(file for camera in _cameras(path).values() for file in camera)


def _video(file: Path, camera: str) -> Iterator[PictureFrame]:
    video, index = open_video(file), 0
    rate = video.get(cv2.CAP_PROP_FPS)
    rate = rate if 0 < rate <= FASTEST else PictureFrame.rate
    try:
        while True:
            success, image = video.read()
            if not success:
                break
            yield PictureFrame(index, camera, np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8), CameraPlace(), rate)
            index += 1
    finally:
        video.release()


def frames_of_sequence(sequence: Sequence) -> Iterator[PictureFrame]:
    """The images of all cameras of a sequence, tick by tick."""
    sites, rate = sites_of(sequence.setup), 1 / sequence.setup.period
    for tick in sequence.ticks:
        for view in tick.views:
            if view.image is not None:
                yield PictureFrame(tick.index, view.camera, view.image, sites[view.camera], rate)
