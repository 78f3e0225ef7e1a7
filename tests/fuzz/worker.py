"""A process that reads damaged files, with bounds of time and memory, and reports what ends with anything but a value or a ValueError.

It reads one JSON object a line from standard input and answers with one line. An order has reader, way, count and seed.
The way "given" takes `inputs`, the content of each file in Latin-1, in place of count and seed.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import tempfile
import traceback
import types
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded

from tests.fuzz.mutations import damaged, edits
from tests.fuzz.readers import READERS, Reader

SECONDS, MEMORY = 10.0, 1 << 30
"""Bounds of one input: s and bytes."""


class TooSlow(BaseException):
    """An input took more than SECONDS. No reader catches it."""


def _late(number: int, frame: types.FrameType | None) -> None:
    raise TooSlow(f"took more than {SECONDS:g} s")


def limit_memory() -> None:
    """Let this process take MEMORY bytes more than it has now. Only Linux tells how much that is."""
    try:
        import resource

        now = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    except (ImportError, OSError):
        return


@contextmanager
def limited_time() -> Iterator[None]:
    """Raise TooSlow in the block after SECONDS of processor time, where the system has a timer: other processes do not count."""
    timer = getattr(signal, "setitimer", None)
    if timer:
        signal.signal(signal.SIGPROF, _late)
        timer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        if timer:
            timer(signal.ITIMER_PROF, 0)


class Trial:
    """The inputs of one reader: a folder with its valid files, of which one is damaged, and the faults found so far."""

    def __init__(self, reader: Reader, folder: Path, printed: Path) -> None:
        self.reader, self.folder, self.printed = reader, folder, printed
        reader.make(folder)
        self.file = folder / reader.file
        self.sample = self.file.read_bytes()
        self.inputs = self.refused = 0
        self.faults: dict[str, dict[str, Any]] = {}
        with warnings.catch_warnings():
            reader.read(folder)  # what is compiled or imported at first does not count
        limit_memory()

    def run(self, content: bytes) -> None:
        """Read one damaged file and note how it ended."""
        self.inputs += 1
        self.file.write_bytes(content)
        before = self.printed.stat().st_size
        fault = None
        try:
            with limited_time(), warnings.catch_warnings():
                warnings.simplefilter("error")
                self.reader.read(self.folder)
        except ValueError as error:
            self.refused += 1
            fault = self._fault_of(error)
        except (Exception, TooSlow) as error:
            fault = f"{type(error).__name__}: {error}"[:300], _origin(error)
        if self.printed.stat().st_size > before:
            with self.printed.open("rb") as file:
                file.seek(before)
                # The project's own notes begin with the file.
                foreign = [line for line in file.read().decode("utf-8", "replace").splitlines() if str(self.folder) not in line]
            if foreign:
                self._note((f"printed: {foreign[0][:200]}", "a library"), content)
        if fault:
            self._note(fault, content)

    def _fault_of(self, error: ValueError) -> tuple[str, str] | None:
        text = str(error)
        if type(error) is not ValueError:
            return f"{type(error).__name__}: {text}"[:300], _origin(error)
        if str(self.folder) not in text and self.file.name not in text:
            return f"does not name the file: {text}"[:300], _origin(error)
        if len(text.splitlines()) > 1 or len(text) > 1000:
            return f"is no single line of at most 1000 characters: {text!r}"[:300], _origin(error)
        return None

    def _note(self, fault: tuple[str, str], content: bytes) -> None:
        kind, where = fault[0].split(":")[0], fault[1]
        entry = self.faults.setdefault(f"{kind} at {where}", {"message": fault[0], "count": 0, "input": ""})
        entry["count"] += 1
        if not entry["input"] or len(content) < entry["size"]:
            entry["input"], entry["size"] = _shown(content, self.sample), len(content)
            if keep := os.environ.get("PILSIM_FUZZ_KEEP"):
                name = f"{self.reader.name}-{kind}-{where}".replace("/", "_").replace(" ", "_")
                Path(keep).mkdir(parents=True, exist_ok=True)
                Path(keep, name[:150]).write_bytes(content)


def _origin(error: BaseException) -> str:
    """The last line of the project in the traceback."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "/tests/" not in f.filename and "site-packages" not in f.filename]
    own = [f for f in frames if any(f"/{house}/" in f.filename for house in ("tracker", "sim", "worlds"))]
    last = (own or frames or [None])[-1]
    return f"{'/'.join(Path(last.filename).parts[-2:])}:{last.lineno}" if last else "unknown"


def _shown(content: bytes, sample: bytes) -> str:
    """Where the content begins to differ from the sample."""
    at = next((k for k, (a, b) in enumerate(zip(content, sample, strict=False)) if a != b), min(len(content), len(sample)))
    return f"from byte {at}: {content[max(at - 20, 0) : at + 60]!r}"


def by_bytes(trial: Trial, count: int, seed: int) -> None:
    """Read `count` files with damaged bytes."""
    rng = random.Random(f"{trial.reader.name} {seed}")
    for _ in range(count):
        trial.run(damaged(trial.sample, rng))


def by_form(trial: Trial, count: int, seed: int) -> None:
    """Read `count` files with exchanged tokens, lines or JSON values."""
    strategy = edits(trial.sample)
    if strategy.is_empty:
        return
    check = HealthCheck
    bounds = settings(
        max_examples=count, deadline=None, database=None, phases=[Phase.generate], suppress_health_check=[check.too_slow, check.data_too_large]
    )
    seeded(seed)(bounds(given(strategy)(trial.run)))()


WAYS: dict[str, Callable[[Trial, int, int], None]] = {"bytes": by_bytes, "form": by_form}


def answer(order: dict[str, Any], root: Path, printed: Path) -> dict[str, Any]:
    """Run one order in a folder of its own."""
    folder = root / "case"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    trial = Trial(READERS[order["reader"]], folder, printed)
    if order["way"] == "given":
        for content in order["inputs"]:
            trial.run(content.encode("latin-1"))
    else:
        WAYS[order["way"]](trial, order["count"], order["seed"])
    return {"inputs": trial.inputs, "refused": trial.refused, "faults": trial.faults}


def main() -> None:
    """Answer orders until standard input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    with tempfile.TemporaryDirectory() as root:
        printed = Path(root, "printed")
        file = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        own = os.dup(2)
        os.dup2(file, 1)
        os.dup2(file, 2)
        ask = partial(answer, root=Path(root), printed=printed)
        for line in sys.stdin:
            order = json.loads(line)
            try:
                out = ask(order)
            except BaseException:
                out = {"error": traceback.format_exc()}
            print(json.dumps(out), file=answers, flush=True)
        os.dup2(own, 2)


if __name__ == "__main__":
    main()
