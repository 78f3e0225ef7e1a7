"""The results of a stress test, read from results.jsonl and grouped by sweep and setting."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval, bounds_of, mean_interval
from tracker.io.json_files import parse_json
from tracker.io.text_files import read_text, shown

SCHEMA = 1
ROWS = "results.jsonl"
LARGEST = 1 << 28
"""Bytes."""
SCORES = (
    "mota", "mota_all", "idf1", "hota", "motp_m", "false_positives", "misses", "switches", "truths", "ate_m", "dead_reckoning_m",
)  # fmt: skip
KINDS = ("misses", "false positives", "switches")
STAGES = ("poses", "detections", "association", "terrain")


@dataclass(frozen=True, eq=False)
class Row:
    """One run of one setting, seed and tracker. The setting `id` is the `sweep` with its `parameter` at `value`.

    error: the error of a failed run in one line, or None. scores: name of SCORES → number; limits: name → bound; unknown ones are missing.
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
    seconds: float | None
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
        return [SweepRows(name, _parameter(settings), tuple(_settings(settings))) for name, settings in by_sweep.items()]


def _parameter(settings: dict[str, list[Row]]) -> str:
    return next(iter(settings.values()))[0].parameter


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
    path = folder / ROWS
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder")
    if not path.is_file():
        raise ValueError(f"{path}: no such file; `pilsim stress --out {folder}` writes it")
    *lines, last = read_text(path, LARGEST).split("\n")
    rows = tuple(_row(line, f"{path}:{k}") for k, line in enumerate(lines, 1) if line.strip())
    if not rows:
        raise ValueError(f"{path}: holds no {'whole ' if last else ''}row")
    _check_unique(rows)
    return Rows(folder, rows, bool(last.strip()))


def read_beside(folders: Sequence[Path]) -> Rows:
    """The rows of several folders as those of one, the first. A tracker has the name of its folder, before its own where there are several of them.

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


def _row(line: str, where: str) -> Row:
    content = parse_json(line, where)
    if not isinstance(content, dict):
        raise ValueError(f"{where}: a JSON {type(content).__name__}, needs an object")
    if content.get("schema") != SCHEMA:
        raise ValueError(f"{where}: schema is {shown(str(content.get('schema')))[1:-1]}, this version reads {SCHEMA}")
    fields = _Fields(content, where)
    tracker = fields.a("tracker", dict)
    if not isinstance(tracker.get("name"), str):
        raise ValueError(f"{where}: tracker has no name")
    causes = fields.maybe("causes", dict) or {}
    ladder = fields.maybe("ladder", dict) or {}
    moments = fields.maybe("moments", list) or []
    if not all(isinstance(m, dict) for m in moments):
        raise ValueError(f"{where}: moments needs objects")
    return Row(
        **{name: fields.a(name, str) for name in ("id", "sweep", "parameter", "command")},
        value=_value(content.get("value"), where),
        seed=fields.a("seed", int),
        tracker=tracker["name"],
        options=tracker.get("options") or {},
        scenario=fields.a("scenario", dict),
        rendered=fields.a("rendered", bool),
        seconds=_numbers({"seconds": content.get("seconds")}, where).get("seconds"),
        error=fields.maybe("error", str),
        scores=_numbers(fields.maybe("scores", dict) or {}, f"{where}: scores"),
        limits=_numbers(fields.maybe("limits", dict) or {}, f"{where}: limits"),
        causes={kind: _numbers(_object(counts, where, kind), f"{where}: {kind}") for kind, counts in causes.items()},
        ablation={m: _numbers(_object(ladder[m], where, m), f"{where}: ladder {m}") for m in ("mota", "metres") if ladder.get(m)},
        moments=tuple(moments),
        versions=fields.maybe("versions", dict) or {},
        where=where,
    )


@dataclass(frozen=True)
class _Fields:
    """The fields of a row, read with a check of their types."""

    content: dict[str, Any]
    where: str

    def a(self, name: str, kind: type) -> Any:
        value = self.content.get(name)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise ValueError(f"{self.where}: {name} is {'missing' if value is None else type(value).__name__}, needs {kind.__name__}")
        return value

    def maybe(self, name: str, kind: type) -> Any:
        return None if self.content.get(name) is None else self.a(name, kind)


def _object(value: Any, where: str, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{where}: {name} is {type(value).__name__}, needs an object")
    return value


def _value(value: Any, where: str) -> Any:
    if isinstance(value, (dict, list)):
        return json.dumps(value, sort_keys=True)
    if value is not None and not isinstance(value, (str, int, float, bool)):
        raise ValueError(f"{where}: value is {type(value).__name__}")
    return value


def _numbers(values: dict[str, Any], where: str) -> dict[str, float]:
    """The numbers that are not null. Raises ValueError for a value that is not a finite number."""
    for name, value in values.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value)):
            raise ValueError(f"{where}: {shown(name)[1:-1]} is {shown(str(value))}, needs a finite number or null")
    return {name: value for name, value in values.items() if value is not None}
