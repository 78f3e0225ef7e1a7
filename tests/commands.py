"""Commands of pilsim as a user starts them: each in a process of its own, with its exit code and what it printed.

A server process imports what commands need and loads the tracker's kernels once, and is forked for each command. That saves seconds a start.
Tests of the start itself (interrupts, streams, limits of memory) start the interpreter instead.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
LIMIT = 600.0
"""Longest time of a command, s."""


def pilsim(*words: object, cwd: Path = ROOT, env: Mapping[str, str] | None = None, limit: float = LIMIT) -> subprocess.CompletedProcess[str]:
    """Run a command in the folder `cwd`. env: variables beside those of the test. Raises TimeoutError after `limit` s."""
    server = _server()
    assert server.stdin is not None
    assert server.stdout is not None
    with tempfile.TemporaryDirectory() as folder:
        files = [str(Path(folder, name)) for name in ("stdout", "stderr")]
        arguments = [str(word) for word in words]
        order = {"words": arguments, "cwd": str(cwd), "env": {**os.environ, **(env or {})}, "files": files, "limit": limit}
        server.stdin.write(json.dumps(order) + "\n")
        server.stdin.flush()
        code = int(server.stdout.readline())
        if code == -signal.SIGALRM:
            raise TimeoutError(f"pilsim {' '.join(arguments)} takes more than {limit:g} s")
        printed = [Path(file).read_text(encoding="utf-8", errors="replace") for file in files]
    return subprocess.CompletedProcess(["pilsim", *arguments], code, *printed)


@cache
def _server() -> subprocess.Popen[str]:
    server = subprocess.Popen([sys.executable, "-m", "tests.commands"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, text=True)
    atexit.register(server.kill)
    return server


def _serve() -> None:
    """Run orders from standard input, a line each, and answer with their exit codes: negative for a signal."""
    from sim.cli.main import main  # noqa: F401  every command finds these imported
    from sim.datasets import generation  # noqa: F401
    from sim.stress import runner  # noqa: F401
    from tracker.geometry.compile_ahead import compile_listed, listed

    compile_listed(list(range(len(listed()))), os.getppid())  # found in numba's cache, where it is warm
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _run(**json.loads(line))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(words: list[str], cwd: str, env: dict[str, str], files: list[str], limit: float) -> None:
    """Be the command: the process ends here."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, limit)
    for target, file in enumerate([os.devnull, *files]):
        os.dup2(os.open(file, os.O_RDWR | os.O_CREAT), target)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    sys.argv = ["pilsim", *words]
    from sim.cli.main import main

    code: object = 1
    try:
        main()
        code = 0
    except SystemExit as ended:
        code = ended.code
    except BaseException:
        sys.excepthook(*sys.exc_info())  # type: ignore[arg-type]
    finally:
        atexit._run_exitfuncs()  # a fork ends without the interpreter's own end
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else 0 if code is None else 1)


if __name__ == "__main__":
    _serve()
