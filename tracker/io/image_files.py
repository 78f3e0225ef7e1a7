"""Images of a Sequence as files: coded while others are made, decoded only where their header says what is expected."""

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

CODERS, WAITING = 2, 24
"""Threads that code images, and how many images may wait for them."""
RANGE_UNIT = 1 / 256
"""m: what one count of a range image is; 0 is nothing, or farther than 65535 counts (256 m)."""
FARTHEST = 65535
JPEG: list[int] = [cv2.IMWRITE_JPEG_QUALITY, 95]
_FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]
_BY_RUNS = [*_FAST, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
PNG: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
"""For images: two thirds of the time of zlib's search for repeats, which noise does not have, and 5 % more bytes."""
RANGE: list[int] = [*_FAST, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For ranges: one filter for all rows; trying five for each row takes twice the time for the same bytes."""
RUNS: list[int] = [*_BY_RUNS, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
"""For instances: a row less the row above it is nearly all zero, and is written as runs; a third of the time of OpenCV's own choice."""
_PNG_MAGIC, _JPEG_MAGIC = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def range_counts(range_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) m, inf for nothing → (H, W) counts of RANGE_UNIT."""
    counts = np.rint(range_m * np.float32(1 / RANGE_UNIT))
    return np.where(counts <= FARTHEST, counts, np.float32(0.0)).astype(np.uint16)


def range_from_counts(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """(H, W) counts of a range image → (H, W) m along the ray, inf where there is nothing or it is too far."""
    return np.where(counts > 0, counts * np.float32(RANGE_UNIT), np.float32(np.inf)).astype(np.float32)


def size_in(data: bytes) -> tuple[int, int] | None:
    """(height, width) that the header of a PNG or JPEG claims, None where it is neither or has no header."""
    if data.startswith(_PNG_MAGIC) and len(data) >= 24 and data[12:16] == b"IHDR":
        width, height = struct.unpack(">II", data[16:24])
        return height, width
    at = 2
    while data.startswith(_JPEG_MAGIC) and at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _FRAME_HEADERS:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return height, width
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return None


def decode(data: bytes, size: tuple[int, int], flag: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """The image in a file's bytes, as OpenCV has it (BGR). The header is looked at before anything is set aside for pixels.

    Raises ValueError, which does not name the file, for what is no PNG or JPEG, is of another size (height, width) or ends too soon.
    """
    claimed = size_in(data)
    if claimed != size:
        raise ValueError(f"{'no PNG or JPEG' if claimed is None else f'{claimed} pixels'}, needs {size}")
    if not data[-64:].rstrip(b"\0").endswith((b"\xff\xd9", b"IEND\xaeB`\x82")):
        raise ValueError("ends too soon")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flag)
    if image is None or image.shape[:2] != size:
        raise ValueError(f"cannot be decoded, needs {size}")
    return np.asarray(image)


class Coders:
    """Threads that code images and write them under a folder, while the next ones are drawn: OpenCV lets go of the interpreter.

    sums: name → SHA-256 and bytes of every file that is written, complete once `wait` has returned.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.sums: dict[str, tuple[str, int]] = {}
        self._threads = ThreadPoolExecutor(CODERS)
        self._coding: deque[Future[None]] = deque()

    def put(self, name: str, image: NDArray[Any], options: list[int]) -> None:
        """Have an image coded by the ending of its name and written, after as many others are done as would else pile up.

        Raises what went wrong with one of those.
        """
        self._coding.append(self._threads.submit(self._code, name, image, options))
        while len(self._coding) > WAITING:
            self._coding.popleft().result()

    def wait(self) -> None:
        """Until all are written. Raises what went wrong with one."""
        while self._coding:
            self._coding.popleft().result()

    def close(self) -> None:
        """Drop what waits."""
        self._threads.shutdown(cancel_futures=True)

    def _code(self, name: str, image: NDArray[Any], options: list[int]) -> None:
        ok, data = cv2.imencode(Path(name).suffix, image, options)
        if not ok:
            raise ValueError(f"{name}: this image cannot be written as {Path(name).suffix}")
        content = data.tobytes()
        (self.root / name).write_bytes(content)
        self.sums[name] = hashlib.sha256(content).hexdigest(), len(content)
