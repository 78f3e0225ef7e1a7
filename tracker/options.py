"""Parameters of the tracker from options by name, with checks; shared by the command `track`, the stress test and Python.

A name is that of the command line with `_` for `-`, as k_h for --k-h. Messages name options as the command line does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.detections.silhouettes import SilhouetteParameters
from tracker.pipeline import Parameters
from tracker.slam.parameters import SlamParameters
from tracker.tracks.parameters import MhtParameters

CHOICES: dict[str, tuple[str, ...]] = {
    "slam": ("ekf", "iekf", "fej"),
    "correction": ("on", "off"),
    "persistence": ("on", "off"),
    "confidence": ("given", "learned"),
}
"""Options with a choice of words."""
WHOLE = ("iterations", "delay", "n_conf", "k_h", "i_bls_max", "seed_search", "l_c")
"""Options that are whole numbers."""
REAL = ("theta_s", "v_max", "delta_a", "n_scan", "delta_min", "omega")
"""Options that are real numbers."""
POSITIVE = ("theta_s", "v_max", "delta_a", "n_conf", "k_h", "i_bls_max")
NOT_NEGATIVE = ("n_scan",)
OPTIONS = (*CHOICES, *WHOLE, *REAL, "images", "dump_graphs")
"""Names of all options."""


def parameters_from(options: Mapping[str, Any]) -> Parameters:
    """Parameters from options by name; an option that is missing or None has its default value.

    images: bool; dump_graphs: a folder. Raises ValueError for an option that is unknown, out of bounds, or without effect beside the others.
    """
    given = {name: value for name, value in options.items() if value is not None}
    _check(given)
    graphs = Path(given["dump_graphs"]) if "dump_graphs" in given else None
    return Parameters(_slam(given), _targets(given), _images(given), given.get("delay", 0), graphs)


def _check(given: Mapping[str, Any]) -> None:
    """Names, types and bounds of single options."""
    for name, value in given.items():
        flag = f"--{name.replace('_', '-')}"
        if name not in OPTIONS:
            raise ValueError(f"option {name!r} of the tracker is unknown, needs one of {', '.join(OPTIONS)}")
        if name == "slam" and value == "invariant":
            raise ValueError("--slam invariant is for UTIAS data alone, needs one of ekf, iekf, fej")
        if name in CHOICES and value not in CHOICES[name]:
            raise ValueError(f"{flag} is {value!r}, needs one of {', '.join(CHOICES[name])}")
        if name in WHOLE and (isinstance(value, bool) or not isinstance(value, int)):
            raise ValueError(f"{flag} is {value!r}, needs a whole number")
        if name in REAL and (isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value)):
            raise ValueError(f"{flag} is {value!r}, needs a number")
        if name in POSITIVE and not value > 0:
            raise ValueError(f"{flag} is {value}, needs more than 0")
        if name in NOT_NEGATIVE and not value >= 0:
            raise ValueError(f"{flag} is {value}, needs 0 or more")
        if name == "images" and not isinstance(value, bool):
            raise ValueError(f"{flag} is {value!r}, needs true or false")


def _slam(given: Mapping[str, Any]) -> SlamParameters:
    """Parameters of SLAM: fej by default, which estimates odometry biases unless persistence is off."""
    slam, persistence = given.get("slam", "fej"), given.get("persistence")
    if persistence == "on" and slam == "ekf":
        raise ValueError("--persistence on is for --slam fej or iekf, not ekf")
    biases = persistence == "on" or (persistence is None and slam == "fej")
    chosen = SlamParameters().with_odometry_biases() if biases else SlamParameters()
    # The plain filter is the iterated one with one iteration.
    mode, iterations = ("iekf", 1) if slam == "ekf" else (slam, given.get("iterations", chosen.iterations))
    return replace(chosen, mode=mode, iterations=iterations, correction=given.get("correction", "on") == "on")


def _targets(given: Mapping[str, Any]) -> MhtParameters:
    """Parameters of the tracker of people."""
    chosen = MhtParameters()
    if "v_max" in given:
        chosen = replace(chosen, motion=replace(chosen.motion, v_max=given["v_max"]))
    if given.get("confidence") == "learned":
        chosen = replace(chosen, detection_rates=replace(chosen.detection_rates, learned=True))
    fields = {"theta_s": "merge_distance"} | {name: name for name in ("delta_a", "n_conf", "k_h", "i_bls_max", "n_scan")}
    own = {field: given[name] for name, field in fields.items() if name in given}
    return replace(chosen, **own, seed=given.get("seed_search", 0))


def _images(given: Mapping[str, Any]) -> ImageParameters:
    """What is extracted from images: nothing without `images`."""
    tracklets = {name: given[name] for name in ("l_c", "delta_min", "omega") if name in given}
    images = given.get("images", False)
    if tracklets and not images:
        raise ValueError("--l-c, --delta-min and --omega need --images")
    if not images:
        return ImageParameters()
    return ImageParameters(TrackletParameters(**tracklets) if tracklets else None, SilhouetteParameters(), appearance=True)
