"""Trackers beside each other on the same runs: differences of scores, pair by pair of the same setting and seed.

Both see the same people on the same paths, so that what is hard in a scenario cancels in the difference. Over all settings, the differences of one
seed are averaged first: settings of one seed share their crowd, and only seeds are independent. Intervals are Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sim.intervals import Interval, mean_interval
from sim.report_rows import Row, Rows, read_rows

Key = tuple[str, int]
EVERY = "all settings"


@dataclass(frozen=True)
class Measure:
    """A score that is compared: its name in the rows, how it is written, which way is better, digits."""

    name: str
    label: str
    more_is_better: bool = True
    digits: int = 3


MEASURES = (Measure("mota", "MOTA"), Measure("idf1", "IDF1"), Measure("ate_m", "ATE [m]", more_is_better=False, digits=4))


@dataclass(frozen=True, eq=False)
class Entrant:
    """A tracker as it ran: a name, and its rows by setting and seed."""

    name: str
    rows: dict[Key, Row]


@dataclass(frozen=True, eq=False)
class Difference:
    """Of one measure at one setting (or EVERY): means over the pairs, and the entrant's less the reference's with its interval.

    pairs: runs compared; the interval's count is that of seeds.
    """

    id: str
    measure: Measure
    reference: float
    entrant: float
    interval: Interval
    pairs: int

    @property
    def words(self) -> str:
        """better, worse, no difference seen, identical, or one seed (of which no interval can be made)."""
        verdict = self.interval.verdict
        if verdict in ("higher", "lower"):
            return "better" if (verdict == "higher") == self.measure.more_is_better else "worse"
        return verdict


@dataclass(frozen=True, eq=False)
class Match:
    """An entrant against the reference; alone: rows of the reference and of the entrant without a partner; failed: pairs with a failed run."""

    entrant: Entrant
    alone: tuple[int, int]
    failed: int
    differences: tuple[Difference, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class Contest:
    """All entrants against the first."""

    reference: Entrant
    matches: tuple[Match, ...]


def contest(folders: Sequence[Path]) -> Contest:
    """Compare result folders, or the trackers of one: the first is the reference.

    Raises ValueError where there are not two to compare, where a setting of the same id and seed is another scenario, or where nothing can be paired.
    """
    entrants = _entrants([read_rows(folder) for folder in folders])
    if len(entrants) < 2:
        raise ValueError(f"{folders[0] if folders else 'nothing'}: holds one tracker ({entrants[0].name}), needs another folder or tracker beside it")
    reference, *others = entrants
    return Contest(reference, tuple(_match(reference, other) for other in others))


def _entrants(read: list[Rows]) -> list[Entrant]:
    names = [rows.folder.resolve().name for rows in read]
    if len(set(names)) < len(names):
        names = [str(rows.folder) for rows in read]
    if len(set(names)) < len(names):
        raise ValueError(f"{names[0]}: the same folder is given twice")
    out = []
    for name, rows in zip(names, read, strict=True):
        for tracker in rows.trackers:
            own = {(row.id, row.seed): row for row in rows.rows if row.tracker == tracker}
            out.append(Entrant(tracker if len(read) == 1 else f"{name}:{tracker}" if len(rows.trackers) > 1 else name, own))
    return out


def _match(reference: Entrant, entrant: Entrant) -> Match:
    both = [key for key in reference.rows if key in entrant.rows]
    if not both:
        ours, theirs = (", ".join(f"{id} of seed {seed}" for id, seed in sorted(one.rows)[:2]) for one in (reference, entrant))
        raise ValueError(f"{reference.name} and {entrant.name} share no setting and seed: {ours} …, but {theirs} …")
    for key in both:
        _check_same(reference.rows[key], entrant.rows[key])
    whole = [key for key in both if reference.rows[key].error is None and entrant.rows[key].error is None]
    alone = len(reference.rows) - len(both), len(entrant.rows) - len(both)
    ids = list(dict.fromkeys(id for id, _ in whole))
    groups = [*([EVERY] if len(ids) > 1 else []), *ids]
    found = [_difference(group, measure, reference, entrant, whole) for group in groups for measure in MEASURES]
    return Match(entrant, alone, len(both) - len(whole), tuple(one for one in found if one))


def _check_same(first: Row, second: Row) -> None:
    """Raises ValueError where two rows of one id and seed are not the same run."""
    where = f"{second.where} beside {first.where}: {first.id}, seed {first.seed}"
    for name in ("parameter", "value", "rendered"):
        if getattr(first, name) != getattr(second, name):
            raise ValueError(f"{where} is another scenario: {name} is {getattr(first, name)} and {getattr(second, name)}")
    for name in sorted({*first.scenario, *second.scenario}):
        if first.scenario.get(name) != second.scenario.get(name):
            raise ValueError(f"{where} is another scenario: {name} is {first.scenario.get(name)} and {second.scenario.get(name)}")


def _difference(group: str, measure: Measure, reference: Entrant, entrant: Entrant, keys: list[Key]) -> Difference | None:
    rows = [(key[1], reference.rows[key].scores, entrant.rows[key].scores) for key in keys if group in (EVERY, key[0])]
    known = [(seed, a[measure.name], b[measure.name]) for seed, a, b in rows if measure.name in a and measure.name in b]
    if not known:
        return None
    by_seed: dict[int, list[float]] = {}
    for seed, a, b in known:
        by_seed.setdefault(seed, []).append(b - a)
    interval = mean_interval([float(np.mean(values)) for values in by_seed.values()])
    before, after = (float(np.mean([row[k] for row in known])) for k in (1, 2))
    return Difference(group, measure, before, after, interval, len(known))


def described(found: Contest) -> str:
    """For a person to read."""
    lines = []
    for match in found.matches:
        lines += ["", f"{match.entrant.name}, beside {found.reference.name}{_unpaired(found, match)}"]
        wide = max(len(one.id) for one in match.differences) if match.differences else 0
        for one in match.differences:
            digits = one.measure.digits
            numbers = f"{one.reference:8.{digits}f} → {one.entrant:7.{digits}f}   {one.interval.text(digits, signed=True):31s}"
            lines.append(f"  {one.id:{wide}s}  {one.measure.label:7s} {numbers} {one.words} ({one.interval.count} seeds)")
        if not match.differences:
            lines.append("  no pair of runs that both have scores")
    said = "Differences: entrant less reference, mean and 95 % interval (Student's t over seeds); MOTA, IDF1: more is better; ATE: less."
    return "\n".join([*lines[1:], "", said, _chance(found)])


def _unpaired(found: Contest, match: Match) -> str:
    names = found.reference.name, match.entrant.name
    parts = [f"{n} run{'s' * (n != 1)} of {name} without a partner" for n, name in zip(match.alone, names, strict=True) if n]
    parts += [f"{match.failed} pair{'s' * (match.failed != 1)} with a failed run left out"] if match.failed else []
    return f" ({'; '.join(parts)})" if parts else ""


def _chance(found: Contest) -> str:
    """What chance alone would do, for who looks at many intervals."""
    told = sum(one.interval.low is not None and one.words != "identical" for match in found.matches for one in match.differences)
    sure = sum(one.words in ("better", "worse") for match in found.matches for one in match.differences)
    return f"{sure} of {told} intervals leave out 0; by chance alone it would be about {told / 20:.1f}."


def to_json(found: Contest) -> dict[str, Any]:
    """The same as JSON values."""

    def plain(one: Difference) -> dict[str, Any]:
        means = {"id": one.id, "measure": one.measure.name, "reference": one.reference, "entrant": one.entrant, "pairs": one.pairs}
        interval = one.interval
        return means | {"difference": interval.mean, "low": interval.low, "high": interval.high, "seeds": interval.count, "verdict": one.words}

    matches = [
        {"name": m.entrant.name, "alone": list(m.alone), "failed": m.failed, "differences": [plain(one) for one in m.differences]}
        for m in found.matches
    ]
    return {"reference": found.reference.name, "interval": "Student's t over seeds, 95 %", "entrants": matches}
