"""The results of a stress test, read from results.jsonl and grouped by sweep and setting."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval, bounds_of, mean_interval
from sim.stress.result_rows import RESULTS, read_result_rows
from tracker.io.json_files import JsonObject


@dataclass(frozen=True, eq=False)
class Row:
    """One run of one setting, seed and tracker. The setting `id` is the `sweep` with its `parameter` at `value`.

    error: the error of a failed run in one line, or None. scores: name → number; limits: name → bound; unknown ones are missing.
    causes: kind of error → cause → count. ablation: measure ("mota", "metres") → stage → what perfect input to it would recover, or empty; the
    file calls it ladder. moments: the worst moments. where: file and line.
    """

    id: str
    sweep: str
    parameter: str
    value: Any
    seed: int
    tracker: str
    options: dict[str, Any]
    scenario: dict[str, Any]
    rendered: bool
    error: str | None
    scores: dict[str, float]
    limits: dict[str, float]
    causes: dict[str, dict[str, float]]
    ablation: dict[str, dict[str, float]]
    moments: tuple[dict[str, Any], ...]
    versions: dict[str, Any]
    command: str
    where: str

    @property
    def frames(self) -> int | None:
        """Number of frames of the scenario, where it is known."""
        frames = self.scenario.get("frames")
        return frames if isinstance(frames, int) else None


@dataclass(frozen=True, eq=False)
class Setting:
    """The runs of one id: all seeds and trackers."""

    id: str
    value: Any
    rows: tuple[Row, ...]

    def of(self, tracker: str) -> list[Row]:
        """Runs of one tracker that did not fail, by seed."""
        return sorted((row for row in self.rows if row.tracker == tracker and row.error is None), key=lambda row: row.seed)

    def scores(self, tracker: str, name: str) -> dict[int, float]:
        """Seed → the score or bound of that name, where it is known."""
        return {row.seed: value for row in self.of(tracker) if (value := row.scores.get(name, row.limits.get(name))) is not None}

    def mean(self, tracker: str, name: str) -> Interval | None:
        """The mean of a score or bound over seeds with its interval, or None where no seed has it."""
        values = list(self.scores(tracker, name).values())
        return mean_interval(values, bounds=bounds_of(name)) if values else None


@dataclass(frozen=True, eq=False)
class SweepRows:
    """The settings of one sweep, which differ in one parameter, in the order of the numbers in their ids."""

    name: str
    parameter: str
    settings: tuple[Setting, ...]

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(s.value, (int, float)) and not isinstance(s.value, bool) for s in self.settings)

    def ordered(self) -> tuple[Setting, ...]:
        """Settings by value where all values are numbers, otherwise in their own order."""
        return tuple(sorted(self.settings, key=lambda s: s.value)) if self.numeric else self.settings


@dataclass(frozen=True, eq=False)
class Rows:
    """All rows of a folder. torn: whether the last line was cut off and left out. several: whether there are rows of other folders, too."""

    folder: Path
    rows: tuple[Row, ...]
    torn: bool
    several: bool = False

    @property
    def trackers(self) -> list[str]:
        """Names of the trackers, in the order of the rows."""
        return list(dict.fromkeys(row.tracker for row in self.rows))

    @property
    def failed(self) -> list[Row]:
        """The rows of runs that failed."""
        return [row for row in self.rows if row.error is not None]

    def sweeps(self) -> list[SweepRows]:
        """The sweeps in the order of the rows. Raises ValueError where an id has two values."""
        by_sweep: dict[str, dict[str, list[Row]]] = {}
        for row in self.rows:
            by_sweep.setdefault(row.sweep, {}).setdefault(row.id, []).append(row)
        return [SweepRows(name, next(iter(settings.values()))[0].parameter, tuple(_settings(settings))) for name, settings in by_sweep.items()]


def _settings(settings: dict[str, list[Row]]) -> Iterator[Setting]:
    for name in sorted(settings, key=lambda id: (_number(id), id)):
        rows = settings[name]
        for row in rows:
            own, first = (f"{one.parameter} = {one.value}" for one in (row, rows[0]))
            if own != first:
                raise ValueError(f"{row.where}: {name} is {own}, but {first} in {rows[0].where}")
        yield Setting(name, rows[0].value, tuple(rows))


def _number(id: str) -> float:
    tail = id.rpartition("/")[2]
    return int(tail) if tail.isdecimal() and len(tail) < 10 else math.inf


def read_rows(folder: Path) -> Rows:
    """Read the rows that `stress` wrote. An interrupted run leaves a last line without an end, which is left out and reported in `torn`.

    Raises ValueError naming file and line where the folder holds no rows, rows of another version, or damaged rows.
    """
    path = folder / RESULTS
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder")
    if not path.is_file():
        raise ValueError(f"{path}: no such file; `pilsim stress --out {folder}` writes it")
    read, torn = read_result_rows(path)
    if not read:
        raise ValueError(f"{path}: holds no {'whole ' if torn else ''}row")
    rows = tuple(_row(row) for row in read)
    _check_unique(rows)
    return Rows(folder, rows, torn)


def read_beside(folders: Sequence[Path]) -> Rows:
    """The rows of several folders as those of the first. A tracker is named after its folder, with its own name appended where there are several.

    Moments are those of the first folder, where their pictures are. Raises ValueError as `read_rows`, and for folders of the same name.
    """
    read = [read_rows(folder) for folder in folders]
    if len(read) == 1:
        return read[0]
    names = [rows.folder.resolve().name for rows in read]
    names = names if len(set(names)) == len(names) else [str(rows.folder) for rows in read]
    if len(set(names)) < len(names):
        raise ValueError(f"{names[0]}: the same folder is given twice")
    out = list[Row]()
    for name, rows in zip(names, read, strict=True):
        for row in rows.rows:
            moments = row.moments if rows is read[0] else ()
            out.append(replace(row, tracker=f"{name}:{row.tracker}" if len(rows.trackers) > 1 else name, moments=moments))
    return Rows(read[0].folder, tuple(out), any(rows.torn for rows in read), True)


def _check_unique(rows: Iterable[Row]) -> None:
    seen: dict[tuple[str, int, str], str] = {}
    for row in rows:
        key = (row.id, row.seed, row.tracker)
        if key in seen:
            raise ValueError(f"{row.where}: {row.id}, seed {row.seed}, tracker {row.tracker} is there already: {seen[key]}")
        seen[key] = row.where


def _row(row: JsonObject) -> Row:
    where, tracker = row.where, row.values["tracker"]
    moments = row.maybe("moments", list) or []
    if not all(isinstance(m, dict) for m in moments):
        raise ValueError(f"{where}: moments needs objects")
    scores, limits = (row.part(name).numbers() if row.values.get(name) is not None else {} for name in ("scores", "limits"))
    return Row(
        **{name: row.a(name, str) for name in ("id", "sweep", "parameter", "command")},
        value=_value(row.values.get("value"), where),
        seed=row.a("seed", int),
        tracker=tracker["name"],
        options=tracker.get("options") or {},
        scenario=row.a("scenario", dict),
        rendered=row.a("rendered", bool),
        error=row.maybe("error", str),
        scores=scores,
        limits=limits,
        causes={kind: counts.numbers() for kind, counts in row.parts("causes").items()},
        ablation={m: found for m, part in row.parts("ladder").items() if m in ("mota", "metres") and (found := part.numbers())},
        moments=tuple(moments),
        versions=row.maybe("versions", dict) or {},
        where=where,
    )


def _value(value: Any, where: str) -> Any:
    if isinstance(value, (dict, list)):
        return json.dumps(value, sort_keys=True)
    if value is not None and not isinstance(value, (str, int, float, bool)):
        raise ValueError(f"{where}: value is {type(value).__name__}")
    return value
