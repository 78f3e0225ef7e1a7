"""Sweeps that tell nothing, since every score in them is nearly perfect."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

SATURATED = 0.98
"""A sweep whose MOTA and IDF1 are all above this tells nothing of where a tracker breaks."""


def saturated(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Names of sweeps of at least two values whose scores are all above SATURATED, in the order of the rows.

    rows: of results.jsonl. Rows with an error or without scores say nothing of a sweep that has others.
    """
    scores: dict[str, list[float]] = {}
    values: dict[str, set[str]] = {}
    for row in rows:
        found = [row["scores"].get(name) for name in ("mota", "idf1")] if row.get("scores") else []
        known = [score for score in found if score is not None]
        if known:
            scores.setdefault(row["sweep"], []).extend(known)
            values.setdefault(row["sweep"], set()).add(row["id"])
    return [name for name, known in scores.items() if len(values[name]) > 1 and min(known) > SATURATED]
