"""Tables as CSV with a header or as compressed NPZ, and terrain as NPZ. Errors of CSV files name the file and the line."""

from __future__ import annotations

import csv
import io
import lzma
import math
import os
import re
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.ground import Grid
from tracker.io.text_files import LARGEST_NUMBER, LONGEST_SHOWN, parse_integer, parse_number, read_lines, shown

_ARRAY_FAULTS = (
    OSError, EOFError, KeyError, ValueError, TypeError, OverflowError, SyntaxError, RecursionError, NotImplementedError, RuntimeError, Warning,
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, tokenize.TokenError,
)  # fmt: skip
"""What zipfile and numpy raise for damaged files."""
_QUOTED = re.compile(r"[\"\r]|\n.")
BLOCK = 4096
"""Rows of a table that are parsed at once."""
LARGEST_WHOLE = 2**53
"""Floats represent whole numbers below this exactly."""
LARGEST_ARRAYS = 1 << 28
"""Bytes. Reading an array takes three times as much memory."""


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
            return {name: _array(archive, name) for name in names}
    except _ARRAY_FAULTS as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())[:200] or type(error).__name__}") from None


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """One array of finite numbers of at most LARGEST_NUMBER. The member is read whole first, since the header of an array may claim any size."""
    data = io.BytesIO(archive.read(f"{name}.npy"))
    with warnings.catch_warnings():
        # numpy warns of headers that Python 2 wrote, and of deprecated types.
        warnings.simplefilter("error")
        version = np.lib.format.read_magic(data)
        header = np.lib.format.read_array_header_2_0 if version == (2, 0) else np.lib.format.read_array_header_1_0
        shape, by_columns, dtype = header(data)
    if dtype.hasobject:
        raise ValueError(f"{name} holds objects, which need allow_pickle and are refused")
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise ValueError(f"{name} is {dtype}, needs finite numbers")
    count, there = math.prod(shape), len(data.getbuffer()) - data.tell()
    if count * dtype.itemsize != there or min(shape, default=0) < 0:
        raise ValueError(f"{name} has shape {shape} of {dtype}, which is not the {there} bytes that it has")
    array = np.frombuffer(data.getbuffer(), dtype, count, data.tell()).reshape(shape, order="F" if by_columns else "C")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds NaN or infinity, needs finite numbers")
    if array.size and not max(abs(float(array.max())), abs(float(array.min()))) <= LARGEST_NUMBER:
        raise ValueError(f"{name} reaches from {array.min():g} to {array.max():g}, needs numbers of at most {LARGEST_NUMBER:g}")
    return array


def read_terrain(path: Path) -> tuple[Grid, Grid]:
    """Height maps of a terrain.npz: the ground, and the ground with walls and furniture. Raises ValueError with the path."""
    arrays = read_arrays(path, ("heights", "origin", "spacing", "tops"))
    try:
        if arrays["spacing"].shape not in ((), (1,)):
            raise ValueError(f"spacing has shape {arrays['spacing'].shape}, needs one number")
        origin, spacing = arrays["origin"], float(arrays["spacing"].ravel()[0])
        return Grid(arrays["heights"], origin, spacing), Grid(arrays["tops"], origin, spacing)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def read_table(path: Path, columns: Mapping[str, type]) -> dict[str, NDArray[Any]]:
    """Read a table that must have exactly these columns (name → int, float or str) in this order → name → array.

    Blanks around cells and blank lines are ignored. Raises ValueError "path:line: …" for other columns, a row of another length, and for a cell
    that is no finite number.
    """
    return read_numbered_table(path, columns)[1]


def read_numbered_table(path: Path, columns: Mapping[str, type]) -> tuple[list[int], dict[str, NDArray[Any]]]:
    """As read_table, with the line of each row before the table. A column of BLOCK rows is parsed at once, and a faulty block cell by cell."""
    lines = _lines(path)
    number, header = next(lines, (0, ""))
    if not number:
        raise ValueError(f"{path}: empty, needs a header")
    if (cells := _cells(header)) != list(columns):
        raise ValueError(f"{path}:{number}: columns are {_listed(cells)}, need {_listed(columns)}")
    return _parsed(path, columns, ((number, line.split(",") if '"' not in line else _cells(line)) for number, line in lines))


def _parsed(path: Path, columns: Mapping[str, type], rows: Iterator[tuple[int, list[str]]]) -> tuple[list[int], dict[str, NDArray[Any]]]:
    """Line numbers and columns of a table. rows: line number and cells of each row."""
    numbers: list[int] = []
    parts: list[list[NDArray[Any]]] = [[np.array([], dtype=str if kind is str else None)] for kind in columns.values()]
    while block := list(islice(rows, BLOCK)):
        cells = [row for _, row in block]
        try:
            arrays = [_column(kind, column) for kind, column in zip(columns.values(), zip(*cells, strict=True), strict=True)]
        except (ValueError, OverflowError):
            raise _first_fault(path, columns, [n for n, _ in block], cells) from None
        numbers += [n for n, _ in block]
        for part, array in zip(parts, arrays, strict=True):
            part.append(array)
    # The empty array is used only without rows: its type would change that of the others.
    return numbers, {name: np.concatenate(part[1:] or part) for name, part in zip(columns, parts, strict=True)}


