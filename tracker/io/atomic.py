"""Files and folders that appear whole or not at all: written under a temporary name beside their place, then renamed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def unfinished(path: Path) -> Path:
    """The temporary name, beside `path`, under which the folder `path` is written."""
    return path.with_name(f".{path.name}.partial")


def begin_folder(path: Path) -> Path:
    """Make an empty folder under the temporary name of `path`, without what a killed run left there; returns the temporary name."""
    discard_folder(path)
    unfinished(path).mkdir(parents=True)
    return unfinished(path)


def finish_folder(path: Path) -> None:
    """Give the folder under the temporary name its own."""
    unfinished(path).rename(path)


def discard_folder(path: Path) -> None:
    """Remove the folder under the temporary name, where there is one."""
    if unfinished(path).exists():
        shutil.rmtree(unfinished(path))


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """An empty folder to write into that becomes `path` when the block ends, and is removed where the block fails.

    What a killed run left under the temporary name is removed first. Raises ValueError where `path` is there already, but for an empty folder.
    """
    if path.exists():
        if not path.is_dir() or any(path.iterdir()):
            raise ValueError(f"{path}: is there already")
        path.rmdir()
    try:
        yield begin_folder(path)
        finish_folder(path)
    finally:
        discard_folder(path)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """A name to write a file under, of the same ending, that becomes `path` when the block ends; it takes the place of what may be there.

    A block that fails leaves the old file and nothing beside it.
    """
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text, lines ended as given, in place of what may be there; a write that fails leaves the old file and nothing beside it."""
    with new_file(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
