"""Tables: CSV with a header and compressed NPZ, read with the file and line of every error."""

from __future__ import annotations

import csv
import io
import math
import re
import zipfile
import zlib
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_QUOTED = re.compile(r"[\"\r]|\n.")
LONGEST_LINE = 1 << 16
"""Characters; a file of unknown origin must not fill the memory."""
LARGEST_ARRAYS = 1 << 30
"""Bytes."""


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write rows under a header; floats have 9 significant digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        forms: dict[tuple[type, ...], str] = {}
        for row in rows:
            kinds = tuple(map(type, row))
            if kinds not in forms:
                forms[kinds] = ",".join("%.9g" if issubclass(kind, float | np.floating) else "%s" for kind in kinds) + "\n"
            # One format string per row is three times as fast as one per cell. Text that needs quotes goes through the csv module.
            line = forms[kinds] % tuple(row)
            if line.count(",") == len(row) - 1 and not _QUOTED.search(line):
                file.write(line)
            else:
                writer.writerow([f"{value:.9g}" if isinstance(value, float | np.floating) else value for value in row])


def write_arrays(path: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table as NPZ with one array per column: int64, float64 or text. The same rows give the same bytes."""
    arrays = {name: np.array([row[k] for row in rows]) for k, name in enumerate(columns)}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_arrays(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Numeric arrays of an NPZ file: name → array. Memory is limited to LARGEST_ARRAYS.

    Raises ValueError with the path where the file or an array is missing, is no NPZ, or has values that are not finite.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            claimed = {info.filename: info.file_size for info in archive.infolist()}
            if sum(claimed.values()) > LARGEST_ARRAYS:
                raise ValueError(f"{sum(claimed.values())} bytes when unpacked, needs at most {LARGEST_ARRAYS}")
            arrays = {}
            for name in names:
                # The member is read whole first, since the header of an array may claim any size.
                arrays[name] = np.lib.format.read_array(io.BytesIO(archive.read(f"{name}.npy")), allow_pickle=False)
                if arrays[name].dtype.kind not in "iuf" or not np.isfinite(arrays[name]).all():
                    raise ValueError(f"{name} is {arrays[name].dtype}, needs finite numbers")
    except (OSError, EOFError, KeyError, ValueError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path}: {error}") from None
    return arrays


def read_table(path: Path, columns: Mapping[str, type]) -> dict[str, NDArray[Any]]:
    """Read a table that must have exactly these columns (name → int, float or str) in this order → name → array.

    Raises ValueError "path:line: …" for other columns, a row of another length, and for a cell that is no finite number.
    """
    lists: dict[str, list[Any]] = {name: [] for name in columns}
    number = 0
    for number, line in enumerate(_lines(path), 1):
        cells = next(csv.reader([line]), [])
        if number == 1:
            if cells != list(columns):
                raise ValueError(f"{path}:1: columns are {','.join(cells)[:200]}, need {','.join(columns)}")
            continue
        if len(cells) != len(columns):
            raise ValueError(f"{path}:{number}: {len(cells)} values, needs {len(columns)}")
        for (name, kind), cell in zip(columns.items(), cells, strict=True):
            lists[name].append(_parse(kind, cell, f"{path}:{number}: {name}"))
    if not number:
        raise ValueError(f"{path}: empty, needs a header")
    return {name: np.array(values, dtype=str if columns[name] is str and not values else None) for name, values in lists.items()}


def _lines(path: Path) -> Iterator[str]:
    """Lines without line ends. Raises ValueError where the file is no text, or before a line of more than LONGEST_LINE is read."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            number = 0
            while line := file.readline(LONGEST_LINE + 1):
                number += 1
                if len(line) > LONGEST_LINE:
                    raise ValueError(f"{path}:{number}: a line of more than {LONGEST_LINE} characters")
                yield line.rstrip("\n")
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file ({error.reason} at byte {error.start})") from None


def rows_by_frame(
    path: Path, columns: Mapping[str, type], key: tuple[str, ...] = (), known_values: Mapping[str, Container[Any]] | None = None
) -> dict[int, list[dict[str, Any]]]:
    """Rows of a table: frame → list of column → value.

    key: columns that identify a row within its frame. known_values: column → allowed values.
    Raises ValueError with path and line as `read_table`, for two rows of a frame with the same key, and for other values.
    """
    table = read_table(path, columns)
    frames: dict[int, list[dict[str, Any]]] = {}
    seen = set()
    for line, values in enumerate(zip(*table.values(), strict=True), 2):
        row = dict(zip(columns, values, strict=True))
        for name, known in (known_values or {}).items():
            if row[name] not in known:
                raise ValueError(f"{path}:{line}: {name} is {row[name]}, which is not in the sequence")
        if key:
            identity = tuple(row[name] for name in ("frame", *key))
            if identity in seen:
                raise ValueError(f"{path}:{line}: frame {row['frame']} has {key[0]} {row[key[0]]} twice")
            seen.add(identity)
        frames.setdefault(int(row["frame"]), []).append(row)
    return frames


def _parse(kind: type, cell: str, where: str) -> Any:
    if kind is str:
        return cell
    try:
        value = kind(cell)
    except ValueError:
        raise ValueError(f"{where} is {cell[:40]!r}, needs {'a whole number' if kind is int else 'a number'}") from None
    if kind is int and abs(value) >= 1 << 62:
        raise ValueError(f"{where} is {cell[:40]}, needs less than 2^62")
    if kind is float and not math.isfinite(value):
        raise ValueError(f"{where} is {cell}, needs a finite number")
    return value
