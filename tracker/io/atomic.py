"""Atomic writing of files and folders: under a temporary name, then renamed. Output that cannot be finished is kept, and the error names it."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import final

INSIDE = ".partial"
"""Name of the temporary folder inside a folder that exists already."""
LOCK = ".lock"
"""Name of the lock file in a folder (`file_lock.py`). Names that begin with it and a dot belong to the lock, too."""
LAST = ("README.md", "manifest.json", "run.json")
"""Files that mark a folder as complete, in the order in which they move into an existing folder after all others."""


@final
class Kept(OSError):  # noqa: N818  the name states the condition; the message is one line for the user
    """An output could not be finished. The message names the place of the unfinished output."""

    @staticmethod
    def of(error: Exception, place: Path, what: str = "what was made") -> Kept:
        """The same error, with the place of the unfinished output in its message. place: a folder or a file."""
        text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        message = f"{text}; {what} is in {place}"
        if not isinstance(error, OSError) or error.errno is None:
            return Kept(message)
        return Kept(error.errno, message) if error.filename is None else Kept(error.errno, message, str(error.filename))


def is_temporary(name: str) -> bool:
    """Whether a name in an output folder is that of the temporary folder or of a lock. Such names do not count as content."""
    return name in (INSIDE, LOCK) or name.startswith(f"{LOCK}.")


def is_free(path: Path) -> bool:
    """Whether `path` does not exist, or is a folder without content."""
    return not path.exists() or (path.is_dir() and all(is_temporary(entry.name) for entry in path.iterdir()))


def partial_path(path: Path) -> Path:
    """The temporary name under which a folder `path` that does not exist is written; it lies in the same parent folder."""
    real = Path(os.path.realpath(path)) if path.is_symlink() or path.name in ("", "..") else path
    return real.with_name(f".{real.name}.partial")


def unfinished_path(path: Path) -> Path:
    """The temporary folder for `path`: inside it where it exists, since a mount point or a link cannot be replaced; else beside it."""
    return path / INSIDE if path.is_dir() else partial_path(path)


def begin_folder(path: Path) -> Path:
    """Make an empty temporary folder for `path` and return it. Leftovers of an interrupted run, in `path` or beside it, are removed."""
    partial = unfinished_path(path)
    discard_folder(partial)
    discard_folder(partial_path(path))
    partial.mkdir(parents=True)
    return partial


def finish_folder(path: Path, partial: Path) -> None:
    """Rename the temporary folder `partial` to `path`, or move its content into the folder `path` where that exists."""
    if not path.is_dir():
        partial.rename(os.path.realpath(path))
        return
    for entry in sorted(partial.iterdir(), key=lambda entry: (LAST.index(entry.name) if entry.name in LAST else -1, entry.name)):
        entry.rename(path / entry.name)
    partial.rmdir()


def discard_folder(partial: Path) -> None:
    """Remove a temporary folder, if it exists."""
    if partial.exists():
        shutil.rmtree(partial)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yields an empty temporary folder. It becomes `path` when the block ends, and is removed when the block fails.

    An empty folder `path` stays and is filled, since it may be a mount point or a link, which cannot be replaced.
    Leftovers of an interrupted run under the temporary name are removed first. Raises ValueError where `path` exists and is no empty folder.
    Raises Kept for an OSError, for instance of a full disk: the temporary folder stays.
    """
    if not is_free(path):
        raise ValueError(f"{path}: is there already")
    partial = begin_folder(path)
    try:
        yield partial
        finish_folder(path, partial)
    except Exception as error:
        if isinstance(error, OSError) and partial.is_dir():
            raise Kept.of(error, partial) from error
        discard_folder(partial)
        raise
    except BaseException:
        discard_folder(partial)
        raise


def write_or_rescue(folder: Path, write: Callable[[Path], None]) -> None:
    """Call write(folder). Where that fails, write into the temporary folder of the system instead, and raise Kept, which names the place.

    write: writes a folder atomically; it raises OSError or ValueError where that is impossible. Its error is raised where no place can be written.
    """
    try:
        write(folder)
    except (OSError, ValueError) as error:
        first = error.__cause__ if isinstance(error, Kept) and isinstance(error.__cause__, OSError) else error
        try:
            spare = Path(tempfile.mkdtemp(prefix="pilsim-")) / "results"
            write(spare)
        except (OSError, ValueError):
            raise error from None
        shutil.rmtree(unfinished_path(folder), ignore_errors=True)
        raise Kept.of(first, spare, "the result") from first


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

    A block that fails leaves the existing file as it is. A link stays a link, and its target is replaced. A device or pipe is written directly.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file() and not target.is_dir():
        yield target
        return
    partial = target.with_name(f".{target.stem}.part{target.suffix}")
    if target.is_file() and not os.access(target.parent, os.W_OK):
        partial = Path(tempfile.mkdtemp(prefix="pilsim-")) / target.name
    try:
        yield partial
        try:
            partial.replace(target)
        except OSError as error:
            # EBUSY: the file is a mount point, such as a file mounted into a container. EXDEV: it lies on another file system.
            if error.errno not in (errno.EBUSY, errno.EXDEV):
                raise
            shutil.copyfile(partial, target)
    finally:
        partial.unlink(missing_ok=True)
        if partial.parent != target.parent:
            partial.parent.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text without conversion of line ends, and replace an existing file. A failure leaves that file as it is."""
    with new_file(path) as partial:
        # In an ASCII locale, Python decodes other bytes of a file name to surrogates. They are written as the same bytes.
        partial.write_text(text, encoding="utf-8", errors="surrogateescape", newline="\n")
