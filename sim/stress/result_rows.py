"""The lines of results.jsonl, one a run of a trial."""

from __future__ import annotations

from pathlib import Path

from tracker.io.json_files import JsonObject, parse_json
from tracker.io.text_files import read_text

SCHEMA = 1
RESULTS = "results.jsonl"
LARGEST = 1 << 28
"""Largest size of the file, bytes."""


def read_result_rows(path: Path) -> tuple[list[JsonObject], bool]:
    """The rows of a file, and whether the last line has no end: an interrupted run leaves one, which is left out.

    Raises ValueError naming file and line for rows of another version, and where a row has no id, seed or tracker.
    """
    *lines, last = read_text(path, LARGEST).split("\n")
    rows = [JsonObject(parse_json(line, f"{path}:{k}"), f"{path}:{k}") for k, line in enumerate(lines, 1) if line.strip()]
    for row in rows:
        row.check_schema(SCHEMA)
        row.a("id", str), row.a("seed", int), row.maybe("error", str)
        if not isinstance(row.a("tracker", dict).get("name"), str):
            raise ValueError(f"{row.where}: tracker has no name")
    return rows, bool(last.strip())
