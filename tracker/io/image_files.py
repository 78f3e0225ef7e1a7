"""Image files: JPEG and PNG options, encoding in threads, range images, and decoding with a check of the header."""

from __future__ import annotations

import hashlib
import struct
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.io.library_messages import library_messages

ENCODER_THREADS, MAX_WAITING = 2, 24
"""Number of threads that encode images, and how many images may wait for them."""
RANGE_UNIT = 1 / 256
"""m per count of a range image. A count of 0 is no surface, or one farther than FARTHEST counts (256 m)."""
FARTHEST = 65535
JPEG: list[int] = [cv2.IMWRITE_JPEG_QUALITY, 95]
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_BY_RUNS = [*_FAST, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
PNG: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
"""For images: run lengths take two thirds of the time of zlib's default search, which finds no repeats in noise, for 5 % more bytes."""
RANGE: list[int] = [*_FAST, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For range images: one filter for all rows takes half the time of choosing one of five per row, for the same bytes."""
PNG_RUN_LENGTH: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For instances: differences of rows are nearly all zero, so that run lengths take a third of the time of OpenCV's default."""
_PNG_MAGIC, _JPEG_MAGIC = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def range_counts(range_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) m, inf where no surface is hit → (H, W) counts of RANGE_UNIT."""
    counts = np.rint(range_m * np.float32(1 / RANGE_UNIT))
    return np.where(counts <= FARTHEST, counts, np.float32(0.0)).astype(np.uint16)


def range_from_counts(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """(H, W) counts of a range image → (H, W) m along the ray, inf where the count is 0."""
    return np.where(counts > 0, counts * np.float32(RANGE_UNIT), np.float32(np.inf)).astype(np.float32)


def image_size(data: bytes) -> tuple[int, int] | None:
    """(height, width) in the header of a PNG or JPEG, None for other data."""
    if data.startswith(_PNG_MAGIC) and len(data) >= 24 and data[12:16] == b"IHDR":
        width, height = struct.unpack(">II", data[16:24])
        return height, width
    start = 2
    while data.startswith(_JPEG_MAGIC) and start + 9 <= len(data) and data[start] == 0xFF:
        marker = data[start + 1]
        if marker in _FRAME_HEADERS:
            height, width = struct.unpack(">HH", data[start + 5 : start + 9])
            return height, width
        start += 2 + int.from_bytes(data[start + 2 : start + 4])
    return None


def decode_image(data: bytes, size: tuple[int, int], flag: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Decode the bytes of an image file as OpenCV does (BGR). size: expected height and width, checked in the header before pixels are decoded.

    Raises ValueError, without the name of the file, for data that is no PNG or JPEG, has another size, or is truncated or damaged.
    """
    claimed = image_size(data)
    if claimed != size:
        raise ValueError(f"{'no PNG or JPEG' if claimed is None else f'{claimed} pixels'}, needs {size}")
    if not data[-64:].rstrip(b"\0").endswith((b"\xff\xd9", b"IEND\xaeB`\x82")):
        raise ValueError("is truncated")
    try:
        with library_messages() as printed:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != size:
        raise ValueError(f"cannot be decoded, needs {size}{f' ({printed.line})' if printed.line else ''}")
    if printed.line:
        raise ValueError(f"is damaged ({printed.line})")
    return np.asarray(image)


class ImageWriter:
    """Encodes images and writes them below a folder in threads. OpenCV releases the interpreter lock meanwhile.

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
