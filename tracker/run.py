"""Track a sequence into a folder, or read the results of the same run there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tracker.io.atomic import check_writable
from tracker.io.progress import progress_bar
from tracker.io.resume import OTHERWISE, check_same, holds_run, json_value
from tracker.pipeline import Parameters, track
from tracker.sequence.results import RUN, Results, read_results, write_results
from tracker.types import Sequence


def tracked(sequence: Sequence, folder: Path, run: Mapping[str, Any], parameters: Parameters | None = None) -> Results:
    """Track a sequence with a progress bar and write the results, or read them where the same run is there already.

    run: what is tracked, as JSON values by name; provenance and parameters are added to it.
    Raises ValueError where `folder` holds another run, or one that pilsim 0.3.0 or older wrote.
    """
    wanted = json_value({**run, "provenance": sequence.provenance, "parameters": parameters or Parameters()})
    if holds_run(folder, RUN):
        there = read_results(folder)
        if written_by_old_version(there.run):
            raise ValueError(f"{folder}: was written by pilsim 0.3.0 or older, whose parameters cannot be compared; {OTHERWISE}")
        check_same(folder, there.run, wanted)
        return there
    check_writable(folder)
    estimates = track(sequence.setup, sequence.ticks, parameters)
    results = Results.of(progress_bar(estimates, total=len(sequence.ticks), desc="tracking", unit="frame"), wanted)
    write_results(folder, results)
    return results


def written_by_old_version(run: Mapping[str, Any]) -> bool:
    """Whether pilsim 0.3.0 or older wrote a run.json: its parameters are a text, which cannot be compared."""
    return isinstance(run.get("parameters"), str)


def views_of(run: Mapping[str, Any]) -> list[int]:
    """The views of a run.json. Raises ValueError where they are not a list of numbers."""
    views = run.get("views", [])
    if not isinstance(views, list) or not all(isinstance(view, int) for view in views):
        raise ValueError(f"run.json: views is {views!r}, needs a list of numbers")
    return views
