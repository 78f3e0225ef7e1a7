"""The journal of a sequence that is being written: which frames are drawn and on disk, and what was seen in them.

It is a file of lines of JSON in the temporary folder: first what is written, then a line a frame. A line that was cut by a kill does not count.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from tracker.types import Boxes, Keypoints

NAME = ".drawn.jsonl"

People = dict[str, tuple[Boxes, Keypoints]]


class FrameJournal:
    """The journal in `folder`. about: what is written, as JSON values; the frames of another sequence or version are not resumed.

    found: whether there is one to resume. drawn: frame → camera → boxes and key points. checksums: path → SHA-256 and bytes of its images.
    As a context manager it closes the file.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self._path, self._about = folder / NAME, json.dumps(about, sort_keys=True)
        self.drawn: dict[int, People] = {}
        self.checksums: dict[str, tuple[str, int]] = {}
        self._pending: deque[tuple[int, People, list[str]]] = deque()
        self._kept: list[bytes] = []
        self.found = self._read()

    def _read(self) -> bool:
        try:
            lines = self._path.read_bytes().split(b"\n")[:-1]
        except OSError:
            return False
        if not lines or lines[0] != self._about.encode():
            return False
        for line in lines[1:]:
            try:
                entry = json.loads(line)
                files = {name: (sha256, size) for name, (sha256, size) in entry["files"].items()}
                people = {camera: _people(values) for camera, values in entry["people"].items()}
                frame = int(entry["frame"])
            except (ValueError, KeyError, TypeError, AttributeError):
                break
            if all(self._is_whole(name, *claimed) for name, claimed in files.items()):
                self.drawn[frame] = people
                self.checksums |= files
                self._kept.append(line)
        return True

    def _is_whole(self, name: str, sha256: str, size: int) -> bool:
        try:
            content = (self._path.parent / name).read_bytes()
        except OSError:
            return False
        return len(content) == size and hashlib.sha256(content).hexdigest() == sha256

    def open(self) -> None:
        """Begin to write: the lines that count, then new ones."""
        temporary = self._path.with_suffix(".new")
        temporary.write_bytes(b"".join(line + b"\n" for line in [self._about.encode(), *self._kept]))
        temporary.replace(self._path)
        self._kept.clear()
        self._file = self._path.open("ab")

    def __enter__(self) -> FrameJournal:
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def add(self, frame: int, people: People, names: list[str], written: Mapping[str, tuple[str, int]]) -> None:
        """Note a frame with its images. Its line follows once all of them are in `written`: path → SHA-256 and bytes."""
        self._pending.append((frame, people, names))
        while self._pending and all(name in written for name in self._pending[0][2]):
            frame, people, names = self._pending.popleft()
            seen = {camera: [_values(boxes), _values(keypoints)] for camera, (boxes, keypoints) in people.items()}
            entry = {"frame": frame, "files": {name: written[name] for name in names}, "people": seen}
            self._file.write(json.dumps(entry).encode() + b"\n")
            self._file.flush()

    def remove(self) -> None:
        """Remove the file, since the sequence is whole."""
        self._path.unlink()


def _values(of: Boxes | Keypoints) -> dict[str, Any]:
    """Field → values. JSON keeps every bit of a float, NaN and infinity, too."""
    return {field.name: np.asarray(getattr(of, field.name)).tolist() for field in fields(of)}


def _people(values: list[dict[str, Any]]) -> tuple[Boxes, Keypoints]:
    boxes, keypoints = values
    if not boxes["person"]:
        return Boxes.none(), Keypoints.none() if not keypoints["person"] else _made(Keypoints, keypoints)
    return _made(Boxes, boxes), _made(Keypoints, keypoints) if keypoints["person"] else Keypoints.none()


def _made(kind: Any, values: dict[str, Any]) -> Any:
    return kind(**{name: np.array(value) for name, value in values.items()})
