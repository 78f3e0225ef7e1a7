"""Options of the tracker, declared once with type, bound, default and help. Commands include these dataclasses; Python code passes options by name.

A name is that of the command line with `_` for `-`, as k_h for --k-h. Messages name options as the command line does.
An option that is None has the default value of its parameter. The tracker is imported on demand, since the help of a command does not need it.
"""

from __future__ import annotations

import importlib
import math
import os
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin, get_type_hints

from tyro.conf import Suppress, arg

if TYPE_CHECKING:
    from tracker.detections.front_end import ImageParameters
    from tracker.pipeline import Parameters
    from tracker.slam.parameters import SlamParameters
    from tracker.tracks.parameters import MhtParameters


NOTHING = ("None", "''", "")
"""Defaults, as tyro shows them, that do not inform a reader."""


def unset(metavar: str, meaning: str) -> Any:
    """The help of an option without a default value: the name of its value, and the meaning of its absence in place of `None`."""
    return arg(metavar=metavar, help_behavior_hint=lambda shown: f"(default: {meaning if shown in NOTHING else shown})")


@dataclass(frozen=True)
class Least:
    """A lower bound of an option, which the bound itself satisfies unless `above`."""

    value: float
    above: bool = False

    def check(self, flag: str, value: float) -> None:
        """Raises ValueError for a value out of bounds."""
        if not value >= self.value or (self.above and value == self.value):
            raise ValueError(f"{flag} is {value}, needs {'more than' if self.above else 'at least'} {self.value:g}")


@dataclass(frozen=True)
class Ending:
    """The ending of the name of a file."""

    text: str

    def check(self, flag: str, value: Path) -> None:
        """Raises ValueError for another ending."""
        if value.suffix.lower() != self.text:
            raise ValueError(f"{flag} is {value}, needs a name that ends in {self.text}")


def check_options(group: Any) -> None:
    """Raises ValueError for an option out of the bounds that its annotation names. group: a dataclass of options, and of groups of them."""
    for name, hint in get_type_hints(type(group), include_extras=True).items():
        value = getattr(group, name)
        if is_dataclass(value):
            check_options(value)
        for mark in getattr(hint, "__metadata__", ()):
            if isinstance(mark, (Least, Ending)) and value is not None:
                mark.check(f"--{name.replace('_', '-')}", value)


POSITIVE, NOT_NEGATIVE = Least(0, above=True), Least(0)


@dataclass(frozen=True)
class FilterOptions:
    """The filter that estimates the poses of the robots."""

    slam: Annotated[Literal["ekf", "iekf", "fej", "invariant"] | None, unset("{ekf,iekf,fej,invariant}", "fej; UTIAS: invariant")] = None
    """Filter of the robots' poses: extended, iterated, with first-estimates Jacobians, or (UTIAS alone) with the right-invariant error."""
    iterations: Annotated[int | None, unset("INT", "2")] = None
    """Number of linearizations of an update; ekf has one."""
    correction: Annotated[Literal["on", "off"] | None, unset("{on,off}", "on")] = None
    """Whether the filter estimates each robot's odometry correction factor."""
    persistence: Annotated[Literal["on", "off"] | None, unset("{on,off}", "on with fej")] = None
    """Whether the filter models lasting errors: odometry biases, as of wheel slip, and drift of features; for fej or iekf."""


