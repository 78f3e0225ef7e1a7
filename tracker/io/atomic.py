"""Atomic writing of files and folders: they are written under a temporary name in the same folder, then renamed."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

INSIDE = ".partial"
"""Name of the temporary folder inside a folder that exists already."""
LAST = "run.json"
"""The file that marks results as complete: it moves into an existing folder after all others."""


def partial_path(path: Path) -> Path:
    """The temporary name under which the folder `path` is written; it lies in the same parent folder."""
    return path.with_name(f".{path.name}.partial")


def begin_folder(path: Path) -> Path:
    """Make an empty folder under the temporary name of `path` and return it. What an interrupted run left there is removed."""
    discard_folder(path)
    partial_path(path).mkdir(parents=True)
    return partial_path(path)


def finish_folder(path: Path) -> None:
    """Rename the folder under the temporary name to `path`."""
    partial_path(path).rename(path)


def discard_folder(path: Path) -> None:
    """Remove the folder under the temporary name, if it exists."""
    if partial_path(path).exists():
        shutil.rmtree(partial_path(path))


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yields an empty temporary folder. It becomes `path` when the block ends, and is removed when the block fails.

    An empty folder `path` stays and is filled, since it may be a mount point or a link, which cannot be replaced.
    What an interrupted run left under the temporary name is removed first. Raises ValueError where `path` exists and is no empty folder.
    """
    if path.exists():
        with _inside(path) as partial:
            yield partial
        return
    try:
        yield begin_folder(path)
        finish_folder(path)
    finally:
        discard_folder(path)


@contextmanager
def _inside(path: Path) -> Iterator[Path]:
    """Yields a temporary folder inside the empty folder `path`, whose files move to `path` when the block ends."""
    if not path.is_dir() or any(entry.name != INSIDE for entry in path.iterdir()):
        raise ValueError(f"{path}: is there already")
    partial = path / INSIDE
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        for entry in sorted(partial.iterdir(), key=lambda entry: (entry.name == LAST, entry.name)):
            entry.rename(path / entry.name)
    finally:
        shutil.rmtree(partial)


def check_writable(path: Path) -> None:
    """Raises OSError where no folder `path` can be made, or nothing can be written into it. Call it before long work."""
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(existing))
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, "cannot be written; choose another --out", str(existing))


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Yields a temporary file name with the same suffix. It becomes `path` when the block ends, and replaces an existing file.

    A block that fails leaves the existing file as it is.
    """
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text without conversion of line ends, and replace an existing file. A failure leaves that file as it is."""
    with new_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
