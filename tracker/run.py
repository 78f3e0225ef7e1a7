"""Track a sequence into a folder, or read the results of the same run there."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from tracker.io.atomic import write_or_rescue
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.io.resume import OTHERWISE, check_same, holds_run, json_value, same_or_new
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
    graphs = parameters.graphs if parameters is not None else None
    if graphs is not None and graphs.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{graphs}: lies in {folder}, needs a place outside it for the graphs")

    def new() -> Results:
        with nullcontext() if graphs is None else folder_lock(graphs):
            estimates = track(sequence.setup, sequence.ticks, parameters, threads)
            results = Results.of(progress_bar(estimates, total=len(sequence.ticks), desc="tracking", unit="frame"), wanted)
            write_or_rescue(folder, lambda place: write_results(place, results))
        return results

    return same_or_new(folder, lambda: _same_run(folder, wanted), new)


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
    if isinstance(there.run.get("parameters"), str):
        raise ValueError(f"{folder}: was written by pilsim 0.3.0 or older, whose parameters cannot be compared; {OTHERWISE}")
    check_same(folder, there.run, wanted)
    return there