@dataclass(frozen=True)
class PeopleOptions:
    """The tracker of people."""

    delay: int = 0
    """Number of frames by which the output lags; later frames smooth the positions of people."""
    confidence: Annotated[Literal["given", "learned"] | None, unset("{given,learned}", "learned")] = None
    """Meaning of the confidences of detections: learned for each view while tracking, whatever their scale, or probabilities as given."""
    n_scan: Annotated[float | None, NOT_NEGATIVE, unset("FLOAT", "1.43")] = None
    """N-scan pruning: age after which a decision is final, s. With 0 decisions are final at once, which is fastest."""
    theta_s: Annotated[float | None, POSITIVE, Suppress] = None
    """Without effect: tracks near each other are no longer merged. The option goes with the next version."""
    v_max: Annotated[float | None, POSITIVE, unset("FLOAT", "3.0")] = None
    """v_max: maximum speed of a person, m/s; a faster track is deleted."""
    delta_a: Annotated[float | None, POSITIVE, unset("FLOAT", "1.29")] = None
    """Δ_a: longest time that a track coasts without a detection, s."""
    n_conf: Annotated[int | None, POSITIVE, unset("INT", "2")] = None
    """N_conf: number of frames before a track may be confirmed."""
    parameters: Annotated[Path | None, unset("FILE.toml", "none")] = None
    """Any parameters of the tracker of people, as `pilsim tune` writes them into best.toml; other options override them."""


@dataclass(frozen=True)
class HypothesisOptions:
    """Multiple hypothesis tracking: its graphs, and the search in them."""

    k_h: Annotated[int | None, POSITIVE, unset("INT", "1")] = None
    """K_H: number of global hypotheses kept; above 1 the child hypotheses of each form a graph of their own, else all tracks form one."""
    i_bls_max: Annotated[int | None, POSITIVE, unset("INT", "2000")] = None
    """i_bls^max: maximum number of moves of the clique search."""
    seed_search: int = 0
    """Seed of the clique search."""
    dump_graphs: Annotated[Path | None, unset("DIR", "nowhere")] = None
    """Folder for every weighted graph that is solved (DIMACS), with the clique that was chosen."""


@dataclass(frozen=True)
class ImageOptions:
    """What is extracted from images."""

    images: bool = False
    """Use the images, too: silhouettes and appearance. A recording needs video/ or images/ of any camera."""
    l_c: Annotated[int | None, unset("INT", "4")] = None
    """L_c: number of frames over which corners are tracked back. L_c, δ_min and ω need --images; their tracklets weigh boxes."""
    delta_min: Annotated[float | None, unset("FLOAT", "0.05")] = None
    """δ_min: a corner that moves less is static, px of the image at half its size."""
    omega: Annotated[float | None, unset("FLOAT", "0.3")] = None
    """ω: corners of one body differ in motion by at most this share of the box width."""


@dataclass(frozen=True)
class OptionType:
    """The allowed values of an option. kind: int, float, bool, str or Path. choices: the allowed words, empty for any. bounds: of a number."""

    kind: type
    choices: tuple[str, ...] = ()
    bounds: tuple[Least, ...] = ()

    @staticmethod
    def of(hint: Any) -> OptionType:
        """From the annotation of a field."""
        marks = getattr(hint, "__metadata__", ())
        plain = get_args(hint)[0] if marks else hint
        plain = next((part for part in get_args(plain) if part is not type(None)), plain) if type(None) in get_args(plain) else plain
        bounds = tuple(mark for mark in marks if isinstance(mark, Least))
        return OptionType(str, get_args(plain)) if get_origin(plain) is Literal else OptionType(plain, (), bounds)

    def check(self, flag: str, value: Any) -> None:
        """Raises ValueError for a value of another type or out of bounds."""
        if self.choices and value not in self.choices:
            raise ValueError(f"{flag} is {value!r}, needs one of {', '.join(self.choices)}")
        if self.kind is bool and not isinstance(value, bool):
            raise ValueError(f"{flag} is {value!r}, needs true or false")
        if self.kind is int and (isinstance(value, bool) or not isinstance(value, int)):
            raise ValueError(f"{flag} is {value!r}, needs a whole number")
        if self.kind is float and (isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value)):
            raise ValueError(f"{flag} is {value!r}, needs a number")
        for bound in self.bounds:
            bound.check(flag, value)


OPTIONS: dict[str, OptionType] = {
    name: OptionType.of(hint)
    for group in (FilterOptions, PeopleOptions, HypothesisOptions, ImageOptions)
    for name, hint in get_type_hints(group, include_extras=True).items()
}
"""All options by name."""


