"""Image files: encoding in threads, range images, and decoding by OpenCV, or else by Pillow."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageOps

from tracker.geometry import Image
from tracker.io.library_messages import library_messages

ENCODER_THREADS, MAX_WAITING = 2, 24
"""Number of threads that encode images, and how many images may wait for them."""
RANGE_UNIT = 1 / 256
"""m per count of a range image. A count of 0 means no surface, or a surface farther than FARTHEST counts (256 m)."""
FARTHEST = 65535
JPEG: list[int] = [cv2.IMWRITE_JPEG_QUALITY, 95]
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_BY_RUNS = [*_FAST, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
PNG: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
"""For colour images: run-length encoding takes two thirds of the time of zlib's default, which finds no repeats in noise, for 5 % more bytes."""
RANGE: list[int] = [*_FAST, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For range images: one filter for all rows takes half the time of choosing one of five per row, for the same bytes."""
PNG_RUN_LENGTH: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For instance images: nearly all differences of rows are zero, so run-length encoding takes a third of the time of OpenCV's default."""
PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
"""Suffixes of the image files that are read."""
MOST_PIXELS = 1 << 25
"""Largest image of unknown origin: more pixels would take gigabytes in the detector's network."""
NO_PICTURE = f"is no image that is read ({', '.join(PICTURES)}), or has far more than {MOST_PIXELS} px"
DEPTHS = (8, 10, 12, 14, 16)
"""Bit depths of an image stored in 16 bits. The smallest that holds its largest value is taken."""
ORIENTATION = 0x0112
"""EXIF tag of the orientation."""
warnings.filterwarnings("ignore", module=r"PIL\.")  # A file that Pillow only warns of is not damaged.


def range_counts(range_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) m, inf where no surface is hit → (H, W) counts of RANGE_UNIT."""
    counts = np.rint(range_m * np.float32(1 / RANGE_UNIT))
    return np.where(counts <= FARTHEST, counts, np.float32(0.0)).astype(np.uint16)


def image_size(data: bytes) -> tuple[int, int] | None:
    """(height, width) of an image by its header, after the rotation of its EXIF orientation. None if the data is no image."""
    header = _header(data)
    return None if header is None else header[:2]


def orientation(data: bytes) -> int:
    """The EXIF orientation of an image, 1 for upright images and without EXIF. Decoding applies it."""
    header = _header(data)
    return 1 if header is None else header[2]


def _header(data: bytes) -> tuple[int, int, int] | None:
    try:
        with Pillow.open(io.BytesIO(data), formats=("JPEG", "PNG", "BMP", "TIFF", "WEBP", "MPO", "DIB")) as image:
            width, height = image.size
            # Pillow would decode the pixels of a PNG to look for EXIF behind them.
            exif = Pillow.Exif() if image.format == "PNG" else image.getexif()
            if image.format == "PNG":
                exif.load(image.info.get("exif", b""))
            turned = int(exif.get(ORIENTATION, 1))
            # For TIFF, Pillow already gives the rotated size.
            return (width, height, turned) if turned >= 5 and image.format != "TIFF" else (height, width, turned)
    except Exception:  # Pillow raises errors of any kind for damaged headers, and one for sizes far beyond MOST_PIXELS.
        return None


def decode_image(data: bytes, size: tuple[int, int], flag: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Decode the bytes of an image file as OpenCV does (BGR). size: expected height and width, checked in the header before pixels are decoded.

    Raises ValueError, without the name of the file, for data that is no image, has another size, or is truncated or damaged.
    """
    claimed = image_size(data)
    if claimed != size:
        there = NO_PICTURE if claimed is None else f"is {claimed[1]} x {claimed[0]} px"
        raise ValueError(f"{there}, needs {size[1]} x {size[0]} px")
    image = _decoded(data, flag)
    if image.shape[:2] != size:
        raise ValueError(f"is truncated or damaged, has {image.shape[1]} x {image.shape[0]} px")
    return image


def _decoded(data: bytes, flag: int) -> NDArray[Any]:
    try:
        with library_messages() as printed:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    except cv2.error:
        image = None
    if image is None and flag != cv2.IMREAD_UNCHANGED:
        image = _by_pillow(data)
    if image is None:
        raise ValueError(f"is truncated or damaged{f' ({printed.line})' if printed.line else ''}")
    return np.asarray(image)


def _by_pillow(data: bytes) -> NDArray[Any] | None:
    """BGR, values of 32 bits as they are, or None where Pillow cannot decode the image, either."""
    try:
        with Pillow.open(io.BytesIO(data)) as image:
            if image.mode in ("F", "I"):
                return np.asarray(image)  # Pillow would cut such values off at 255.
            return np.asarray(ImageOps.exif_transpose(image).convert("RGB"))[:, :, ::-1]
    except Exception:  # As above.
        return None


def decode_picture(data: bytes) -> Image:
    """An image of unknown origin as (H, W, 3) RGB of 8 bits, upright by its EXIF orientation.

    Raises ValueError as decode_image, for more than MOST_PIXELS pixels, and for values of 32 bits.
    """
    size = image_size(data)
    if size is None:
        raise ValueError(NO_PICTURE)
    if size[0] * size[1] > MOST_PIXELS:
        raise ValueError(f"is {size[1]} x {size[0]} px, needs at most {MOST_PIXELS} px")
    image = _decoded(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image.dtype.kind == "f" or image.dtype.itemsize > 2:
        raise ValueError(f"is an image of {image.dtype} values, needs 8 or 16 bits")
    return np.ascontiguousarray(eight_bits(image)[:, :, ::-1])


def eight_bits(image: NDArray[Any]) -> NDArray[np.uint8]:
    """An image of 8 or 16 bits → 8 bits. Cameras of 10, 12 and 14 bits leave the upper bits of 16 empty; the largest value gives the depth."""
    if image.dtype == np.uint8:
        return image
    most = int(image.max(initial=0))
    depth = next(bits for bits in DEPTHS if most < 1 << bits)
    return np.asarray(image >> (depth - 8), np.uint8)


class ImageWriter:
    """Encodes images and writes them below a folder in threads. OpenCV releases Python's global lock meanwhile.

    checksums: name → SHA-256 and size in bytes of every file, complete once `wait` has returned.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.checksums: dict[str, tuple[str, int]] = {}
        self._threads = ThreadPoolExecutor(ENCODER_THREADS)
        self._pending: deque[Future[None]] = deque()

    def put(self, name: str, image: NDArray[Any], options: list[int]) -> None:
        """Queue an image, encoded by the suffix of its name. Waits while more than MAX_WAITING images are queued.

        Raises the error of an earlier image whose writing failed.
        """
        self._pending.append(self._threads.submit(self._encode, name, image, options))
        while len(self._pending) > MAX_WAITING:
            self._pending.popleft().result()

    def put_encoded(self, name: str, content: bytes) -> None:
        """Queue an image that is encoded already, as `put` does."""
        self._pending.append(self._threads.submit(self._write, name, content))
        while len(self._pending) > MAX_WAITING:
            self._pending.popleft().result()

    def wait(self) -> None:
        """Wait until all images are written. Raises the error of an image whose writing failed."""
        while self._pending:
            self._pending.popleft().result()

    def close(self) -> None:
        """Stop the threads and discard queued images."""
        self._threads.shutdown(cancel_futures=True)

    def _encode(self, name: str, image: NDArray[Any], options: list[int]) -> None:
        self._write(name, encoded(name, image, options))

    def _write(self, name: str, content: bytes) -> None:
        (self.root / name).write_bytes(content)
        self.checksums[name] = hashlib.sha256(content).hexdigest(), len(content)


def encoded(name: str, image: NDArray[Any], options: list[int]) -> bytes:
    """The bytes of an image file, by the suffix of its name. Raises ValueError for an image that cannot be written so."""
    if image.ndim == 3 and image.shape[2] == 3 and image.strides[2] < 0:
        # OpenCV swaps colours ten times as fast as numpy copies a view with a negative step.
        image = cv2.cvtColor(image[:, :, ::-1], cv2.COLOR_RGB2BGR)
    ok, data = cv2.imencode(Path(name).suffix, image, options)
    if not ok:
        raise ValueError(f"{name}: this image cannot be written as {Path(name).suffix}")
    return data.tobytes()
