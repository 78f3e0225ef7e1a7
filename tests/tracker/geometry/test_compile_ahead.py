"""The list of kernels that are compiled ahead, and the processes that compile them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba import types
from numba.core.dispatcher import Dispatcher

from tracker.geometry import compile_ahead
from tracker.geometry.compile_ahead import LISTED, listed, type_of

ROWS = json.loads(LISTED.read_text())
SMALL = next(number for number, row in enumerate(ROWS) if row[1] == "_sum_of_ratios")
"""A kernel that is compiled in a fifth of a second."""


def described(kind: Any) -> str | list[Any]:
    """The inverse of `type_of`."""
    if isinstance(kind, types.Array):
        return f"{kind.dtype}[{kind.ndim}{kind.layout}{'' if kind.mutable else '!'}]"
    if isinstance(kind, types.BaseNamedTuple):
        return [f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}", *map(described, kind)]
    return ["tuple", *map(described, kind)] if isinstance(kind, types.BaseTuple) else str(kind)


def in_use() -> list[list[Any]]:
    """Rows as of the list: the kernels of `tracker` that Python called in this process, where compiled code came from the cache."""
    rows = []
    for name, module in sorted(sys.modules.items()):
        if name.startswith("tracker."):
            own = [value for value in vars(module).values() if isinstance(value, Dispatcher) and value.py_func.__module__ == name]
            rows += [[name, one.py_func.__name__, [described(kind) for kind in kinds]] for one in dict.fromkeys(own) for kinds in one.signatures]
    return rows


def run(code: str, cache: Path | None, *arguments: str, folder: Path | None = None) -> Any:
    """The JSON value in the last line that a program prints in a new process. cache: where numba keeps compiled code."""
    places = {"NUMBA_CACHE_DIR": str(cache)} if cache else {}
    path = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
    command, environment = [sys.executable, "-c", code, *arguments], os.environ | places | {"PYTHONPATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_listed_kernels_exist_with_as_many_arguments() -> None:
    for (module, name, arguments), (kernel, kinds) in zip(ROWS, listed(), strict=True):
        assert kernel.py_func.__module__ == module, name
        assert kernel.py_func.__code__.co_argcount == len(kinds), name
        assert [described(kind) for kind in kinds] == arguments
        assert [described(type_of(argument)) for argument in arguments] == arguments


COMPILED = """
import json, sys
import sim
from tracker.geometry import compile_ahead as ahead

small, gone = int(sys.argv[1]), ahead.missing()
before = small in gone
ahead.missing = lambda: gone
with ahead.compiling(2) as processes:
    running = [process.poll() is None for process in processes]
killed = [process.returncode for process in processes]
ahead.missing = lambda: [small]
with ahead.compiling(2) as processes:
    codes = [process.wait() for process in processes]
with ahead.compiling(0) as none:
    pass
kernel, kinds = ahead.listed()[small]
cached = ahead._is_cached(kernel)
kernel.compile(kinds)
print(json.dumps([before, running, killed, codes, len(none), cached, sum(kernel.stats.cache_hits.values())]))
"""


@pytest.mark.command
def test_other_processes_compile_what_is_missing_and_end_with_the_context(tmp_path: Path) -> None:
    assert run(COMPILED, tmp_path / "cache", str(SMALL)) == [True, [True, True], [-9, -9], [0], 0, True, 1]


IN_USE = """
import json, sys
from pilsim import main
from tests.tracker.geometry.test_compile_ahead import in_use

sys.argv = ["pilsim", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print()
print(json.dumps(in_use()))
"""


@pytest.mark.soak
def test_all_kernels_of_a_demo_are_listed(tmp_path: Path) -> None:
    demo = ("demo", "--frames", "16", "--width", "256", "--seed", "3", "--out")
    # Where nothing was compiled before, the first run lists the kernels that others call, too.
    run(IN_USE, None, *demo, "first", folder=tmp_path)
    used = run(IN_USE, None, *demo, "second", folder=tmp_path)
    others = [row[:2] for row in used if row not in ROWS]
    # The simulated detector needs these at once, so that they are not left to another process.
    assert all(row in (["tracker.geometry.ground", "_heights"], ["tracker.geometry.ground", "_march"]) for row in others), json.dumps(used)


def test_a_process_ends_where_its_parent_is_gone() -> None:
    # No process has this number: nothing is compiled, although the kernel is wanted.
    kernel, _ = listed()[SMALL]
    before = list(kernel.signatures)
    compile_ahead.compile_listed([SMALL], parent=-1)
    assert kernel.signatures == before
