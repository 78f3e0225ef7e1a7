"""Images of a camera: a video, or numbered image files. They are read frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from tracker.geometry import Image
from tracker.io.image_files import decode_image
from tracker.io.video_files import open_video
from tracker.types import Odometry, Tick, Ticks


class ImageSource(Protocol):
    """The images of one camera."""

    def images(self, frames: int, size: tuple[int, int]) -> Iterator[Image | None]:
        """Yield an image (H, W, 3) uint8 RGB for each frame from 0 to `frames` − 1, or None where there is none.

        size: height and width of the camera, px. Images of a video are scaled to it. Raises ValueError with the path for an image file of
        another size, and for a video that ends too early.
        """
        ...

    def cut(self, first: int, end: int) -> ImageSource:
        """The source of the frames from `first` to `end` − 1; `first` becomes frame 0."""
        ...


@dataclass(frozen=True)
class VideoFile:
    """A video with an image for each frame. first: index of the image of frame 0. Raises ValueError where OpenCV cannot open it, when it is read."""

    path: Path
    first: int = 0

    def frames(self) -> int:
        """Number of images from `first` on, as the file says."""
        video = open_video(self.path)
        count = round(video.get(cv2.CAP_PROP_FRAME_COUNT))
        video.release()
        return max(0, count - self.first)

    def cut(self, first: int, end: int) -> VideoFile:
        return replace(self, first=self.first + first)

    def images(self, frames: int, size: tuple[int, int]) -> Iterator[Image | None]:
        video = open_video(self.path)
        try:
            for skipped in range(self.first):
                if not video.grab():
                    raise ValueError(f"{self.path}: has {skipped} frames, the detections go on")
            for index in range(frames):
                success, image = video.read()
                if not success:
                    raise ValueError(f"{self.path}: has {self.first + index} frames, the detections go on")
                if image.shape[:2] != size:
                    # Calibrations are of the camera's own pixels: View_006 of PETS 2009 is published as a wider video.
                    image = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
                yield np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)
        finally:
            video.release()


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """Image files (JPEG or PNG) by frame from 0. Frames without a file have no image."""

    files: Mapping[int, Path]

    def cut(self, first: int, end: int) -> ImageFiles:
        return ImageFiles({frame - first: path for frame, path in self.files.items() if first <= frame < end})

    def images(self, frames: int, size: tuple[int, int]) -> Iterator[Image | None]:
        for index in range(frames):
            path = self.files.get(index)
            if path is None:
                yield None
                continue
            try:
                image = decode_image(path.read_bytes(), size, cv2.IMREAD_COLOR)
            except (OSError, ValueError) as error:
                raise ValueError(f"{path}: {error}") from None
            yield np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class TicksWithImages:
    """Ticks with images that are read during iteration. sources: camera → its images; sizes: camera → height and width, px."""

    ticks: Ticks
    sources: Mapping[str, ImageSource]
    sizes: Mapping[str, tuple[int, int]]

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        with ExitStack() as stack:
            readers = {
                camera: stack.enter_context(closing(source.images(len(self.ticks), self.sizes[camera])))  # type: ignore[type-var]
                for camera, source in self.sources.items()
            }
            for tick in self.ticks:
                images = {camera: next(reader) for camera, reader in readers.items()}
                yield replace(tick, views=tuple(replace(view, image=images.get(view.camera)) for view in tick.views))

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()
