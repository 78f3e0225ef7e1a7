"""A claim on a path that one process at a time can hold, and that goes with the process however it ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Claimed(ValueError):  # noqa: N818  it is what happened, and one line for who asked
    """Somebody else holds the claim."""


@contextmanager
def claim(path: Path, wait: bool = False) -> Iterator[None]:
    """Hold `path`, a file of no content that is made and removed, during this context. Whatever a dead process held is free.

    wait: until it is free; else raises Claimed, in one line, where another process holds it.
    """
    held = _take(path, wait)
    try:
        os.truncate(held, 0)
        os.write(held, f"{os.getpid()}\n".encode())
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(held)


def _take(path: Path, wait: bool) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            # Who held it before may have removed it while we waited: then another file may bear its name by now.
            if path.exists() and os.path.samestat(os.fstat(descriptor), path.stat()):
                return descriptor
        except FileNotFoundError:
            pass
        except BlockingIOError:
            holder = path.read_text().strip() or "unknown"
            os.close(descriptor)
            raise Claimed(f"{path.parent}: another run (process {holder}) writes into it; wait for it, or choose another --out") from None
        os.close(descriptor)
