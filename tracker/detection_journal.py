"""The journal of a search for people: the boxes of the images that were searched, so that an interrupted search goes on.

It is a file of lines of JSON in the temporary folder: first what is searched, then a line an image. A line that was cut by a kill does not count.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, Image

NAME = ".found.jsonl"


class DetectionJournal:
    """The journal in `folder`. about: what is searched, as JSON values; boxes of another search are not used.

    found: whether there is one of the same search. As a context manager it is written, and closed at the end.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self._path, self._about = folder / NAME, json.dumps(about, sort_keys=True)
        self._lines: dict[tuple[str, int], dict[str, Any]] = {}
        self.found = self._read()

    def _read(self) -> bool:
        try:
            first, *lines = self._path.read_bytes().split(b"\n")[:-1]
        except (OSError, ValueError):
            return False
        if first != self._about.encode():
            return False
        for line in lines:
            try:
                entry = json.loads(line)
                box, probability = np.array(entry["box"], dtype=float).reshape(-1, 4), np.array(entry["probability"], dtype=float)
                if probability.shape != box.shape[:1]:
                    break
                self._lines[str(entry["camera"]), int(entry["frame"])] = entry
            except (ValueError, KeyError, TypeError):
                break
        return True

    def __enter__(self) -> DetectionJournal:
        temporary = self._path.with_suffix(".new")
        temporary.write_text("".join(f"{line}\n" for line in [self._about, *map(json.dumps, self._lines.values())]), encoding="utf-8")
        temporary.replace(self._path)
        self._file = self._path.open("a", encoding="utf-8")
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def boxes(self, camera: str, frame: int, image: Image) -> tuple[Array, Array] | None:
        """Boxes (n, 4) and probabilities (n,) of an image that was searched; None for another image, or where the journal lacks it."""
        entry = self._lines.get((camera, frame))
        if entry is None or entry["image"] != zlib.crc32(image.tobytes()):
            return None
        return np.array(entry["box"], dtype=float).reshape(-1, 4), np.array(entry["probability"], dtype=float)

    def add(self, camera: str, frame: int, image: Image, box: Array, probability: Array) -> None:
        """Note the boxes (n, 4) and probabilities (n,) of an image (H, W, 3)."""
        entry = {"camera": camera, "frame": frame, "image": zlib.crc32(image.tobytes()), "box": box.tolist(), "probability": probability.tolist()}
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()

    def remove(self) -> None:
        """Remove the file, since the search is whole."""
        self._path.unlink()
