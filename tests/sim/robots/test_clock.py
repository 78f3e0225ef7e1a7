"""Clocks: offset, drift and jitter are found back from stamps, and wrong descriptions are refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import chi2

from sim.robots.clock import Clock, ClockSpecification, parse_clocks


def test_errors_are_found_back_by_least_squares() -> None:
    clock, time = Clock(0.3, 40.0, 0.002), np.arange(12_000) / 200
    error = clock.stamps(time, np.random.default_rng(3)) - time
    A = np.column_stack([np.ones_like(time), time * 1e-6])
    found, residual, *_ = np.linalg.lstsq(A, error, rcond=None)
    sigma = clock.jitter * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    assert (np.abs(found - [clock.offset, clock.drift]) < 5 * sigma).all()
    low, high = np.sqrt(chi2.ppf([1e-7, 1 - 1e-7], len(time) - 2) / (len(time) - 2))
    assert low < np.sqrt(residual[0] / (len(time) - 2)) / clock.jitter < high


def test_an_exact_clock_shows_the_time() -> None:
    time = np.arange(5) / 3
    np.testing.assert_array_equal(Clock().stamps(time, np.random.default_rng(0)), time)


def test_descriptions() -> None:
    found = parse_clocks("offset=-0.02,jitter=0.001;robot_0_camera: drift=+-20, offset=±0.5")
    assert found == {
        "": ClockSpecification(Clock(-0.02, 0.0, 0.001), frozenset()),
        "robot_0_camera": ClockSpecification(Clock(0.5, 20.0, 0.0), frozenset({"offset", "drift"})),
    }
    assert found[""].draw(np.random.default_rng(1)) == Clock(-0.02, 0.0, 0.001)
    clocks = [found["robot_0_camera"].draw(np.random.default_rng(k)) for k in range(500)]
    low, high = np.sqrt(chi2.ppf([1e-6, 1 - 1e-6], 500) / 500)
    for values, sigma in (([c.offset for c in clocks], 0.5), ([c.drift for c in clocks], 20.0)):
        assert low < np.sqrt(np.mean(np.square(values))) / sigma < high


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jitter=-0.001", "clock has jitter '-0.001', needs a number in [0, 1] s"),
        ("jitter=±0.001", "clock has a jitter with ±"),
        ("offset=1e9", "clock has offset '1e9', needs a number in [-1000, 1000] s"),
        ("offset=nan", "clock has offset 'nan', needs"),
        ("offset=±-1", "clock has offset '-1', needs a number in [0, 1000] s"),
        ("drift=fast", "clock has drift 'fast', needs a number in [-10000, 10000] ppm"),
        ("skew=1", "clock has 'skew=1', needs [NAME:]offset=S"),
        ("0.02", "clock has '0.02', needs [NAME:]offset=S"),
        ("offset=1,offset=2", "clock has offset twice"),
        ("offset=1;offset=2", "clock names all clocks twice"),
        ("a b:offset=1", "clock has the name 'a b'"),
        ("robot_0:offset=1;", "clock has '', needs"),
    ],
)
def test_wrong_descriptions_are_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        parse_clocks(text)
