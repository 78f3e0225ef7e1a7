"""The error model of a detector of people, as one value, with a JSON file of its own."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from tracker.detector_models.bodies import FEATURES, OVERLAPS
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.trends import TREND
from tracker.io.json_files import json_text, parse_json, read_json
from tracker.io.text_files import shown

SCHEMA = 1
KNOTS = 21
"""Quantiles of a distribution, at equal steps of probability from 0 to 1."""
EDGES = ("left", "top", "right", "bottom")
TERMS = ("middle", "top", "width", "bottom")
"""Errors of the edges left and right are those of their middle and of the width, which are nearly independent of each other."""
CLEAR = 0.75
"""Visible share from which on a body counts as clear: boxes of bodies that are hidden more have larger errors."""
INDEPENDENT = "independent"
"""The name of the model with independent errors, whose numbers are those of the scenario: it has no file."""
MOST_SAMPLES = 400
LONGEST = 1e6


@dataclass(frozen=True)
class Misses:
    """Misses: a hidden Markov chain for each person and view.

    unseen: probability that a body of which nothing is visible is missed, where its model differs from the features'; 1 for always.

    The hidden state u is uniform in [0, 1]. In a frame it stays with probability exp(−dt / time_s), otherwise it is drawn anew. The detector is blind
    to the person where u < q(x). Otherwise it misses with probability `flicker`, without memory. The share of misses is p(x) = q + (1 − q) flicker,
    the logistic function of coefficients · features (bodies.FEATURES); sizes as in TrueBodies.features.
    """

    coefficients: tuple[float, ...]
    sizes: tuple[float, float]
    time_s: float
    flicker: float
    unseen: float = 1.0


@dataclass(frozen=True)
class EdgeErrors:
    """Errors of the edges of a box, as TERMS: the middle of left and right, top, the width, bottom.

    They are in heights of the whole body; right and down are positive. quantiles (2, 4, KNOTS): of each term, for bodies of which at least CLEAR is
    visible, and for others. Normal scores of errors are sqrt(lasting) B + sqrt(1 − lasting) A.
    B is constant for a person and view, A is an AR(1) process of time constant time_s. correlation (4, 4): of both, between terms.
    hidden, border: by which share of its distance a box extends over the part that is hidden, and over the part beyond the border.
    trend (4, 7): of one view alone, coefficients of the terms by trends.TREND, and trend_bounds (2, 7) of these features; () for none.
    near: body heights up to which boxes beside a body are its own (observations.match_frame); 0 for boxes that overlap alone.
    """

    quantiles: tuple[tuple[tuple[float, ...], ...], ...]
    lasting: tuple[float, ...]
    time_s: tuple[float, ...]
    correlation: tuple[tuple[float, ...], ...]
    hidden: float
    border: float
    trend: tuple[tuple[float, ...], ...] = ()
    trend_bounds: tuple[tuple[float, ...], ...] = ()
    near: float = 0.0


@dataclass(frozen=True)
class Confidences:
    """Confidences of boxes of people: quantiles (KNOTS,), of which normal scores depend on the features by `coefficients`; `spread` of the rest.

    lasting, time_s as in EdgeErrors.
    """

    quantiles: tuple[float, ...]
    coefficients: tuple[float, ...]
    spread: float
    lasting: float
    time_s: float


@dataclass(frozen=True)
class Merges:
    """Merged boxes: probability, by bins of overlap from OVERLAPS on, that one box stands for two people; time_s of its persistence."""

    probability: tuple[float, ...]
    time_s: float


@dataclass(frozen=True)
class SecondBoxes:
    """Second boxes of a person: rates[k] is the probability of at least k + 1 of them; time_s of their persistence.

    samples (n, 8): errors of the four edges in heights of the body; confidence, visible share, 1 where there was no first box, and 1 where the
    next row is the same box step_s later. Errors are from the first box, or from the whole body where there is none.
    While a box lasts, it takes the rows of a run, to and fro; with step_s 0 it keeps its sample.
    coefficients (6,): of the features and of the lack of a first box. Their logistic function is the probability of any; () for rates[0].
    """

    rates: tuple[float, ...]
    time_s: float
    samples: tuple[tuple[float, ...], ...]
    coefficients: tuple[float, ...] = ()
    step_s: float = 0.0


@dataclass(frozen=True)
class FalseBoxes:
    """False boxes that come anew: mean number a view and frame. samples (n, 4): distance, height and width in m on the ground, and confidence."""

    rate: float
    samples: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class StandingBoxes:
    """False boxes that stay at one place of the world, each in one view alone: mean number of places a view.

    samples (n, 6): distance, height and width in m, share of frames with the box, lowest and highest confidence (10 and 90 %).
    time_s: of the persistence of presence and absence. jitter: standard deviation of an edge, in heights of the box.
    fixed (n, 8): of one view that stands still, in place of `samples`. Columns are the edges px, share of frames with the box, lowest and highest
    confidence, and 1 where it stood at the end of the fit. Such places end after life_s in the mean, and `births` of them come a second.
    """

    sites: float
    time_s: float
    jitter: float
    samples: tuple[tuple[float, ...], ...]
    fixed: tuple[tuple[float, ...], ...] = ()
    life_s: float = 0.0
    births: float = 0.0


@dataclass(frozen=True, eq=False)
class DetectorModel:
    """The error model of a detector.

    bodies: "boxes" where errors refer to true boxes, "places" where they refer to projected bodies (bodies.BODY).
    Several views agree on their places and statures. Of one view, the spread of stature is a part of the latter.
    made: sources, cameras, frames. figures: name → value, and lowest and highest value (95 %). counts: what the fit had.
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
        _check(self)

    def to_json(self) -> str:
        """One JSON object, and the same bytes for the same model."""
        return json_text({"schema": SCHEMA} | asdict(self)) + "\n"

    @staticmethod
    def from_json(text: str, where: str = "detector model") -> DetectorModel:
        """Inverse of to_json. Raises ValueError, in one line that begins with `where`, for other content."""
        return _model_of(parse_json(text, where), where)


