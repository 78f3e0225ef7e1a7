"""Compilation of kernels by numba, with a cache on disk where one can be written.

Numba refuses to cache where neither the folder of the source nor the home of the user can be written, as in containers.
Numba's cache detects changes only in the function's own file. This cache also detects changes in imported kernels, and in constants that
the function uses, itself or in kernels of its own file.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import tempfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar, cast

import numba
from numba.core import config
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])


SILENT = 3.0
"""s of compilation before a message is logged."""


class _Compiling:
    """Logs once that functions are being compiled, if that takes longer than SILENT s. Only the main process logs it."""

    def __init__(self) -> None:
        self._began: float | None = None
        self._said = False

    def say(self) -> None:
        """Call it for each function that is not in the cache."""
        self._began = monotonic() if self._began is None else self._began
        if not self._said and monotonic() - self._began > SILENT and multiprocessing.parent_process() is None:
            self._said = True
            logging.getLogger("tracker.compiled").warning("compiling for this machine, which takes up to a minute and is kept for later runs")


_compiling = _Compiling()


class RepairedCache(FunctionCache):
    """The cache of one function. A truncated or unreadable cache is emptied, and a cache that cannot be written is left as it is."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._function = function
        del self._cache_file

    @cached_property
    def stamp(self) -> tuple[Any, ...]:
        """Stamp of the source. It is made at the first use, when the kernels below the function in its file are defined, too."""
        return self._impl.locator.get_source_stamp(), _imported(self._function)

    @cached_property
    def _cache_file(self) -> IndexDataCacheFile:  # type: ignore[override]
        return IndexDataCacheFile(self._cache_path, self._impl.filename_base, self.stamp)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled function of a signature, None where there is none."""
        try:
            found = super().load_overload(signature, context)
        except Exception:
            self._empty()
            found = None
        if found is None:
            _compiling.say()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep a compiled function, if possible."""
        try:
            super().save_overload(signature, compiled)
        except Exception:
            self._empty()

    def _empty(self) -> None:
        try:
            self.flush()
        except Exception:
            self.disable()


def njit(cache: bool = False, **options: Any) -> Callable[[Function], Function]:
    """The decorator `numba.njit(**options)`. cache: keep compiled code on disk; without a folder for it, functions are compiled in every process."""
    compile_function = numba.njit(**options)

    def decorate(function: Function) -> Function:
        dispatcher = compile_function(function)
        if cache and (found := _cache_of(dispatcher.py_func)) is not None:
            dispatcher._cache = found
        return cast(Function, dispatcher)

    return decorate


def _imported(function: Callable[..., Any]) -> tuple[Any, ...]:
    """Dependencies of a function's compiled code: the stamps of the kernels that its file imports, and the constants of _names_used."""
    names, known = _names_used(function), sorted(function.__globals__.items())
    kernels = [value for _, value in known if isinstance(value, Dispatcher) and value.py_func.__module__ != function.__module__]
    stamps = tuple((kernel.py_func.__module__, getattr(vars(kernel).get("_cache"), "stamp", None)) for kernel in kernels)
    return stamps, tuple((name, repr(value)) for name, value in known if name in names and isinstance(value, (bool, int, float, tuple)))


def _names_used(function: Callable[..., Any]) -> set[str]:
    """Global names that a function uses, itself or in kernels of its file that it calls."""
    names: set[str] = set()
    left = [function]
    while left:
        new = set(left.pop().__code__.co_names) - names
        names |= new
        found = (function.__globals__.get(name) for name in new)
        left += [kernel.py_func for kernel in found if isinstance(kernel, Dispatcher) and kernel.py_func.__module__ == function.__module__]
    return names


def _cache_of(function: Callable[..., Any]) -> RepairedCache | None:
    """A cache in the place that numba chooses, else in the temporary folder of the system, else None."""
    try:
        return RepairedCache(function)
    except RuntimeError:
        settings = vars(config)
        before = settings["CACHE_DIR"]
    try:
        user = getattr(os, "getuid", int)()
        folder = Path(tempfile.gettempdir(), f"pilsim-numba-{user}")
        folder.mkdir(mode=0o700, exist_ok=True)
        # A cache holds code: a folder of this name that another user owns is not used.
        if folder.stat().st_uid != user:
            return None
        settings["CACHE_DIR"] = str(folder)
        return RepairedCache(function)
    except (OSError, RuntimeError):
        return None
    finally:
        settings["CACHE_DIR"] = before
