"""The worst moments of a run: mistakes that belong together, the heaviest first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sim.causes import Mistake

KEPT = 10
"""Moments of a run."""
ALIKE = 4
"""At most so many of one kind and cause."""
PAUSE = 2
"""Frames without the mistake that do not end a moment."""


@dataclass(frozen=True)
class Moment:
    """Mistakes of one kind about one person or track, in frames that hang together: the one in the middle, and how many there are of each frame."""

    middle: Mistake
    weight: int
    first: int
    last: int

    def told(self, pictures: Sequence[str]) -> dict[str, Any]:
        """As it stands in a row."""
        m = self.middle
        position = [round(v, 3) for v in m.position]
        return {
            "frame": m.frame, "kind": m.kind, "cause": m.cause, "person": m.person, "position": position, "weight": self.weight,
            "pictures": list(pictures),
        }  # fmt: skip


def worst(found: Sequence[Mistake]) -> list[Moment]:
    """At most KEPT moments, the heaviest first, at most ALIKE of one kind and cause; a moment's cause is that of most of its mistakes."""
    rows: dict[tuple[str, int | None], list[list[Mistake]]] = {}
    for mistake in found:
        runs = rows.setdefault((mistake.kind, mistake.track if mistake.kind == "false positive" else mistake.person), [])
        if runs and mistake.frame - runs[-1][-1].frame <= PAUSE + 1:
            runs[-1].append(mistake)
        else:
            runs.append([mistake])
    moments = [_moment(run) for runs in rows.values() for run in runs]
    moments.sort(key=lambda m: (-m.weight, m.middle.frame, m.middle.kind, m.middle.person or 0, m.middle.track or 0))
    seen: Counter[tuple[str, str]] = Counter()
    out = []
    for moment in moments:
        seen[moment.middle.kind, moment.middle.cause] += 1
        if seen[moment.middle.kind, moment.middle.cause] <= ALIKE:
            out.append(moment)
    return out[:KEPT]


def _moment(run: list[Mistake]) -> Moment:
    cause = Counter(m.cause for m in run).most_common(1)[0][0]
    of_it = [m for m in run if m.cause == cause]
    return Moment(of_it[len(of_it) // 2], len(run), run[0].frame, run[-1].frame)


def stem(key: tuple[str, int, str]) -> str:
    """A file name for a run."""
    return re.sub(r"[^A-Za-z0-9]+", "-", "-".join(map(str, key))).strip("-")
