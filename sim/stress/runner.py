"""Running sweeps: trials on all cores or on a cluster, a row each in results.jsonl; what is whole is kept, and the same command goes on there."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.parallel.file_lock import file_lock, holder_file
from sim.parallel.pool import Pool
from sim.recording.record import versions
from sim.stress.trial import SCHEMA, Trial, blank
from sim.stress.worker import Worker
from tracker.io.atomic import write_text
from tracker.io.resume import check_same, holds

RESULTS, RUN, LOCK = "results.jsonl", "run.json", ".lock"
Key = tuple[str, int, str]

_workers: dict[tuple[int, float], Worker] = {}


@dataclass(frozen=True)
class Force:
    """workers, cluster: as in Workforce; limit s that a trial may take."""

    workers: int = 1
    cluster: str | None = None
    limit: float = 1800.0

    def __post_init__(self) -> None:
        _ = self.workforce  # it checks the number
        if not self.limit > 0:
            raise ValueError(f"--limit is {self.limit} s, needs more than 0")

    @property
    def workforce(self) -> Pool:
        return Pool(self.workers, self.cluster)


def sweep(trials: Iterable[Trial], folder: Path, force: Force, command: str, progress: Callable[..., Any] | None = None) -> list[dict[str, Any]]:
    """All rows of the folder, those of the trials among them; trials whose row is there without an error are not run again.

    progress: like tqdm, wraps the rows as they come. Raises ValueError where another command is at work in the folder, or where it is none, or holds
    something else or results of another version.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file, needs a folder")
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder):
        rows = {key_of(row): row for row in _whole_rows(folder)}
        wanted = list(trials)
        done = {key for key, row in rows.items() if row["error"] is None}
        done -= {trial.key for trial in wanted if trial.key in done and not _is_of(folder, rows[trial.key], trial)}
        todo = [trial for trial in wanted if trial.key not in done]
        _write_run(folder, command)
        # What failed is tried again; what is kept is written anew, so that a torn line is gone.
        _write_rows(folder, [row for key, row in rows.items() if key in done])
        made = _rows(todo, force)
        shown = progress(made, total=len(todo)) if progress else made
        with (folder / RESULTS).open("a", encoding="utf-8") as file:
            for row in shown:
                rows[key_of(row)] = row
                file.write(json.dumps(row) + "\n")
                file.flush()
                os.fsync(file.fileno())
        ordered = [rows[key] for key in sorted(rows, key=_order)]
        _write_rows(folder, ordered)
    return ordered


def key_of(row: dict[str, Any]) -> Key:
    """Of what a row is: id, seed, tracker."""
    return row["id"], row["seed"], row["tracker"]["name"]


def _is_of(folder: Path, row: dict[str, Any], trial: Trial) -> bool:
    """Whether a row is all that a trial would give; not where only its ladder is missing. Raises ValueError where it is of another run."""
    asked = blank(trial)
    wanted = {name: asked[name] for name in ("scenario", "tracker", "rendered", "value")}
    check_same(folder, row, wanted, f"{row['id']} seed {row['seed']} of another run")
    return row["ladder"] is not None or not trial.climbs


def _order(key: Key) -> tuple[str, int, int, str]:
    name, _, number = key[0].partition("/")
    return name, int(number) if number.isdecimal() else 0, key[1], key[2]


def _rows(trials: list[Trial], force: Force) -> Iterator[dict[str, Any]]:
    """Rows as they come."""
    if not trials:
        return
    calls = ((trial.to_json(), force.limit) for trial in trials)
    # By threads: each waits for a process of its own, which does the work.
    yield from force.workforce.as_they_come(_row, calls, threads=True)


def _row(trial: str, limit: float) -> dict[str, Any]:
    """In a thread or on a machine of the cluster: the row of a trial, by this thread's own process."""
    mine = threading.get_ident(), limit
    if mine not in _workers:
        _workers[mine] = Worker(limit)
    return _workers[mine].row(Trial.from_json(trial))


def close_workers() -> None:
    """End all processes that wait for trials."""
    for worker in _workers.values():
        worker.close()
    _workers.clear()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Nobody else writes rows here meanwhile."""
    with file_lock(folder / LOCK):
        try:
            yield
        finally:
            close_workers()


def _whole_rows(folder: Path) -> list[dict[str, Any]]:
    """The rows of a folder; a last line that was cut off in writing is left out. Raises ValueError for anything else that is no row."""
    path = folder / RESULTS
    if not holds(folder, RESULTS, (LOCK, holder_file(folder / LOCK).name, RUN, "moments")):
        return []
    lines = path.read_bytes().split(b"\n")
    out = []
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            row = json.loads(line)
        except ValueError:
            if number == len(lines):
                continue
            raise ValueError(f"{path}:{number}: not JSON") from None
        if not isinstance(row, dict) or row.get("schema") != SCHEMA:
            raise ValueError(f"{path}:{number}: schema is {row.get('schema') if isinstance(row, dict) else None}, this version reads {SCHEMA}")
        out.append(row)
    return out


def _write_rows(folder: Path, rows: list[dict[str, Any]]) -> None:
    write_text(folder / RESULTS, "".join(json.dumps(row) + "\n" for row in rows))


def _write_run(folder: Path, command: str) -> None:
    write_text(folder / RUN, json.dumps({"schema": SCHEMA, "command": command, "versions": versions()}, indent=1) + "\n")
