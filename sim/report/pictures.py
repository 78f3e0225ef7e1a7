"""Pictures and videos for the page: small JPEG and animated WebP files as data URIs."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from sim.report.rows import Row
from tracker.geometry import Image
from tracker.io.image_files import MOST_PIXELS, decode_image, image_size

WIDTH = 1000
"""The greatest width in px."""
BUDGET = 1_600_000
"""Bytes of all pictures together, before base64. The page then stays below 3 MB."""
"""Of a picture that is read."""
QUALITIES = (80, 65, 50, 35, 20)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture or a video, its size in px, and the type of its data."""

    data: bytes
    width: int
    height: int
    type: str = "jpeg"

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return f"data:image/{self.type};base64," + base64.b64encode(self.data).decode("ascii")


@dataclass(frozen=True, eq=False)
class Entry:
    """A moment of a run with its pictures, and the names of pictures that are missing."""

    row: Row
    moment: dict[str, Any]
    pictures: tuple[Picture, ...]
    missing: tuple[str, ...]


def album_of(folder: Path, moments: Sequence[tuple[Row, dict[str, Any]]]) -> list[Entry]:
    """Read the pictures of moments and shrink them, all at the best JPEG quality with which they fit into BUDGET.

    Raises ValueError for a picture outside the folder, and for a file that is no image.
    """
    read = [(row, moment, _images(folder, row, moment)) for row, moment in moments]
    images = [image for _, _, (found, _) in read for image in found]
    for quality in QUALITIES:
        encoded = [jpeg(image, quality) for image in images]
        if sum(len(picture.data) for picture in encoded) <= BUDGET:
            break
    left = iter(encoded)
    return [Entry(row, moment, tuple(next(left) for _ in found), tuple(missing)) for row, moment, (found, missing) in read]


def _images(folder: Path, row: Row, moment: dict[str, Any]) -> tuple[list[Any], list[str]]:
    found, missing = [], []
    names = moment.get("pictures") or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{row.where}: pictures of a moment is no list of names")
    for name in names:
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise ValueError(f"{row.where}: picture {name[:80]!r} lies outside the folder")
        path = folder / name
        if not path.is_file():
            missing.append(name)
            continue
        data = path.read_bytes()
        size = image_size(data)
        if size is None or size[0] * size[1] > MOST_PIXELS:
            raise ValueError(f"{path}: not an image, or torn" if size is None else f"{path}: {size} pixels, needs at most {MOST_PIXELS}")
        try:
            found.append(decode_image(data, size, cv2.IMREAD_COLOR))
        except ValueError as error:
            raise ValueError(f"{path}: not an image, or torn: {error}") from None
    return found, missing


def video(frames: Sequence[Image], seconds: float, quality: int) -> Picture:
    """Frames (h, w, 3) RGB as an animated WebP, which browsers show as a picture that moves, again and again. seconds: of a frame."""
    animation = cv2.Animation()
    animation.frames = [cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) for frame in frames]
    animation.durations = [round(1000 * seconds)] * len(frames)
    data = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, quality])[1]
    return Picture(bytes(data), frames[0].shape[1], frames[0].shape[0], "webp")


def jpeg(image: Any, quality: int) -> Picture:
    """An image (BGR) as a JPEG of at most WIDTH px."""
    height, width = image.shape[:2]
    if width > WIDTH:
        height, width = round(height * WIDTH / width), WIDTH
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    ok, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    if not ok:
        raise ValueError(f"an image of {width} × {height} px cannot be written as JPEG")
    return Picture(data.tobytes(), width, height)
