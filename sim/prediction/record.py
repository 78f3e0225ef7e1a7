"""The file of a prediction, as `pilsim predict --out` writes it: what was predicted and how, scores and errors by cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.prediction.predict import Predicted, Prediction, PredictionPlan
from tracker.io.json_files import read_json
from tracker.io.text_files import shown

SCHEMA = 1
KINDS = ("misses", "false positives", "switches")
"""Kinds of errors that have causes."""
Causes = Mapping[str, Mapping[str, Predicted]]


def content(plan: PredictionPlan, found: Prediction, command: str, versions: Mapping[str, str]) -> dict[str, Any]:
    """The file as JSON values. command: the command line that repeats it, without names of outputs. versions: name of a part → version."""
    tracker = {"name": plan.tracker.name, "options": plan.tracker.options}
    about = {"schema": SCHEMA, "source": str(plan.path), "tracker": tracker, "seeds": list(plan.seeds), "command": command}
    return about | {"versions": dict(versions)} | found.to_dict()


@dataclass(frozen=True, eq=False)
class DetectorForecast:
    """The means and intervals of one detector's twins: figures by name, errors as kind → cause → number, and the figures of each twin."""

    figures: Mapping[str, Predicted]
    causes: Causes
    runs: tuple[Mapping[str, float], ...]


@dataclass(frozen=True, eq=False)
class RealOutcome:
    """Figures by name of the real boxes, and errors as kind → cause → number."""

    figures: Mapping[str, float]
    causes: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class PredictionRecord:
    """A prediction that was read. frames: of the twins, and fit_frames of the fit or None, each the first and the one after the last.

    forecasts: detector → what its twins predict. real: None where the recording has no boxes. Figures that were undefined are NaN.
    """

    path: Path
    source: str
    tracker: str
    options: Mapping[str, Any]
    seeds: tuple[int, ...]
    command: str
    versions: Mapping[str, str]
    frames: tuple[int, int]
    fit_frames: tuple[int, int] | None
    people: int
    cameras: tuple[str, ...]
    forecasts: Mapping[str, DetectorForecast]
    real: RealOutcome | None


def read_prediction(path: Path) -> PredictionRecord:
    """Read the file of a prediction. Raises ValueError naming the file and the field where it is no such file, or damaged."""
    file = _Part(read_json(path), str(path))
    if (schema := file.values.get("schema")) != SCHEMA:
        raise ValueError(f"{path}: schema is {shown(str(schema))[1:-1]}, this version reads {SCHEMA}, as `pilsim predict --out` writes it")
    tracker, twins = file.part("tracker"), file.part("predicted")
    forecasts = {name: _forecast(twins.part(name)) for name in twins.values}
    if not forecasts:
        raise ValueError(f"{path}: predicted is empty, needs at least one detector")
    real = None
    if file.values.get("real") is not None:
        of = file.part("real")
        kinds = of.part("causes")
        real = RealOutcome(of.part("figures").numbers(), {kind: kinds.part(kind).numbers() for kind in KINDS})
    return PredictionRecord(
        path=path,
        source=file.a("source", str),
        tracker=tracker.a("name", str),
        options=tracker.part("options").values,
        seeds=tuple(file.integers("seeds")),
        command=file.a("command", str),
        versions={name: str(version) for name, version in file.part("versions").values.items()},
        frames=file.range("frames"),
        fit_frames=None if file.values.get("fit_frames") is None else file.range("fit_frames"),
        people=file.a("people", int),
        cameras=tuple(str(name) for name in file.a("cameras", list)),
        forecasts=forecasts,
        real=real,
    )


def _forecast(twins: _Part) -> DetectorForecast:
    figures, kinds = twins.part("figures"), twins.part("causes")
    causes = {kind: {cause: _predicted(kinds.part(kind).part(cause)) for cause in kinds.part(kind).values} for kind in KINDS}
    runs = tuple(_Part(run, f"{twins.where}: runs[{k}]").numbers() for k, run in enumerate(twins.a("runs", list)))
    return DetectorForecast({name: _predicted(figures.part(name)) for name in figures.values}, causes, runs)


def _predicted(part: _Part) -> Predicted:
    values = part.numbers()
    low, high = (None if part.values.get(name) is None else values[name] for name in ("low", "high"))
    return Predicted(values.get("mean", float("nan")), low, high)


@dataclass(frozen=True, eq=False)
class _Part:
    """An object of the file, read with a check of types. where: the file and the fields that lead to it."""

    values: dict[str, Any]
    where: str

    def __post_init__(self) -> None:
        if not isinstance(self.values, dict):
            raise ValueError(f"{self.where}: a JSON {type(self.values).__name__}, needs an object")

    def a(self, name: str, kind: type) -> Any:
        value = self.values.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ValueError(f"{self.where}: {name} is {'missing' if value is None else type(value).__name__}, needs {kind.__name__}")
        return value

    def part(self, name: str) -> _Part:
        if name not in self.values:
            raise ValueError(f"{self.where}: {name} is missing, needs an object")
        return _Part(self.values[name], f"{self.where}: {name}")

    def numbers(self) -> dict[str, float]:
        for name, value in self.values.items():
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
                raise ValueError(f"{self.where}: {name} is {type(value).__name__}, needs a number or null")
        return {name: float("nan") if value is None else float(value) for name, value in self.values.items()}

    def integers(self, name: str) -> list[int]:
        found = self.a(name, list)
        if not all(isinstance(value, int) and not isinstance(value, bool) for value in found):
            raise ValueError(f"{self.where}: {name} holds other values than integers")
        return found

    def range(self, name: str) -> tuple[int, int]:
        found = self.integers(name)
        if len(found) != 2:
            raise ValueError(f"{self.where}: {name} has {len(found)} values, needs 2")
        return found[0], found[1]
