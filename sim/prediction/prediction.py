"""A prediction: figures and errors by cause of twins and of the real boxes, its tables, and its file, as `pilsim predict --out` writes it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.confidence_intervals import AT_LEAST_ZERO, Interval, bounds_of, one_more_interval
from tracker.io.json_files import JsonObject, read_json

SCHEMA = 1
FIGURES = ("mota", "idf1", "hota", "misses", "false_positives", "switches", "motp_m", "truths")
"""Names of the scores of a run."""
KINDS = ("misses", "false positives", "switches")
"""Kinds of errors that have causes."""
SCORES = (("mota", "MOTA", 3), ("idf1", "IDF1", 3), ("hota", "HOTA", 3))
ERRORS = (("misses", "misses", 1), ("false_positives", "false positives", 1), ("switches", "switches", 1))
"""Name of a figure, its title in tables, and digits of a mean."""
OTHERS = (("motp_m", "MOTP [m]", 3), ("truths", "true positions", 1))
REAL = "real"
Frames = tuple[int, int]
"""First frame and the one after the last."""
Cells = tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """Scores of a run by name (FIGURES; undefined ones are NaN or left out), and counts of errors: kind → cause → number, as `stress` has them."""

    figures: Mapping[str, float]
    causes: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Forecast:
    """What the twins of a detector predict: figures by name, errors as kind → cause → number, and the figures of each twin.

    Intervals are those in which one more run lies with 95 %.
    """

    figures: Mapping[str, Interval]
    causes: Mapping[str, Mapping[str, Interval]]
    runs: tuple[Mapping[str, float], ...]

    @staticmethod
    def of(runs: Sequence[Outcome]) -> Forecast:
        """The forecast by outcomes of at least one twin."""
        figures = {name: one_more_interval([one.figures[name] for one in runs], bounds_of(name)) for name in FIGURES}
        causes = {
            kind: {cause: one_more_interval([one.causes[kind][cause] for one in runs], AT_LEAST_ZERO) for cause in of}
            for kind, of in runs[0].causes.items()
        }
        return Forecast(figures, causes, tuple(one.figures for one in runs))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        causes = {kind: {cause: _ends(value) for cause, value in of.items()} for kind, of in self.causes.items()}
        return {"figures": {name: _ends(value) for name, value in self.figures.items()}, "causes": causes, "runs": list(self.runs)}


def _ends(value: Interval) -> dict[str, float | None]:
    return {"mean": value.mean, "low": value.low, "high": value.high}


@dataclass(frozen=True)
class Prediction:
    """Forecasts by detector, and the real outcome, None without real boxes.

    frames: of the twins, and fit_frames of the fit, None without one. people: number of true persons in the twins.
    truth_errors: those of the truth on which the views agree (SharedErrors as JSON values), None where they are not known.
    """

    forecasts: Mapping[str, Forecast]
    real: Outcome | None
    fit_frames: Frames | None
    frames: Frames
    people: int
    cameras: tuple[str, ...]
    truth_errors: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "fit_frames": self.fit_frames and list(self.fit_frames),
            "frames": list(self.frames),
            "people": self.people,
            "cameras": list(self.cameras),
            "truth_errors": self.truth_errors,
            "real": self.real and vars(self.real),
            "predicted": {name: one.to_dict() for name, one in self.forecasts.items()},
        }

    def counts(self, kind: str) -> dict[str, list[float]]:
        """Cause of a kind of error that occurs → mean number by each detector, then the real one."""
        every = [{cause: value.mean for cause, value in of.causes.get(kind, {}).items()} for of in self.forecasts.values()]
        every += [dict(self.real.causes.get(kind, {}))] if self.real else []
        out = {cause: [_finite(of.get(cause, 0.0)) for of in every] for cause in dict.fromkeys(cause for of in every for cause in of)}
        return {cause: numbers for cause, numbers in out.items() if any(numbers)}

    def head(self, first: str) -> Cells:
        """Titles of the columns of a table."""
        return first, *self.forecasts, *([REAL] if self.real else [])

    def score_lines(self) -> list[Cells]:
        """A line for each figure: of each detector with the interval of one more run, then the real one."""
        out = []
        for key, label, digits in (*SCORES, *ERRORS, *OTHERS):
            real = [number_text(self.real.figures.get(key, math.nan), 0 if digits == 1 else digits)] if self.real else []
            out.append((label, *(interval_text(of.figures.get(key), digits) for of in self.forecasts.values()), *real))
        return out

    def cause_lines(self) -> list[Cells]:
        """A line for each cause of errors that occurs."""
        out = []
        for kind in KINDS:
            for cause, numbers in self.counts(kind).items():
                cells = (interval_text(of.causes.get(kind, {}).get(cause), 1) for of in self.forecasts.values())
                out.append((f"{kind}: {cause}", *cells, *([f"{numbers[-1]:.0f}"] if self.real else [])))
        return out


@dataclass(frozen=True)
class PredictionRecord:
    """A prediction with what made it: the source, the tracker and its options, seeds of the twins, the command line, and versions by part."""

    source: str
    tracker: str
    options: Mapping[str, Any]
    seeds: tuple[int, ...]
    command: str
    versions: Mapping[str, str]
    found: Prediction

    def to_dict(self) -> dict[str, Any]:
        """The file as JSON values."""
        about = {"schema": SCHEMA, "source": self.source, "tracker": {"name": self.tracker, "options": self.options}, "seeds": list(self.seeds)}
        return about | {"command": self.command, "versions": dict(self.versions)} | self.found.to_dict()


def read_prediction(path: Path) -> PredictionRecord:
    """Read the file of a prediction. Raises ValueError naming the file and the field where it is no such file, or damaged."""
    file = JsonObject(read_json(path), str(path))
    file.check_schema(SCHEMA, ", as `pilsim predict --out` writes it")
    tracker, twins = file.part("tracker"), file.part("predicted")
    forecasts = {name: _forecast(twins.part(name)) for name in twins.values}
    if not forecasts:
        raise ValueError(f"{path}: predicted is empty, needs at least one detector")
    real = None
    if file.values.get("real") is not None:
        of = file.part("real")
        real = Outcome(of.part("figures").numbers(), {kind: of.part("causes").part(kind).numbers() for kind in KINDS})
    frames = {name: _frames(file, name) for name in ("frames", "fit_frames") if name == "frames" or file.values.get(name) is not None}
    found = Prediction(
        forecasts, real, frames.get("fit_frames"), frames["frames"], file.a("people", int), tuple(map(str, file.a("cameras", list))),
        file.maybe("truth_errors", dict),
    )  # fmt: skip
    return PredictionRecord(
        source=file.a("source", str),
        tracker=tracker.a("name", str),
        options=tracker.part("options").values,
        seeds=tuple(file.integers("seeds")),
        command=file.a("command", str),
        versions={name: str(version) for name, version in file.part("versions").values.items()},
        found=found,
    )


def _frames(file: JsonObject, name: str) -> Frames:
    first, end = file.integers(name, 2)
    return first, end


def _forecast(twins: JsonObject) -> Forecast:
    runs = tuple(JsonObject(run, f"{twins.where}: runs[{k}]").numbers() for k, run in enumerate(twins.a("runs", list)))
    figures, causes = twins.part("figures"), twins.part("causes")
    return Forecast(_intervals(figures, len(runs)), {kind: _intervals(causes.part(kind), len(runs)) for kind in KINDS}, runs)


def _intervals(of: JsonObject, count: int) -> dict[str, Interval]:
    found = {name: of.part(name).numbers() for name in of.values}
    return {name: Interval(one.get("mean", math.nan), one.get("low"), one.get("high"), count) for name, one in found.items()}


def interval_text(value: Interval | None, digits: int) -> str:
    """A mean with its interval; a dash where it is not known."""
    return "–" if value is None or not math.isfinite(value.mean) else value.text(digits)


def number_text(value: float, digits: int) -> str:
    """A number; a dash where it is not known."""
    return f"{value:.{digits}f}".replace("-", "−") if math.isfinite(value) else "–"


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0
