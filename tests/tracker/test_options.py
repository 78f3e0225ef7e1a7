"""Parameters from options by name: the defaults, what each option sets, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tracker.options import OPTIONS, parameters_from
from tracker.pipeline import Parameters


def test_no_options_are_the_defaults() -> None:
    assert parameters_from({}) == parameters_from(dict.fromkeys(OPTIONS)) == Parameters()


def test_every_option_reaches_its_parameter() -> None:
    plain = parameters_from({"slam": "ekf", "iterations": 5, "correction": "off"}).slam
    assert (plain.mode, plain.iterations, plain.correction) == ("iekf", 1, False)
    people = parameters_from({"v_max": 2.0, "delta_a": 1.0, "n_conf": 3, "delay": 4, "images": True, "l_c": 6})
    assert (people.targets.motion.v_max, people.targets.delta_a, people.targets.n_conf) == (2.0, 1.0, 3)
    assert people.delay == 4
    assert people.images.tracklets is not None
    assert people.images.tracklets.l_c == 6
    chosen: dict[str, Any] = {"k_h": 5, "i_bls_max": 100, "n_scan": 2.0, "v_max": 2.0, "seed_search": 7, "dump_graphs": "graphs"}
    many = parameters_from(chosen).targets
    assert (many.k_h, many.i_bls_max, many.n_scan, many.motion.v_max, many.seed) == (5, 100, 2.0, 2.0, 7)
    assert parameters_from(chosen).graphs == Path("graphs")
    assert parameters_from({}).targets.k_h == 1
    assert parameters_from({"n_scan": 0}).targets.n_scan == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"slam": "ukf"}, "--slam is 'ukf', needs one of ekf, iekf, fej"),
        ({"slam": "invariant"}, "--slam invariant is for UTIAS data alone, needs one of ekf, iekf, fej"),
        ({"correction": True}, "--correction is True, needs one of on, off"),
        ({"k_h": 0}, "--k-h is 0, needs more than 0"),
        ({"k_h": 2.5}, "--k-h is 2.5, needs a whole number"),
        ({"n_scan": -0.5}, "--n-scan is -0.5, needs at least 0"),
        ({"hypotheses": "multiple"}, "option 'hypotheses' of the tracker is unknown"),
        ({"v_max": float("nan")}, "--v-max is nan, needs a number"),
        ({"images": "yes"}, "--images is 'yes', needs true or false"),
        ({"l_c": 3}, "--l-c, --delta-min and --omega need --images"),
        ({"iterations": 0}, "iterations is 0, needs at least 1"),
        ({"speed": 3}, "option 'speed' of the tracker is unknown"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parameters_from(options)


def test_odometry_biases_are_estimated_by_default_and_not_with_other_filters() -> None:
    assert parameters_from({"slam": "fej"}).slam == Parameters().slam
    assert Parameters().slam.odometry_biases is not None
    for slam in ("ekf", "iekf"):
        assert parameters_from({"slam": slam}).slam.odometry_biases is None
    assert parameters_from({"persistence": "off"}).slam.odometry_biases is None
    assert parameters_from({"slam": "iekf", "persistence": "on"}).slam.odometry_biases is not None
    with pytest.raises(ValueError, match="--persistence on is for --slam fej or iekf, not ekf"):
        parameters_from({"slam": "ekf", "persistence": "on"})
