"""An exclusive file lock. One process holds it at a time, and the operating system releases it when that process ends."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout


class Locked(ValueError):  # noqa: N818  the name states the condition; the message is one line for the user
    """Another process holds the lock."""


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Hold the lock on the file `path` during this context. The file is empty, and is removed at the end.

    The process id stands in a second file, `path` with `.pid` appended. It serves the error message alone: the operating system keeps the lock.

    wait: wait until the lock is free. Without it, raises Locked (one line) where another process holds the lock.
    Raises FileNotFoundError where the folder does not exist.
    """
    path.parent.stat()  # FileLock would make the folder.
    lock, holder = FileLock(path), holder_file(path)
    try:
        lock.acquire(blocking=wait)
    except Timeout:
        raise Locked(f"{path.parent}: another run (process {_holder(holder)}) writes into it; wait for it, or choose another --out") from None
    try:
        holder.write_text(f"{os.getpid()}\n")
        yield
    finally:
        # Both files are removed while the lock is held: after the release they may belong to the next process.
        with suppress(OSError):
            holder.unlink(missing_ok=True)
        # On POSIX a waiting process finds, once it has locked this file, that the file has no name, and opens a new one.
        # Windows cannot remove a file that is open: filelock removes it there.
        if os.name == "posix":
            path.unlink(missing_ok=True)
        lock.release()


def holder_file(path: Path) -> Path:
    """The file with the id of the process that holds the lock on `path`."""
    return path.with_name(f"{path.name}.pid")


def _holder(path: Path) -> str:
    """The process id in this file, or "unknown" where the holder has not written it yet or is removing it."""
    try:
        return path.read_text().strip() or "unknown"
    except OSError:
        return "unknown"
