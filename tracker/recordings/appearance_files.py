"""Appearance vectors of the boxes of a recording: detections/CAMERA.npy beside detections/CAMERA.txt.

The array (rows, d) of floating-point numbers has a row for each row of the text file, in the same order. Vectors are compared by their cosine.
Their length and scale do not matter. A row of zeros says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Mask
from tracker.io.atomic import new_file
from tracker.io.mot15 import read_mot15

LONGEST = 4096
"""Most numbers of a vector."""

FrameVectors = Mapping[int, Array]
"""Frame from 0 → vectors (n, d) of the boxes of that frame, in their order."""


def read_appearances(folder: Path, cameras: list[str]) -> dict[str, FrameVectors]:
    """The vectors of all cameras that have some, where `folder` holds CAMERA.txt and CAMERA.npy.

    Raises ValueError for an array of another shape or type, and for numbers that are not finite.
    """
    return {name: _vectors(folder / f"{name}.npy", folder / f"{name}.txt") for name in cameras if (folder / f"{name}.npy").is_file()}


def _vectors(file: Path, text: Path) -> dict[int, Array]:
    if not text.is_file():
        raise ValueError(f"{file}: has no {text.name} beside it, needs the boxes that its vectors belong to")
    rows = read_mot15(text)
    try:
        with file.open("rb") as stream:
            vectors = np.lib.format.read_array(stream, allow_pickle=False, max_header_size=10_000)
    except (ValueError, EOFError, MemoryError, OverflowError, SyntaxError, TypeError) as error:
        raise ValueError(f"{file}: is not an array of NumPy ({str(error).splitlines()[0][:100]})") from None
    if vectors.ndim != 2 or vectors.dtype.kind != "f" or not 1 <= vectors.shape[1] <= LONGEST:
        raise ValueError(f"{file}: has shape {vectors.shape} of {vectors.dtype}, needs (rows, d) of floating-point numbers, d from 1 to {LONGEST}")
    if len(vectors) != len(rows):
        raise ValueError(f"{file}: has {len(vectors)} rows, needs {len(rows)}, one for each different row of {text.name}")
    finite: Mask = np.isfinite(vectors).all(axis=1)
    if not finite.all():
        raise ValueError(f"{file}: row {int(np.argmin(finite))} from 0 has a number that is not finite")
    vectors = vectors.astype(np.float64)
    return {frame - 1: vectors[k] for frame, k in rows.by_frame().items()}


def write_appearances(folder: Path, detections: Mapping[str, Mapping[int, tuple[Array, Array]]], appearances: Mapping[str, FrameVectors]) -> None:
    """Write CAMERA.npy of each camera with vectors, in the order of its boxes; zeros where a frame has boxes and no vectors."""
    for name, vectors in appearances.items():
        length = max((of_frame.shape[1] for of_frame in vectors.values()), default=0)
        if not length:
            continue
        parts = [vectors.get(frame, np.zeros((len(boxes), length))) for frame, (boxes, _) in detections[name].items()]
        with new_file(folder / f"{name}.npy") as part, part.open("wb") as out:
            np.save(out, np.concatenate(parts).astype(np.float32))
