"""Compilation of the tracker's kernels before they are needed, by other processes, into numba's cache on disk.

`kernels.json` lists each kernel that the tracker calls from Python, with the types of its arguments. `compiling` starts the processes.
The compiled code, and so every result, is the same as without `compiling`.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba

LISTED = Path(__file__).with_name("kernels.json")
"""Rows [module, kernel, types of its arguments], in the order in which a tracker first needs them."""

types: Any = numba.types


def listed() -> list[tuple[Any, tuple[Any, ...]]]:
    """The kernels of the list, and the types of their arguments."""
    rows = json.loads(LISTED.read_text())
    return [(getattr(importlib.import_module(module), name), tuple(map(type_of, arguments))) for module, name, arguments in rows]


def type_of(text: str | list[Any]) -> Any:
    """The type of an argument: `int64`, `float64[2C]` for an array of two axes, `float64[2C!]` for a read-only one.

    A list begins with `tuple` or with the module and name of a named tuple's class, as module:Name.
    """
    if isinstance(text, list):
        parts = [type_of(part) for part in text[1:]]
        if text[0] == "tuple":
            return types.Tuple(parts)
        module, name = text[0].split(":")
        return types.BaseTuple.from_types(parts, getattr(importlib.import_module(module), name))
    if "[" in text:
        scalar, axes = text.rstrip("]").split("[")
        return types.Array(type_of(scalar), int(axes[0]), axes[1], readonly=axes.endswith("!"))
    return types.boolean if text == "bool" else getattr(types, text)


def missing() -> list[int]:
    """Numbers in the list of the kernels whose cache is absent, or older than their file. Kernels that cannot be cached are left out."""
    return [number for number, (kernel, _) in enumerate(listed()) if kernel.stats.cache_path is not None and not _is_cached(kernel)]


def _is_cached(kernel: Any) -> bool:
    source = Path(kernel.py_func.__code__.co_filename)
    indices = Path(kernel.stats.cache_path).glob(f"{source.stem}.{kernel.py_func.__name__}-*.nbi")
    return any(index.stat().st_mtime >= source.stat().st_mtime for index in indices)


def compile_listed(numbers: list[int], parent: int) -> None:
    """Compile kernels by their numbers in the list. The call ends early where the process `parent` is no longer the parent of this one."""
    kernels = listed()
    # The compiler makes many long-lived objects. Garbage collection skips the modules (frozen), and runs rarely for these objects.
    gc.freeze()
    gc.set_threshold(20_000, 10, 50)
    for kernel, arguments in (kernels[number] for number in numbers):
        if os.getppid() != parent:
            return
        # A kernel that cannot be compiled here is left to the process that needs it, which reports the error.
        with suppress(Exception):
            kernel.compile(arguments)


@contextmanager
def compiling(processes: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Compile the missing kernels in other processes during this context. Yields the processes: wait for all before the tracker starts.

    processes: the most to start; more than two are never started, and none if no kernel is missing. Processes that still run at the end are killed.
    """
    numbers = missing() if processes > 0 else []
    rows = json.loads(LISTED.read_text())
    # Kernels of one package call the same functions, which one process compiles only once.
    large = [number for number in numbers if rows[number][0].startswith("tracker.mht")]
    shares = [large, sorted(set(numbers) - set(large))] if processes > 1 else [numbers]
    started = []
    try:
        for share in filter(None, shares):
            command = [sys.executable, "-m", "tracker.geometry.compile_ahead", str(os.getpid()), *map(str, share)]
            with suppress(OSError):
                started.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        yield started
    finally:
        for process in started:
            process.kill()
            process.wait()


if __name__ == "__main__":
    compile_listed([int(number) for number in sys.argv[2:]], int(sys.argv[1]))
