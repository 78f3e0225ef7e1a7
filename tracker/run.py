"""Track a sequence into a folder, or read the results of the same run there."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from tracker.io.atomic import write_or_rescue
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.io.resume import OTHERWISE, check_same, holds_run, json_value
from tracker.pipeline import Parameters, track
from tracker.sequence.results import RUN, Results, read_results, write_results
from tracker.types import Sequence


def tracked(sequence: Sequence, folder: Path, run: Mapping[str, Any], parameters: Parameters | None = None, threads: int = 1) -> Results:
    """Track a sequence with a progress bar and write the results, or read them where the same run is there already.

    threads: as of tracker.pipeline.track; the results do not depend on it.
    run: what is tracked, as JSON values by name; provenance and parameters are added to it.
    Raises ValueError where `folder` holds another run, or one that pilsim 0.3.0 or older wrote, and where another process writes into it.
    Raises Kept where the results cannot be written there, with the place where they are instead.
    """
    wanted = json_value({**run, "provenance": sequence.provenance, "parameters": parameters or Parameters()})
    if (there := _same_run(folder, wanted)) is not None:
        return there
    graphs = parameters.targets.graphs if parameters is not None else None
    if graphs is not None and graphs.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{graphs}: lies in {folder}, needs a place outside it for the graphs")
    with folder_lock(folder), nullcontext() if graphs is None else folder_lock(graphs):
        # Another process may have written the results before the lock was free.
        return _same_run(folder, wanted) or _new_run(sequence, folder, wanted, parameters, threads)


def check_output(folder: Path) -> None:
    """Raises as `tracked` does where nothing can be written into `folder`. Call it before a sequence is opened, which may take long."""
    if not holds_run(folder, RUN):
        with folder_lock(folder):
            pass


def _same_run(folder: Path, wanted: Mapping[str, Any]) -> Results | None:
    """The results of the same run in a folder; None where it holds none. Raises ValueError where it holds another one."""
    if not holds_run(folder, RUN):
        return None
    there = read_results(folder)
    if written_by_old_version(there.run):
        raise ValueError(f"{folder}: was written by pilsim 0.3.0 or older, whose parameters cannot be compared; {OTHERWISE}")
    check_same(folder, there.run, wanted)
    return there


def _new_run(sequence: Sequence, folder: Path, wanted: dict[str, Any], parameters: Parameters | None, threads: int) -> Results:
    """Track a sequence and write the results into a folder without content."""
    estimates = track(sequence.setup, sequence.ticks, parameters, threads)
    results = Results.of(progress_bar(estimates, total=len(sequence.ticks), desc="tracking", unit="frame"), wanted)
    write_or_rescue(folder, lambda place: write_results(place, results))
    return results


def written_by_old_version(run: Mapping[str, Any]) -> bool:
    """Whether pilsim 0.3.0 or older wrote a run.json: its parameters are a text, which cannot be compared."""
    return isinstance(run.get("parameters"), str)
