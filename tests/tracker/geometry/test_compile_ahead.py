"""The list of kernels that are compiled ahead, and the processes that compile them."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tracker.geometry import compile_ahead
from tracker.geometry.compile_ahead import LISTED, described, type_of

ROWS = json.loads(LISTED.read_text())
SMALL = next(number for number, row in enumerate(ROWS) if row[1] == "_sum_of_ratios")
"""A kernel that is compiled in a fifth of a second."""


def run(code: str, cache: Path | None, *arguments: str, folder: Path | None = None) -> Any:
    """The JSON value in the last line that a program prints in a new process. cache: where numba keeps compiled code."""
    places = {"NUMBA_CACHE_DIR": str(cache)} if cache else {}
    path = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
    command, environment = [sys.executable, "-c", code, *arguments], os.environ | places | {"PYTHONPATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[1])
def test_listed_kernels_exist_with_as_many_arguments(row: list[Any]) -> None:
    module, name, arguments = row
    kernel = getattr(importlib.import_module(module), name)
    assert kernel.py_func.__module__ == module
    assert kernel.py_func.__code__.co_argcount == len(arguments)
    for argument in arguments:
        assert described(type_of(argument)) == argument


def test_types_that_cannot_be_listed_are_refused() -> None:
    from numba import types

    with pytest.raises(ValueError, match="cannot be listed"):
        described(types.unicode_type)


PROCESSES = """
import json, sys
import sim
from tracker.geometry import compile_ahead as ahead

small, gone = int(sys.argv[1]), ahead.missing()
before = small in gone
ahead.missing = lambda: [small]
with ahead.compiling(2) as processes:
    codes = [process.wait() for process in processes]
with ahead.compiling(0) as none:
    pass
import importlib
module, name, arguments = json.loads(ahead.LISTED.read_text())[small]
kernel = getattr(importlib.import_module(module), name)
kernel.compile(tuple(map(ahead.type_of, arguments)))
print(json.dumps([before, codes, len(none), sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values())]))
"""


@pytest.mark.command
def test_another_process_compiles_what_is_missing_and_this_one_finds_it(tmp_path: Path) -> None:
    assert run(PROCESSES, tmp_path / "cache", str(SMALL)) == [True, [0], 0, 1, 0]


KILLED = """
import json, sys
import sim
from tracker.geometry import compile_ahead as ahead

with ahead.compiling(2) as processes:
    running = [process.poll() is None for process in processes]
print(json.dumps([running, [process.returncode for process in processes]]))
"""


@pytest.mark.command
def test_processes_end_with_the_context(tmp_path: Path) -> None:
    running, codes = run(KILLED, tmp_path / "cache")
    assert running == [True, True]
    assert codes == [-9, -9]


IN_USE = """
import json, sys
from pilsim import main
from tracker.geometry.compile_ahead import in_use

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
    assert all(row in (["tracker.geometry.ground", "_heights"], ["tracker.geometry.ground", "_march"]) for row in others)


def test_a_process_ends_where_its_parent_is_gone() -> None:
    # No process has this number: nothing is compiled, although the kernel is wanted.
    kernel = getattr(importlib.import_module(ROWS[SMALL][0]), ROWS[SMALL][1])
    before = list(kernel.signatures)
    compile_ahead.compile_listed([SMALL], parent=-1)
    assert kernel.signatures == before