UNUSED = {"edges": {"fills", "fill_time_s"}}
"""Part → fields that files of 0.4.0 have, and that are not read: predictions of real rows are as good without them."""
PARTS: dict[str, type] = {
    "misses": Misses,
    "edges": EdgeErrors,
    "confidences": Confidences,
    "merges": Merges,
    "second": SecondBoxes,
    "false": FalseBoxes,
    "standing": StandingBoxes,
}


def read_model(path: Path) -> DetectorModel:
    """Read a model file. Raises ValueError with the file and the field for invalid content."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    return _model_of(read_json(path), str(path))


def model_names() -> list[str]:
    """Names of the models that come with the package."""
    folder = resources.files("tracker.detector_models") / "models"
    return sorted(entry.name.removesuffix(".json") for entry in folder.iterdir() if entry.name.endswith(".json"))


def named_model(name: str) -> DetectorModel:
    """A model that comes with the package. Raises ValueError with all names for an unknown one."""
    if name not in model_names():
        raise ValueError(f"detector model is {name!r}, needs {INDEPENDENT}, a file, or one of {', '.join(model_names())}")
    text = (resources.files("tracker.detector_models") / "models" / f"{name}.json").read_text(encoding="utf-8")
    return DetectorModel.from_json(text, name)


def chosen_model(text: str) -> str:
    """The value of --detector-model as scenarios hold it: a name as it is, a file as its content.

    Raises ValueError for an unknown name, and for an invalid file.
    """
    if text == INDEPENDENT or text in model_names():
        return text
    if Path(text).is_file() or text.endswith(".json"):
        return read_model(Path(text)).to_json()
    named_model(text)
    return text


Model = DetectorModel | IndependentErrors


def model_of(choice: str, independent: IndependentErrors | None = None) -> Model:
    """The model of a scenario, as `chosen_model` gave it. independent: the errors of INDEPENDENT, None for the default ones.

    Raises ValueError for an unknown name or other content.
    """
    if choice == INDEPENDENT:
        return independent or IndependentErrors()
    return DetectorModel.from_json(choice) if choice.lstrip().startswith("{") else named_model(choice)


def _model_of(content: Any, where: str) -> DetectorModel:
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise ValueError(f"{where}: is no detector model of schema {SCHEMA}, as `pilsim fit-detector` writes it")
    names = {f.name for f in fields(DetectorModel)} | {"schema"}
    for kind, wrong in (("lacks", names - set(content)), ("has the unknown field", set(content) - names)):
        if wrong:
            raise ValueError(f"{where}: {kind} {shown(sorted(wrong)[0])}")
    try:
        parts = {name: _part(name, cls, content[name]) for name, cls in PARTS.items()}
        if not isinstance(content["name"], str) or not all(isinstance(content[key], dict) for key in ("made", "figures", "counts")):
            raise ValueError("name needs a text; made, figures and counts need objects")
        figures = {name: _triple(f"figures.{name}", value) for name, value in content["figures"].items()}
        counts = {name: int(_real(f"counts.{name}", value)) for name, value in content["counts"].items()}
        return DetectorModel(content["name"], content["bodies"], made=content["made"], figures=figures, counts=counts, **parts)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _part(name: str, cls: type, content: Any) -> Any:
    needed = {f.name for f in fields(cls) if f.default is MISSING}
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key not in UNUSED.get(name, ())}
    if not isinstance(content, dict) or not needed <= set(content) <= {f.name for f in fields(cls)}:
        raise ValueError(f"{name} needs the fields {', '.join(f.name for f in fields(cls))}")
    part = cls(**{key: _frozen(f"{name}.{key}", value) for key, value in content.items()})
    return replace(part, samples=tuple(map(_as_eight, part.samples))) if isinstance(part, SecondBoxes) and isinstance(part.samples, tuple) else part


def _as_eight(row: Any) -> Any:
    """A sample of second boxes in the layout of now: of 0.3.0 with 5 columns, all from the whole bodies of all alike, or with 7, without runs."""
    columns = len(row) if isinstance(row, tuple) else 0
    return (*row, 1.0, 1.0, 0.0) if columns == 5 else (*row, 0.0) if columns == 7 else row


def _frozen(name: str, value: Any) -> Any:
    """Numbers, and lists of them as tuples."""
    return tuple(_frozen(name, one) for one in value) if isinstance(value, list) else _real(name, value)


def _real(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LONGEST:
        raise ValueError(f"{name} is {shown(json.dumps(value))[:60]}, needs a number of at most {LONGEST:g}")
    return float(value)


def _triple(name: str, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise ValueError(f"{name} needs three numbers")
    return _real(name, value[0]), _real(name, value[1]), _real(name, value[2])


def _check(model: DetectorModel) -> None:
    """Raises ValueError for a field of the wrong shape or out of bounds."""
    if model.bodies not in ("boxes", "places"):
        raise ValueError(f"bodies is {model.bodies!r}, needs boxes or places")
    m, e, c = model.misses, model.edges, model.confidences
    for name, value, shape in (
        ("misses.coefficients", m.coefficients, (len(FEATURES),)),
        ("misses.sizes", m.sizes, (2,)),
        ("edges.quantiles", e.quantiles, (2, 4, KNOTS)),
        ("edges.lasting", e.lasting, (4,)),
        ("edges.time_s", e.time_s, (4,)),
        ("edges.correlation", e.correlation, (4, 4)),
        ("confidences.quantiles", c.quantiles, (KNOTS,)),
        ("confidences.coefficients", c.coefficients, (len(FEATURES),)),
        ("merges.probability", model.merges.probability, (len(OVERLAPS),)),
    ):
        _check_shape(name, value, shape)
    _check_optional(model)
    _check_samples("second.samples", model.second.samples, 8)
    _check_samples("false.samples", model.false.samples, 4)
    _check_samples("standing.samples", model.standing.samples, 6)
    _check_samples("standing.fixed", model.standing.fixed, 8)
    for name, value, low, high in (
        ("misses.flicker", m.flicker, 0.0, 1.0),
        ("misses.unseen", m.unseen, 0.0, 1.0),
        ("edges.near", e.near, 0.0, 10.0),
        ("standing.life_s", model.standing.life_s, 0.0, LONGEST),
        ("standing.births", model.standing.births, 0.0, 1000.0),
        ("confidences.lasting", c.lasting, 0.0, 1.0),
        ("confidences.spread", c.spread, 0.0, 100.0),
        ("standing.jitter", model.standing.jitter, 0.0, 10.0),
        ("second.step_s", model.second.step_s, 0.0, LONGEST),
        ("standing.sites", model.standing.sites, 0.0, 1000.0),
        ("false.rate", model.false.rate, 0.0, 1000.0),
        ("edges.hidden", e.hidden, 0.0, 1.0),
        ("edges.border", e.border, 0.0, 1.0),
        *((f"edges.lasting[{k}]", one, 0.0, 1.0) for k, one in enumerate(e.lasting)),
        *((f"merges.probability[{k}]", one, 0.0, 1.0) for k, one in enumerate(model.merges.probability)),
        *((f"second.rates[{k}]", one, 0.0, 1.0) for k, one in enumerate(model.second.rates)),
        *((f"{part}.time_s", getattr(model, part).time_s, 0.0, LONGEST) for part in ("misses", "confidences", "merges", "second", "standing")),
        *((f"edges.time_s[{k}]", one, 0.0, LONGEST) for k, one in enumerate(e.time_s)),
    ):
        if not (isinstance(value, float | int) and low <= value <= high):
            raise ValueError(f"{name} is {value}, needs {low:g} to {high:g}")
    for name, rows in (("edges.quantiles", (*e.quantiles[0], *e.quantiles[1])), ("confidences.quantiles", (c.quantiles,))):
        if any((np.diff(row) < 0).any() for row in rows):
            raise ValueError(f"{name} needs rows that do not fall")
    matrix = np.array(e.correlation)
    if not (np.allclose(matrix, matrix.T, atol=1e-6) and np.allclose(np.diag(matrix), 1.0, atol=1e-6) and np.abs(matrix).max() <= 1 + 1e-6):
        raise ValueError("edges.correlation needs a symmetric matrix with 1 on its diagonal")
    for part, needed in (("second", max(model.second.rates, default=0.0)), ("false", model.false.rate), ("standing", model.standing.sites)):
        if needed and not getattr(model, part).samples:
            raise ValueError(f"{part}.samples is empty, needs samples where there are such boxes")


def _check_optional(model: DetectorModel) -> None:
    """Fields that files of older models lack."""
    e = model.edges
    for name, value, shape in (
        ("edges.trend", e.trend, (4, len(TREND))),
        ("edges.trend_bounds", e.trend_bounds, (2, len(TREND))),
        ("second.coefficients", model.second.coefficients, (len(FEATURES) + 1,)),
    ):
        if value:
            _check_shape(name, value, shape)
    if bool(e.trend) != bool(e.trend_bounds):
        raise ValueError("edges.trend needs trend_bounds, and they need it")


def _check_shape(name: str, value: Any, shape: tuple[int, ...]) -> None:
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} needs {' x '.join(map(str, shape))} numbers") from None
    if found.shape != shape or not np.isfinite(found).all():
        raise ValueError(f"{name} needs {' x '.join(map(str, shape))} numbers")


def _check_samples(name: str, value: Any, width: int) -> None:
    if not isinstance(value, tuple) or len(value) > MOST_SAMPLES:
        raise ValueError(f"{name} needs at most {MOST_SAMPLES} samples")
    for row in value:
        _check_shape(f"{name}[…]", row, (width,))


def persistence(time_s: float, period: float) -> float:
    """Correlation from one frame to the next of a process of time constant time_s."""
    return math.exp(-period / time_s) if time_s > 0 else 0.0
