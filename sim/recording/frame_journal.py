"""The journal of a sequence that is being written: which frames are drawn and on disk, and what was seen in them."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from tracker.io.resume import Journal
from tracker.types import Boxes, Keypoints

NAME = ".drawn.jsonl"

People = dict[str, tuple[Boxes, Keypoints]]


class FrameJournal:
    """The journal in `folder`, with the frames whose images are whole. about: as of Journal.

    resumes: whether an earlier journal counts. found: whether there is a journal to resume.
    drawn: frame → camera → boxes and key points. checksums: path → SHA-256 and bytes of its images.
    As a context manager it writes the valid old lines, then new lines, and closes the file at the end.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any], resumes: bool = True) -> None:
        self._journal = Journal(folder / NAME, about)
        self.drawn: dict[int, People] = {}
        self.checksums: dict[str, tuple[str, int]] = {}
        self._pending: deque[tuple[int, People, list[str]]] = deque()
        self.found = resumes and self._journal.found
        entries, self._journal.entries = self._journal.entries if resumes else [], []
        for entry in entries:
            files = {name: (sha256, size) for name, (sha256, size) in entry["files"].items()}
            if all(_is_whole(folder / name, *claimed) for name, claimed in files.items()):
                self.drawn[entry["frame"]] = {camera: _people(*values) for camera, values in entry["people"].items()}
                self.checksums |= files
                self._journal.entries.append(entry)

    def __enter__(self) -> FrameJournal:
        self._journal.__enter__()
        return self

    def __exit__(self, *raised: object) -> None:
        self._journal.__exit__(*raised)

    def add(self, frame: int, people: People, names: list[str], written: Mapping[str, tuple[str, int]]) -> None:
        """Note a frame with its images. Its line follows once all of them are in `written`: path → SHA-256 and bytes."""
        self._pending.append((frame, people, names))
        while self._pending and all(name in written for name in self._pending[0][2]):
            frame, people, names = self._pending.popleft()
            seen = {camera: [_values(boxes), _values(keypoints)] for camera, (boxes, keypoints) in people.items()}
            self._journal.add({"frame": frame, "files": {name: written[name] for name in names}, "people": seen})

    def remove(self) -> None:
        """Remove the file, since the sequence is whole."""
        self._journal.remove()


def _is_whole(file: Path, sha256: str, size: int) -> bool:
    try:
        content = file.read_bytes()
    except OSError:
        return False
    return len(content) == size and hashlib.sha256(content).hexdigest() == sha256


def _values(of: Boxes | Keypoints) -> dict[str, Any]:
    """Field → values."""
    return {field.name: np.asarray(getattr(of, field.name)).tolist() for field in fields(of)}


def _people(boxes: dict[str, Any], keypoints: dict[str, Any]) -> tuple[Boxes, Keypoints]:
    return _made(Boxes, boxes), _made(Keypoints, keypoints)


def _made(kind: Any, values: dict[str, Any]) -> Any:
    """An object from its fields; the empty object where there are no rows, since JSON does not keep the shapes of empty arrays."""
    return kind(**{name: np.array(value) for name, value in values.items()}) if values["person"] else kind.none()
