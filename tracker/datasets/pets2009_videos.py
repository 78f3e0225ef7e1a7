"""Videos beside a PETS 2009 folder as images of its sequence: video/View_00N.mp4, one frame per tick."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from tracker.geometry import Image
from tracker.types import Odometry, Sequence, Tick, Ticks

FOLDER = "video"


class VideoReader:
    """Reads the frames of a video in order. Raises ValueError where it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.path, self._frames, self._video = path, 0, cv2.VideoCapture(str(path))
        if not self._video.isOpened():
            raise ValueError(f"{path}: is no video that OpenCV can read")

    def next(self) -> Image:
        """The next frame (H, W, 3) uint8 RGB. Raises ValueError at the end of the video."""
        success, frame = self._video.read()
        if not success:
            raise ValueError(f"{self.path}: has {self._frames} frames, the detections go on")
        self._frames += 1
        return np.asarray(frame[:, :, ::-1], dtype=np.uint8)

    def close(self) -> None:
        self._video.release()


@dataclass(frozen=True, eq=False)
class TicksWithVideos:
    """Ticks with images that are read from videos during iteration. files: camera → video.

    Iteration raises ValueError where a video has fewer frames than there are ticks.
    """

    ticks: Ticks
    files: dict[str, Path]

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        with ExitStack() as stack:
            readers = {camera: stack.enter_context(closing(VideoReader(path))) for camera, path in self.files.items()}
            for tick in self.ticks:
                images = {camera: reader.next() for camera, reader in readers.items()}
                yield replace(tick, views=tuple(replace(view, image=images.get(view.camera)) for view in tick.views))

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()


def with_videos(sequence: Sequence, folder: Path) -> Sequence:
    """The sequence with images from folder/video/CAMERA.mp4, for cameras with such a file. A sequence with images is returned unchanged.

    Raises ValueError where there are neither images nor videos.
    """
    first = next(iter(sequence.ticks), None)
    if first is not None and any(view.image is not None for view in first.views):
        return sequence
    files = {camera: folder / FOLDER / f"{camera}.mp4" for camera in sequence.setup.mounts}
    files = {camera: path for camera, path in files.items() if path.is_file()}
    if not files:
        raise ValueError(f"{folder}: has no images, and no {FOLDER}/CAMERA.mp4 of {', '.join(sequence.setup.mounts)}")
    return replace(sequence, ticks=TicksWithVideos(sequence.ticks, files))
