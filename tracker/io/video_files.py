"""Video files: MP4 (MPEG-4 part 2) is written, one file for each camera; every format that OpenCV decodes is read.

OpenCV and most players read MPEG-4 part 2, but browsers do not. VP9, which browsers play, takes about 20 times as long to encode.
"""

from __future__ import annotations

import os
from functools import lru_cache
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from tracker.geometry import Array, Image
from tracker.io.image_files import MOST_PIXELS
from tracker.io.library_messages import library_messages

# FFmpeg reads the level with its first file; -8 is quiet.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg")
"""Suffixes of the video files that are read."""


class VideoWriters:
    """Writes FOLDER/CAMERA.mp4 for several cameras, frame by frame, at `rate` frames/s where a camera has no rate of its own."""

    def __init__(self, folder: Path, rate: float) -> None:
        self.folder, self.rate = folder, rate
        self._writers: dict[str, cv2.VideoWriter] = {}
        self._frames: dict[str, int] = {}

    def put(self, camera: str, image: Image, rate: float | None = None) -> None:
        """Append an RGB image (H, W, 3) to the video of a camera. rate: frames/s of this camera, given with its first image.

        Raises ValueError where the file cannot be opened for writing.
        """
        if camera not in self._writers:
            self.folder.mkdir(exist_ok=True)
            path, size = self.folder / f"{camera}.mp4", (image.shape[1], image.shape[0])
            self._writers[camera] = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate or self.rate, size)
            self._frames[camera] = 0
            if not self._writers[camera].isOpened():
                raise ValueError(f"{path}: this OpenCV cannot write MP4 video to this path")
        self._writers[camera].write(np.ascontiguousarray(image[:, :, ::-1]))
        self._frames[camera] += 1

    def finish(self) -> None:
        """Close all videos. Raises OSError where frames are missing, since the encoder reports no full disk."""
        self.close()
        for camera, frames in self._frames.items():
            path = self.folder / f"{camera}.mp4"
            check_frames(path, frames, path)

    def close(self) -> None:
        """Close all videos without a check."""
        for writer in self._writers.values():
            writer.release()


def open_video(path: Path) -> cv2.VideoCapture:
    """A video to read. Damaged videos print nothing. Raises ValueError where OpenCV cannot open it, and for images of more than MOST_PIXELS."""
    with library_messages():
        video = cv2.VideoCapture(str(path))
    width, height = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if not video.isOpened() or not 0 <= width * height <= MOST_PIXELS:
        fault = f"has images of {width:g} x {height:g} px, needs at most {MOST_PIXELS} px" if video.isOpened() else "is no video that OpenCV can read"
        video.release()
        raise ValueError(f"{path}: {fault}")
    return video


def frame_times(path: Path, most: int | None = None) -> Array:
    """Times (n,) s of the frames of a video by their own stamps, ascending; the first `most` if given. They are decoded, as no header states n.

    Raises ValueError where the file holds no video.
    """
    about = path.stat()
    return _frame_times(str(path), about.st_size, about.st_mtime_ns, most)


@lru_cache(256)
def _frame_times(path: str, size: int, changed: int, most: int | None) -> Array:
    import av  # Its libraries take 0.1 s to load.

    times: list[float] = []
    try:
        with av.open(path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            fallback = float(1 / (stream.average_rate or 25))
            for frame in islice(container.decode(stream), most):
                times.append(float(frame.time) if frame.time is not None else len(times) * fallback)
    except (av.FFmpegError, IndexError) as error:
        # Frames after a damaged one are lost; OpenCV stops there, too.
        if not times:
            raise ValueError(f"{path}: is no video that can be read ({str(error)[:80]})") from None
    return np.sort(np.array(times))


def packet_times(path: Path) -> Array:
    """Times (n,) s of the frames of a video by the stamps of its packets, ascending; empty where they have none, or it cannot be read."""
    import av

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            times = [float(packet.pts * stream.time_base) for packet in container.demux(stream) if packet.size]  # type: ignore[operator]
            return np.sort(np.array(times))
    except (av.FFmpegError, IndexError, TypeError):
        return np.zeros(0)


def number_of_frames(path: Path) -> int:
    """Number of frames of a video, counted by packets without decoding. It may be off by a few, which suffices for progress bars.

    Raises ValueError where the file ends before the number of frames that its container states; Matroska, for instance, states none.
    """
    import av

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            told = stream.frames
            found = sum(packet.size > 0 for packet in container.demux(stream))
    except (av.FFmpegError, IndexError) as error:
        raise ValueError(f"{path}: is no video that can be read ({str(error)[:80]})") from None
    if found < told:
        raise ValueError(f"{path}: ends after {found} of the {told} frames that it names")
    return found


def check_frames(file: Path, frames: int, name: Path) -> None:
    """Raises OSError where `file` has another number of frames than `frames`; `name` stands for the file in the message."""
    there = round(cv2.VideoCapture(str(file)).get(cv2.CAP_PROP_FRAME_COUNT))
    if there != frames:
        raise OSError(f"{name}: {max(there, 0)} of {frames} frames could be written; is the disk full?")
