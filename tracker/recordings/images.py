"""Images of a camera: a video, or numbered image files. They are read frame by frame."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from tracker.geometry import Image
from tracker.io.picture_folders import frames_from_zero, natural_key, numbered_files, read_picture, say_left_out, visible_files
from tracker.io.video_files import VIDEOS, frame_times, open_video
from tracker.types import Odometry, Tick, Ticks, View


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

    def paths(self) -> list[Path]:
        """The files that hold the images."""
        ...


@dataclass(frozen=True)
class VideoFile:
    """A video with an image for each frame. first: index of the image of frame 0. Reading raises ValueError where it cannot be opened."""

    path: Path
    first: int = 0

    def frames(self) -> int:
        """Number of images from `first` on. All are decoded, because containers hold only estimates."""
        return max(0, len(frame_times(self.path)) - self.first)

    def paths(self) -> list[Path]:
        return [self.path]

    def cut(self, first: int, end: int) -> VideoFile:
        return replace(self, first=self.first + first)

    def images(self, frames: int, size: tuple[int, int]) -> Iterator[Image | None]:
        video = open_video(self.path)
        try:
            for skipped in range(self.first):
                if not video.grab():
                    raise ValueError(f"{self.path}: has {skipped} frames, the recording begins at {self.first}")
            for index in range(frames):
                success, image = video.read()
                if not success:
                    raise ValueError(f"{self.path}: has {self.first + index} frames, the recording has {self.first + frames}")
                if image.shape[:2] != size:
                    # Calibrations are of the camera's own pixels: View_006 of PETS 2009 is published as a wider video.
                    image = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
                yield np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)
        finally:
            video.release()


@dataclass(frozen=True, eq=False)
class ImageFiles:
    """Image files by frame from 0. Frames without a file have no image. Images are turned upright by their EXIF orientation, which is logged."""

    files: Mapping[int, Path]

    def cut(self, first: int, end: int) -> ImageFiles:
        return ImageFiles({frame - first: path for frame, path in self.files.items() if first <= frame < end})

    def paths(self) -> list[Path]:
        return list(self.files.values())

    def images(self, frames: int, size: tuple[int, int]) -> Iterator[Image | None]:
        for index in range(frames):
            path = self.files.get(index)
            if path is None:
                yield None
                continue
            image = read_picture(path)
            if image.shape[:2] != size:
                raise ValueError(f"{path}: is {image.shape[1]} x {image.shape[0]} px, its camera {size[1]} x {size[0]} px")
            yield image


def image_sources(path: Path, cameras: Collection[str]) -> dict[str, ImageSource]:
    """The images of cameras in a folder: video/CAMERA.mp4, or files in images/CAMERA/, numbered from 0 or 1.

    Suffixes are VIDEOS and PICTURES. Folders and files that belong to no camera are logged. Raises ValueError for two videos of a camera, and for
    two images with one number.
    """
    found: dict[str, ImageSource] = {}
    if (path / "video").is_dir():
        videos = visible_files(path / "video", VIDEOS)
        for file in videos:
            if file.stem in found:
                raise ValueError(f"{file}: is a second video of {file.stem}, needs one")
            if file.stem in cameras:
                found[file.stem] = VideoFile(file)
        say_left_out(path / "video", [file for file in videos if file.stem not in cameras], f"belong to no camera of {', '.join(cameras)}")
    folders = sorted((path / "images").iterdir(), key=lambda one: natural_key(one.name)) if (path / "images").is_dir() else []
    folders = [one for one in folders if not one.name.startswith(".")]
    say_left_out(path / "images", [one for one in folders if one.name not in cameras], f"belong to no camera of {', '.join(cameras)}")
    numbered = {one.name: numbered_files(one) for one in folders if one.is_dir() and one.name in cameras and one.name not in found}
    for name, files in frames_from_zero(numbered, str(path / "images")).items():
        if files:
            found[name] = ImageFiles(files)
    return {name: found[name] for name in cameras if name in found}


def _frame_of(view: View, tick: Tick) -> int:
    return tick.index if view.frame is None else view.frame


def _image(readers: Mapping[str, Iterator[tuple[int, Image | None]]], view: View, frame: int) -> Image | None:
    """The image of a frame; earlier images without a view are skipped."""
    return next((image for k, image in readers[view.camera] if k == frame), None) if view.camera in readers else None


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
            last = {view.camera: _frame_of(view, tick) for tick in self.ticks for view in tick.views}
            readers = {
                camera: enumerate(stack.enter_context(closing(source.images(last.get(camera, -1) + 1, self.sizes[camera]))))  # type: ignore[type-var]
                for camera, source in self.sources.items()
            }
            for tick in self.ticks:
                yield replace(tick, views=tuple(replace(view, image=_image(readers, view, _frame_of(view, tick))) for view in tick.views))

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()
