"""The error model of a detector of people, as one value, with a JSON file of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np

from tracker.detector_models.bodies import FEATURES, OVERLAPS
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.schema import Count, Numbers, Row, Share, Table, Time, check_numbers, part_of, real
from tracker.detector_models.trends import TREND
from tracker.io.json_files import json_text, parse_json, read_json
from tracker.io.text_files import shown

SCHEMA = 1
KNOTS = 21
"""Quantiles of a distribution, at equal steps of probability from 0 to 1."""
EDGES = ("left", "top", "right", "bottom")
TERMS = ("middle", "top", "width", "bottom")
"""Errors of the left and right edges are modelled by those of middle and width, which are nearly independent of each other."""
CLEAR = 0.75
"""Visible share from which a body counts as clear. Boxes of more hidden bodies have larger errors."""
INDEPENDENT = "independent"
"""The name of the model with independent errors. Its numbers are those of the scenario, so it has no file."""
FITTED = "fitted"
"""The kind of the models that are fitted to a detector; files without a kind are of this one."""


@dataclass(frozen=True)
class Misses:
    """Misses: a hidden Markov chain for each person and view.

    unseen: probability that a body of which nothing is visible is missed, in place of that by the features; 1 for always.

    The hidden state u is uniform in [0, 1]. In a frame it stays with probability exp(−dt / time_s), otherwise it is drawn anew. The detector is blind
    to the person where u < q(x). Otherwise it misses with probability `flicker`, without memory. The share of misses is p(x) = q + (1 − q) flicker,
    the logistic function of coefficients · features (bodies.FEATURES); sizes as in TrueBodies.features.
    """

    coefficients: Annotated[Row, Numbers((len(FEATURES),))]
    sizes: Annotated[tuple[float, float], Numbers((2,))]
    time_s: Time
    flicker: Share
    unseen: Share = 1.0


@dataclass(frozen=True)
class EdgeErrors:
    """Errors of the edges of a box, as TERMS: the middle of left and right, top, the width, bottom.

    They are in heights of the whole body; right and down are positive. quantiles (2, 4, KNOTS): of each term, for bodies of which at least CLEAR is
    visible, and for others. Normal scores of errors are sqrt(lasting) B + sqrt(1 − lasting) A.
    B is constant for a person and view, A is an AR(1) process of time constant time_s. correlation (4, 4): of both, between terms.
    hidden, border: share of the hidden part, and of the part beyond the border, over which a box extends.
    trend (4, 7): of one view alone, coefficients of the terms by trends.TREND, and trend_bounds (2, 7) of these features; () for none.
    near: largest distance, in body heights, of a body's box without overlap (observations.match_frame); 0 for none.
    """

    quantiles: Annotated[tuple[Table, ...], Numbers((2, 4, KNOTS), rising=True)]
    lasting: Annotated[Row, Numbers((4,), 0.0, 1.0)]
    time_s: Annotated[Row, Numbers((4,), 0.0)]
    correlation: Annotated[Table, Numbers((4, 4))]
    hidden: Share
    border: Share
    trend: Annotated[Table, Numbers((4, len(TREND)), empty=True)] = ()
    trend_bounds: Annotated[Table, Numbers((2, len(TREND)), empty=True)] = ()
    near: Annotated[float, Numbers((), 0.0, 10.0)] = 0.0


@dataclass(frozen=True)
class Confidences:
    """Confidences of boxes of people: quantiles (KNOTS,). Normal scores are features · coefficients plus a residual with deviation `spread`.

    lasting, time_s as in EdgeErrors.
    """

    quantiles: Annotated[Row, Numbers((KNOTS,), rising=True)]
    coefficients: Annotated[Row, Numbers((len(FEATURES),))]
    spread: Annotated[float, Numbers((), 0.0, 100.0)]
    lasting: Share
    time_s: Time


@dataclass(frozen=True)
class Merges:
    """Merged boxes: probability, by bins of overlap with lower ends OVERLAPS, that one box shows two people; time_s of its persistence."""

    probability: Annotated[Row, Numbers((len(OVERLAPS),), 0.0, 1.0)]
    time_s: Time


@dataclass(frozen=True)
class SecondBoxes:
    """Second boxes of a person: rates[k] is the probability of at least k + 1 of them; time_s of their persistence.

    samples (n, 8): errors of the four edges in heights of the body; confidence, visible share, and 1 where there was no first box.
    The last column is 1 where the next row is the same box step_s later. Errors are from the first box, or from the whole body where there is none.
    While a box lasts, it takes the rows of a run, forward and backward; with step_s 0 it keeps its sample.
    coefficients (6,): of the features and of the lack of a first box. Their logistic function is the probability of at least one; () for rates[0].
    """

    rates: Annotated[Row, Numbers((0,), 0.0, 1.0)]
    time_s: Time
    samples: Annotated[Table, Numbers((0, 8))]
    coefficients: Annotated[Row, Numbers((len(FEATURES) + 1,), empty=True)] = ()
    step_s: Time = 0.0


@dataclass(frozen=True)
class FalseBoxes:
    """New false boxes: mean number per view and frame. samples (n, 4): distance, height and width in m on the ground, and confidence."""

    rate: Count
    samples: Annotated[Table, Numbers((0, 4))]


@dataclass(frozen=True)
class StandingBoxes:
    """False boxes that stay at one place of the world, each in one view alone. sites: mean number of places per view.

    samples (n, 6): distance, height and width in m, share of frames with the box, lowest and highest confidence (10 and 90 %).
    time_s: of the persistence of presence and absence. jitter: standard deviation of an edge, in heights of the box.
    fixed (n, 8): of one view that stands still, in place of `samples`. Columns are the edges px, share of frames with the box, lowest and highest
    confidence, and 1 where it stood at the end of the fit. Such places end after life_s in the mean, and `births` new ones appear per second.
    """

    sites: Count
    time_s: Time
    jitter: Annotated[float, Numbers((), 0.0, 10.0)]
    samples: Annotated[Table, Numbers((0, 6))]
    fixed: Annotated[Table, Numbers((0, 8))] = ()
    life_s: Time = 0.0
    births: Count = 0.0


@dataclass(frozen=True, eq=False)
class DetectorModel:
    """The error model of a detector.

    bodies: "boxes" where errors refer to true boxes, "places" where they refer to projected bodies (bodies.BODY).
    Places and statures are those on which several views agree. With one view, the spread of stature is a part of the errors.
    made: sources, cameras, frames. figures: name → value, and lowest and highest value (95 %). counts: of samples of the fit.
    """

    name: str
    bodies: str
    misses: Misses
    edges: EdgeErrors
    confidences: Confidences
    merges: Merges
    second: SecondBoxes
    false: FalseBoxes
    standing: StandingBoxes
    made: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.bodies not in ("boxes", "places"):
            raise ValueError(f"bodies is {self.bodies!r}, needs boxes or places")
        for part in PARTS:
            check_numbers(getattr(self, part), f"{part}.")
        if bool(self.edges.trend) != bool(self.edges.trend_bounds):
            raise ValueError("edges.trend needs trend_bounds, and they need it")
        matrix = np.array(self.edges.correlation)
        if not (np.allclose(matrix, matrix.T, atol=1e-6) and np.allclose(np.diag(matrix), 1.0, atol=1e-6) and np.abs(matrix).max() <= 1 + 1e-6):
            raise ValueError("edges.correlation needs a symmetric matrix with 1 on its diagonal")
        if self.second.coefficients and not self.second.rates:
            raise ValueError("second.rates is empty, needs rates where there are coefficients")
        for part, needed in (("second", max(self.second.rates, default=0.0)), ("false", self.false.rate), ("standing", self.standing.sites)):
            if needed and not getattr(self, part).samples:
                raise ValueError(f"{part}.samples is empty, needs samples where there are such boxes")


PARTS: dict[str, type] = {name: kind for name, kind in get_type_hints(DetectorModel).items() if isinstance(kind, type) and is_dataclass(kind)}
UNUSED = ("fills", "fill_time_s")
"""Fields of `edges` in files of 0.4.0, which are not read: predictions of real rows are as good without them."""
Model = DetectorModel | IndependentErrors


def model_text(model: Model) -> str:
    """One JSON object, and the same bytes for the same model. `parse_model` is its inverse."""
    kind = INDEPENDENT if isinstance(model, IndependentErrors) else FITTED
    return json_text({"schema": SCHEMA, "kind": kind} | asdict(model)) + "\n"


def parse_model(text: str, where: str = "detector model") -> Model:
    """The model of a JSON text. Raises ValueError, in one line that begins with `where`, for other content."""
    return _model_of(parse_json(text, where), where)


def read_model(path: Path) -> Model:
    """Read a model file. Raises ValueError with the file and the field for invalid content."""
    return _model_of(read_json(path), str(path))


def model_names() -> list[str]:
    """Names of the models that come with the package."""
    folder = resources.files("tracker.detector_models") / "models"
    return sorted(entry.name.removesuffix(".json") for entry in folder.iterdir() if entry.name.endswith(".json"))


def named_model(name: str) -> DetectorModel:
    """A model that comes with the package. Raises ValueError with all names for an unknown one."""
    if name not in model_names():
        raise ValueError(f"detector model is {name!r}, needs {INDEPENDENT}, a file, or one of {', '.join(model_names())}")
    found = parse_model((resources.files("tracker.detector_models") / "models" / f"{name}.json").read_text(encoding="utf-8"), name)
    assert isinstance(found, DetectorModel)
    return found


def chosen_model(text: str) -> str:
    """The value of --detector-model as scenarios hold it: a name as it is, a file as its content.

    Raises ValueError for an unknown name, and for an invalid file.
    """
    if text == INDEPENDENT or text in model_names():
        return text
    if Path(text).is_file() or text.endswith(".json"):
        return model_text(read_model(Path(text)))
    named_model(text)
    return text


def model_of(choice: str, independent: IndependentErrors | None = None) -> Model:
    """The model of a scenario, as `chosen_model` gave it. independent: the errors of INDEPENDENT, None for the default ones.

    Raises ValueError for an unknown name or other content.
    """
    if choice == INDEPENDENT:
        return independent or IndependentErrors()
    return parse_model(choice) if choice.lstrip().startswith("{") else named_model(choice)


def _model_of(content: Any, where: str) -> Model:
    if not isinstance(content, dict) or content.get("schema") != SCHEMA or content.get("kind", FITTED) not in (FITTED, INDEPENDENT):
        raise ValueError(f"{where}: is no detector model of schema {SCHEMA}, {FITTED} or {INDEPENDENT}, as `pilsim fit-detector` writes it")
    values = {name: value for name, value in content.items() if name not in ("schema", "kind")}
    try:
        return part_of(IndependentErrors, values, "") if content.get("kind") == INDEPENDENT else _fitted(values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _fitted(content: dict[str, Any]) -> DetectorModel:
    names = {f.name for f in fields(DetectorModel)}
    for kind, wrong in (("lacks", names - set(content)), ("has the unknown field", set(content) - names)):
        if wrong:
            raise ValueError(f"{kind} {shown(sorted(wrong)[0])}")
    if not isinstance(content["name"], str) or not all(isinstance(content[key], dict) for key in ("made", "figures", "counts")):
        raise ValueError("name needs a text; made, figures and counts need objects")
    if isinstance(content["edges"], dict):
        content["edges"] = {key: value for key, value in content["edges"].items() if key not in UNUSED}
    parts: dict[str, Any] = {name: part_of(cls, content[name], name) for name, cls in PARTS.items()}
    if isinstance(parts["second"].samples, tuple):
        parts["second"] = replace(parts["second"], samples=tuple(map(_as_eight, parts["second"].samples)))
    figures = {name: _triple(f"figures.{name}", value) for name, value in content["figures"].items()}
    counts = {name: int(real(f"counts.{name}", value)) for name, value in content["counts"].items()}
    return DetectorModel(content["name"], content["bodies"], made=content["made"], figures=figures, counts=counts, **parts)


def _as_eight(row: Any) -> Any:
    """A sample of second boxes in the present layout, from that of 0.3.0 with 5 columns (errors from whole bodies), or with 7 (without runs)."""
    columns = len(row) if isinstance(row, tuple) else 0
    return (*row, 1.0, 1.0, 0.0) if columns == 5 else (*row, 0.0) if columns == 7 else row


def _triple(name: str, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"{name} needs three numbers")
    return real(name, value[0]), real(name, value[1]), real(name, value[2])
