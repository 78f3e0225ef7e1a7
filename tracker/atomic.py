"""Files and folders that appear whole or not at all: written under a temporary name beside their place, then renamed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """An empty folder to write into that becomes `path` when the block ends, and is removed where the block fails.

    What a killed run left under the temporary name is removed first. Raises ValueError where `path` is there already.
    """
    if path.exists():
        raise ValueError(f"{path}: is there already")
    partial = path.with_name(f".{path.name}.partial")
    if partial.exists():
        shutil.rmtree(partial)
    partial.mkdir(parents=True)
    try:
        yield partial
        partial.rename(path)
    finally:
        if partial.exists():
            shutil.rmtree(partial)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text, lines ended as given, in place of what may be there; a write that fails leaves the old file and nothing beside it."""
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(text, encoding="utf-8", newline="\n")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
