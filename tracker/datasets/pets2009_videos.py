"""Videos beside a PETS 2009 folder's detections: VIDEO/View_00N.mp4, a frame a tick."""

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


class Film:
    """The frames of a video, one after the other. Raises ValueError where it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.path, self._frames, self._video = path, 0, cv2.VideoCapture(str(path))
        if not self._video.isOpened():
            raise ValueError(f"{path}: is no video that OpenCV can read")

    def next(self) -> Image:
        """The next frame (H, W, 3) uint8 RGB. Raises ValueError where there is none."""
        there, frame = self._video.read()
        if not there:
            raise ValueError(f"{self.path}: has {self._frames} frames, the detections go on")
        self._frames += 1
        return np.asarray(frame[:, :, ::-1], dtype=np.uint8)

    def close(self) -> None:
        self._video.release()


@dataclass(frozen=True, eq=False)
class FilmedTicks:
    """Ticks whose views have images, read as they are asked for; files: camera → video. Raises ValueError, on the way, where a video ends early."""

    ticks: Ticks
    files: dict[str, Path]

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        with ExitStack() as stack:
            films = {camera: stack.enter_context(closing(Film(path))) for camera, path in self.files.items()}
            for tick in self.ticks:
                images = {camera: film.next() for camera, film in films.items()}
                yield replace(tick, views=tuple(replace(view, image=images.get(view.camera)) for view in tick.views))

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()


def with_videos(sequence: Sequence, folder: Path) -> Sequence:
    """The sequence with the images of folder/video/CAMERA.mp4, for those cameras that have one; as it is where its ticks have images.

    Raises ValueError where neither is so.
    """
    first = next(iter(sequence.ticks), None)
    if first is not None and any(view.image is not None for view in first.views):
        return sequence
    files = {camera: folder / FOLDER / f"{camera}.mp4" for camera in sequence.setup.mounts}
    files = {camera: path for camera, path in files.items() if path.is_file()}
    if not files:
        raise ValueError(f"{folder}: has no images, and no {FOLDER}/CAMERA.mp4 of {', '.join(sequence.setup.mounts)}")
    return replace(sequence, ticks=FilmedTicks(sequence.ticks, files))
