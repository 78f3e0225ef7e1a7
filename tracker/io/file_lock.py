"""Locks on outputs: one process writes a folder or a file at a time. The operating system releases a lock when its process ends.

The lock of a folder is a file in it. So every path to the folder, such as a link or the same volume in another container, has the same lock.
"""

from __future__ import annotations

import errno
import os
import socket
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path

from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from tracker.io.atomic import LOCK, Kept, check_writable, is_free

LONGEST = 200
"""Most characters that are read from the file that names the holder of a lock."""
_WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)
_held: set[tuple[int, str]] = set()
"""Pairs of a thread and the real path of a folder that it has locked."""


class Locked(ValueError):  # noqa: N818  the name states the condition; the message is one line for the user
    """Another process holds the lock."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of an output folder during this context. A missing folder is made first, and removed at the end where it is empty then.

    Nested calls of one thread for one folder share the lock.
    Raises Locked (one line) where another process holds it, ValueError where `folder` is a file, and OSError where nothing can be written there.
    An OSError in the context becomes Kept where the folder has content then.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file, needs a folder")
    real = Path(os.path.realpath(folder))
    key = threading.get_ident(), str(real)
    if key in _held:
        yield
        return
    with _output_lock(folder, real, LOCK):
        _held.add(key)
        try:
            yield
        except OSError as error:
            raise _kept(error, folder) from error
        finally:
            _held.discard(key)


@contextmanager
def output_file_lock(file: Path) -> Iterator[None]:
    """Hold the lock of an output file during this context. Its missing folders are made first, and removed at the end where they are empty then.

    Raises Locked (one line) where another process holds it, ValueError where `file` is a folder, and OSError where it cannot be written.
    """
    if file.is_dir():
        raise ValueError(f"{file}: is a folder, needs a file name")
    real = Path(os.path.realpath(file))
    if real.exists() and os.access(real, os.W_OK) and not (real.is_file() and os.access(real.parent, os.W_OK)):
        # A device, or a file in a folder that cannot be written: it has no place for a lock.
        yield
        return
    with _output_lock(file, real.parent, f".{real.name}{LOCK}"):
        yield


@contextmanager
def _output_lock(output: Path, folder: Path, name: str) -> Iterator[None]:
    """Hold the lock `name` in a folder, which is made first. Errors of the system until then name the output."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        with ExitStack() as stack:
            try:
                check_writable(folder)
                folder.mkdir(parents=True, exist_ok=True)
                stack.enter_context(file_lock(folder / name, subject=output))
            except OSError as error:
                number = error.errno or errno.EACCES
                raise OSError(number, f"cannot be written ({os.strerror(number)}); choose another place", str(output)) from None
            yield
    finally:
        for each in missing:
            with suppress(OSError):
                each.rmdir()


@contextmanager
def file_lock(path: Path, wait: bool = False, subject: Path | None = None) -> Iterator[None]:
    """Hold the lock on the file `path` during this context. The file is removed at the end.

    The holder's process, host and time stand in a second file, `path` with `.pid` appended. It only serves messages: the operating system
    keeps the lock. Where a file system has no locks, the existence of a file (SoftFileLock) replaces them.

    wait: wait until the lock is free. Without it, raises Locked (one line) where another process holds the lock. subject: what is locked, for
    messages; the folder where None. Raises FileNotFoundError where the folder does not exist.
    """
    subject, holder = subject or path.parent, holder_file(path)
    path.parent.stat()  # FileLock would make the folder.
    try:
        lock = _acquired(path, wait)
    except Timeout:
        message = f"{subject}: is being written by another pilsim ({_holder(holder)}); wait for it, or choose another place"
        raise Locked(message) from None
    try:
        _warn_of_another_host(holder, subject)
        holder.write_text(f"{os.getpid()} {socket.gethostname()} {datetime.now():%Y-%m-%d %H:%M:%S}\n", encoding="utf-8")
        yield
    finally:
        # Both files are removed while the lock is held: after the release they may belong to the next process.
        # On POSIX a waiting process finds, once it has locked this file, that the file has no name, and opens a new one.
        # Windows cannot remove a file that is open: filelock removes it there.
        for file in (holder, path) if os.name == "posix" else (holder,):
            with suppress(OSError):
                file.unlink()
        with suppress(OSError):
            lock.release()


def holder_file(path: Path) -> Path:
    """The file that names the process that holds the lock on `path`."""
    return path.with_name(f"{path.name}.pid")


def _acquired(path: Path, wait: bool) -> BaseFileLock:
    """The lock on `path`, acquired. Raises Timeout where another process holds it."""
    lock: BaseFileLock = FileLock(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Without locks of the file system, filelock warns, and goes on with a file.
        try:
            lock.acquire(blocking=wait)
        except OSError as error:
            if isinstance(error, Timeout) or error.errno not in _WITHOUT_LOCKS:
                raise
            lock = SoftFileLock(path.with_name(f"{path.name}.soft"))
            lock.acquire(blocking=wait)
    return lock


def _words(holder: Path) -> list[str]:
    """Process, host, date and time in the file of a holder; none where it is not written yet or is being removed."""
    try:
        words = holder.read_text(encoding="utf-8", errors="replace")[:LONGEST].split()
    except OSError:
        return []
    return words if len(words) >= 3 else []


def _holder(holder: Path) -> str:
    """The process in this file, as `process 7 on host, since 2026-01-31 12:00:00`."""
    words = _words(holder)
    return f"process {words[0]} on {words[1]}, since {' '.join(words[2:])}" if words else "process unknown"


def _warn_of_another_host(holder: Path, subject: Path) -> None:
    """Warn on standard error that another host began to write and did not finish: on some shared file systems, locks hold within one host only."""
    words = _words(holder)
    if words and words[1] != socket.gethostname() and sys.stderr is not None:
        print(f"note: {subject}: {_holder(holder)}, did not end its work here; if it still runs, stop one of the two", file=sys.stderr)


def _kept(error: OSError, folder: Path) -> OSError:
    """The error, with the place of the unfinished output where its message does not name it."""
    if isinstance(error, Kept):
        return error
    if not folder.is_dir():
        return OSError(errno.ENOENT, "was removed or renamed while pilsim wrote into it", str(folder))
    if is_free(folder):
        return error
    return Kept.of(error, folder, "what was made so far")
