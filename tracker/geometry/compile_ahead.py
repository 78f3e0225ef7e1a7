"""Compilation of the tracker's kernels before they are needed, by other processes, into numba's cache on disk.

`kernels.json` lists each kernel that the tracker calls from Python, with the types of its arguments. `compiling` starts the processes.
The compiled code is the same as that of the first call, and so are all results.
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
from numba.core.dispatcher import Dispatcher

from tracker.geometry.compilation import RepairedCache

LISTED = Path(__file__).with_name("kernels.json")
"""Rows [module, kernel, types of its arguments], in the order in which a tracker first needs them."""

Described = str | list[Any]

types: Any = numba.types


def described(kind: Any) -> Described:
    """The type of an argument as JSON: `int64`, `float64[2C]` for an array of two axes, `float64[2C!]` for a read-only one.

    A list begins with `tuple` or with the module and name of a named tuple's class. Raises ValueError for other types.
    """
    if isinstance(kind, types.Array):
        return f"{kind.dtype}[{kind.ndim}{kind.layout}{'' if kind.mutable else '!'}]"
    if isinstance(kind, types.BaseNamedTuple):
        made = kind.instance_class
        return [f"{made.__module__}:{made.__qualname__}", *map(described, kind)]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", *map(described, kind)]
    if isinstance(kind, (types.Integer, types.Float, types.Boolean)):
        return str(kind)
    raise ValueError(f"{kind}: a type of argument that cannot be listed")


def type_of(text: Described) -> Any:
    """The inverse of `described`."""
    if isinstance(text, list):
        parts = [type_of(part) for part in text[1:]]
        if text[0] == "tuple":
            return types.Tuple(parts)
        module, name = text[0].split(":")
        made = getattr(importlib.import_module(module), name)
        return types.BaseTuple.from_types(parts, made)
    if "[" in text:
        scalar, axes = text.rstrip("]").split("[")
        return types.Array(type_of(scalar), int(axes[0]), axes[1], readonly=axes.endswith("!"))
    return types.boolean if text == "bool" else getattr(types, text)


def in_use() -> list[list[Any]]:
    """Rows as of LISTED: the kernels of `tracker` that Python called in this process, where compiled code came from the cache.

    Kernels that this process compiled itself are listed together with those that they call.
    """
    rows = []
    for name, module in sorted(sys.modules.items()):
        if name.startswith("tracker."):
            own = [value for value in vars(module).values() if isinstance(value, Dispatcher) and value.py_func.__module__ == name]
            rows += [
                [name, kernel.py_func.__name__, [described(kind) for kind in arguments]]
                for kernel in dict.fromkeys(own)
                for arguments in kernel.signatures
            ]
    return rows


def missing() -> list[int]:
    """The numbers of listed kernels that are not in the cache. Kernels that cannot be cached are left out."""
    found = []
    for number, (module, name, arguments) in enumerate(json.loads(LISTED.read_text())):
        cache = getattr(getattr(importlib.import_module(module), name), "_cache", None)
        if isinstance(cache, RepairedCache) and not cache.holds(tuple(type_of(kind) for kind in arguments)):
            found.append(number)
    return found


def compile_listed(numbers: list[int], parent: int | None = None) -> None:
    """Compile kernels by their numbers in the list. The call ends early where the process `parent` is no longer the parent of this one."""
    rows = json.loads(LISTED.read_text())
    # The compiler makes many objects that live long. Garbage collection visits the modules never, and these seldom.
    gc.freeze()
    gc.set_threshold(20_000, 10, 50)
    for number in numbers:
        if parent is not None and os.getppid() != parent:
            return
        module, name, arguments = rows[number]
        # A kernel that cannot be compiled here is left to the process that needs it, which says why.
        with suppress(Exception):
            getattr(importlib.import_module(module), name).compile(tuple(type_of(kind) for kind in arguments))


@contextmanager
def compiling(processes: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Other processes compile what is missing during this context. Yields them: wait for all before the tracker starts.

    processes: their number at most; none is started where nothing is missing. Those that still run at the end are killed.
    """
    numbers = missing() if processes > 0 else []
    rows = json.loads(LISTED.read_text())
    # Kernels of one package call the same others, which one process compiles once.
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
            if process.poll() is None:
                process.kill()
            process.wait()


if __name__ == "__main__":
    compile_listed([int(number) for number in sys.argv[2:]], int(sys.argv[1]))