def read_rows(path: Path, columns: Sequence[str], whole: Container[str] = (), separator: str | None = ",", comment: str = "") -> tuple[Ints, Array]:
    """The lines (n,) and the values (n, columns) of a file of numbers without a header.

    whole: columns of whole numbers. separator: None for blanks. comment: the text that begins a comment, "" for none.
    Raises ValueError "path:line: …" for another number of values, for cells that are no finite number, and for whole numbers of 2^53 or more.
    """
    lines = ((number, text) for number, line in _lines(path) if (text := line.split(comment)[0].strip() if comment else line))
    numbers, table = _parsed(path, dict.fromkeys(columns, float), ((number, text.split(separator)) for number, text in lines))
    values = np.column_stack([column.astype(np.float64) for column in table.values()])
    for name, column in table.items():
        for k in np.flatnonzero((column != np.round(column)) | (np.abs(column) >= LARGEST_WHOLE))[:1] if name in whole else ():
            raise ValueError(f"{path}:{numbers[k]}: {name} is {column[k]:.17g}, needs a whole number below 2^53")
    return np.array(numbers, dtype=np.int64), values


def check_rows(*rules: tuple[str, NDArray[Any], Mask, str], keys: NDArray[Any]) -> None:
    """Raises ValueError for the first row, from 0, that breaks a rule or repeats the key of an earlier row: `row K: REASON`.

    rules: name, values (n,), where they are wrong (n,), and what is needed. keys (n, k): they identify a row, unless the second column is −1.
    """
    broken = [(int(np.argmax(wrong)), name, values, needed) for name, values, wrong, needed in rules if wrong.any()]
    faults = [(row, f"{name} is {values[row]}, needs {needed}") for row, name, values, needed in broken]
    named = np.flatnonzero(keys[:, 1] != -1)
    _, first, which = np.unique(keys[named], axis=0, return_index=True, return_inverse=True)
    again = named[first[which.ravel()] != np.arange(len(named))]
    faults += [(int(k), f"frame {keys[k, 0]} holds id {keys[k, 1]} twice") for k in again[:1]]
    if faults:
        row, reason = min(faults)
        raise ValueError(f"row {row}: {reason}")


@contextmanager
def faults_at_lines(path: str | os.PathLike[str], lines: Ints) -> Iterator[None]:
    """Replaces `row K: ` at the beginning of an error by the file and the line of that row. lines (n,): line number of each row."""
    try:
        yield
    except ValueError as error:
        row, reason = str(error).removeprefix("row ").split(": ", 1)
        raise ValueError(f"{path}:{lines[int(row)]}: {reason}") from None


def _column(kind: type, cells: Sequence[str]) -> NDArray[Any]:
    """The values of cells. Raises ValueError or OverflowError where parse_number or parse_integer would raise."""
    if kind is str:
        return np.array([cell.strip() for cell in cells])
    if any("_" in cell for cell in cells):
        raise ValueError
    array = np.array(list(map(kind, cells)), dtype=np.int64 if kind is int else np.float64)
    largest = float(1 << 62) if kind is int else LARGEST_NUMBER
    # NaN is within no bounds.
    if not (-largest < array.min() and array.max() < largest):
        raise ValueError
    return array


def _first_fault(path: Path, columns: Mapping[str, type], numbers: list[int], rows: list[list[str]]) -> ValueError:
    """The error of the first row of another length or with a cell that is no finite number."""
    for number, cells in zip(numbers, rows, strict=True):
        if len(cells) != len(columns):
            return ValueError(f"{path}:{number}: {len(cells)} values, needs {len(columns)}")
        for (name, kind), cell in zip(columns.items(), cells, strict=True):
            try:
                if kind is not str:
                    (parse_integer if kind is int else parse_number)(cell, f"{path}:{number}: {name}")
            except ValueError as error:
                return error
    raise AssertionError(f"{path}: a block of rows is no table, and each row is sound")


def read_header(path: Path) -> list[str]:
    """The cells of the first line of a table; empty for an empty file. Raises ValueError where the file cannot be read."""
    for _, line in _lines(path):
        return _cells(line)
    return []


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split(",")] if '"' not in line else next(csv.reader([line]), [])


def _listed(names: Iterable[str]) -> str:
    return repr(",".join(names))[1:-1][:200]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    try:
        yield from read_lines(path)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None


def rows_by_frame(
    path: Path, columns: Mapping[str, type], key: tuple[str, ...] = (), known_values: Mapping[str, Container[Any]] | None = None
) -> dict[int, list[dict[str, Any]]]:
    """Rows of a table: frame → list of column → value.

    key: columns that identify a row within its frame. known_values: column → allowed values.
    Raises ValueError with path and line as `read_table`, for two rows of a frame with the same key, and for other values.
    """
    lines, table = read_numbered_table(path, columns)
    frames: dict[int, list[dict[str, Any]]] = {}
    seen = set()
    for line, values in zip(lines, zip(*table.values(), strict=True), strict=True):
        row = dict(zip(columns, values, strict=True))
        for name, known in (known_values or {}).items():
            if row[name] not in known:
                raise ValueError(f"{path}:{line}: {name} is {shown(str(row[name]))[1:-1]}, which is not in the sequence")
        if key:
            identity = tuple(row[name] for name in ("frame", *key))
            if identity in seen:
                raise ValueError(f"{path}:{line}: frame {row['frame']} has {key[0]} {str(row[key[0]])[:LONGEST_SHOWN]} twice")
            seen.add(identity)
        frames.setdefault(int(row["frame"]), []).append(row)
    return frames