def parameters_from(options: Mapping[str, Any]) -> Parameters:
    """Parameters from options by name; an option that is missing or None has its default value.

    parameters: a file, or its values by path. Raises ValueError for an option that is unknown, out of bounds, or without effect beside the others.
    """
    from tracker.pipeline import Parameters

    given = {name: value for name, value in options.items() if value is not None}
    for name, value in given.items():
        if name not in OPTIONS:
            raise ValueError(f"option {name!r} of the tracker is unknown, needs one of {', '.join(OPTIONS)}")
        OPTIONS[name].check(f"--{name.replace('_', '-')}", value)
    graphs = Path(given["dump_graphs"]) if "dump_graphs" in given else None
    return Parameters(_slam(given), _targets(given), _images(given), given.get("delay", 0), graphs)


def _slam(given: Mapping[str, Any]) -> SlamParameters:
    """Parameters of SLAM: fej by default, which estimates odometry biases unless persistence is off."""
    from tracker.slam.parameters import SlamParameters

    slam, persistence = given.get("slam", "fej"), given.get("persistence")
    if slam == "invariant":
        raise ValueError("--slam invariant is for UTIAS data alone, needs one of ekf, iekf, fej")
    if persistence == "on" and slam == "ekf":
        raise ValueError("--persistence on is for --slam fej or iekf, not ekf")
    biases = persistence == "on" or (persistence is None and slam == "fej")
    chosen = SlamParameters().with_odometry_biases() if biases else SlamParameters()
    # The plain filter is the iterated one with one iteration.
    mode, iterations = ("iekf", 1) if slam == "ekf" else (slam, given.get("iterations", chosen.iterations))
    return replace(chosen, mode=mode, iterations=iterations, correction=given.get("correction", "on") == "on")


def _targets(given: Mapping[str, Any]) -> MhtParameters:
    """Parameters of the tracker of people."""
    from tracker.parameter_file import read_parameters, with_fields
    from tracker.tracks.parameters import MhtParameters

    chosen, file = MhtParameters(), given.get("parameters", {})
    values, where = (file, "parameter") if isinstance(file, Mapping) else (read_parameters(Path(file)), f"{file}: parameter")
    chosen = with_fields(chosen, values, where)
    if "v_max" in given:
        chosen = replace(chosen, motion=replace(chosen.motion, v_max=given["v_max"]))
    if "confidence" in given:
        chosen = replace(chosen, detection_rates=replace(chosen.detection_rates, learned=given["confidence"] == "learned"))
    if "theta_s" in given:
        warnings.warn("--theta-s has no effect: tracks near each other are no longer merged", FutureWarning, stacklevel=2)
    fields = {"seed_search": "seed"} | {name: name for name in ("delta_a", "n_conf", "k_h", "i_bls_max", "n_scan")}
    return replace(chosen, **{field: given[name] for name, field in fields.items() if name in given})


def _images(given: Mapping[str, Any]) -> ImageParameters:
    """What is extracted from images: nothing without `images`."""
    from tracker.detections.front_end import ImageParameters
    from tracker.detections.optical_flow import TrackletParameters

    tracklets = {name: given[name] for name in ("l_c", "delta_min", "omega") if name in given}
    if not given.get("images", False):
        if tracklets:
            raise ValueError("--l-c, --delta-min and --omega need --images")
        return ImageParameters()
    return ImageParameters(TrackletParameters(**tracklets) if tracklets else None, silhouettes=True, appearance=True)


def load_function(text: str, what: str) -> Any:
    """Import module:function. Modules of the working directory go first, as for `python -m`. what: its name in messages.

    Raises ValueError where there is no such function.
    """
    module, _, name = text.partition(":")
    if not module or not name:
        raise ValueError(f"{what} is {text!r}, needs module:function")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        found = getattr(importlib.import_module(module), name, None)
    except ImportError as error:
        raise ValueError(f"{what} {text}: {error}") from None
    if not callable(found):
        raise ValueError(f"{what} {text}: {module} has no function {name}")
    return found
