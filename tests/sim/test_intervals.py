"""Means with intervals: by hand, and by how often they hold the truth."""

import math

import numpy as np
import pytest

from sim.intervals import mean_interval, paired


def test_by_hand() -> None:
    # Mean 2, s = 1, t(2 degrees of freedom, 97.5 %) = 4.302653: 2 ± 4.302653 / √3.
    found = mean_interval([1.0, 2.0, 3.0])
    assert found.mean == 2.0
    assert found.low is not None
    assert found.low == pytest.approx(2 - 4.302653 / math.sqrt(3), abs=1e-6)
    assert found.text() == "2.00 (−0.48 to 4.48)"
    assert found.text(1, signed=True) == "+2.0 (−0.5 to +4.5)"


def test_it_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(5)
    held = sum(found.low <= 0.3 <= found.high for found in (mean_interval(rng.normal(0.3, 2.0, 5)) for _ in range(2000)) if found.low and found.high)
    # 95 % of 2000 is 1900, with a standard deviation of 9.7.
    assert 1860 < held < 1940


def test_one_value_has_no_interval_and_none_is_refused() -> None:
    assert (mean_interval([0.5]).low, mean_interval([0.5]).verdict, mean_interval([0.5]).text()) == (None, "one seed", "0.50")
    with pytest.raises(ValueError, match="needs at least 1"):
        mean_interval([])


def test_pairs_and_verdicts() -> None:
    first = {1: 0.5, 2: 0.6, 3: 0.9, 8: 0.0}
    up = paired(first, {1: 0.7, 2: 0.81, 3: 1.1, 9: 5.0})
    assert up is not None
    assert (up.count, up.verdict) == (3, "higher")
    assert up.mean == pytest.approx((0.2 + 0.21 + 0.2) / 3)
    down = paired({1: 0.7, 2: 0.81, 3: 1.1}, first)
    assert down is not None
    assert down.verdict == "lower"
    same, mixed = paired(first, first), paired(first, {1: 0.7, 2: 0.4, 3: 0.9})
    assert same is not None
    assert same.verdict == "identical"
    assert mixed is not None
    assert mixed.verdict == "no difference seen"
    assert paired(first, {7: 1.0}) is None


def test_more_confidence_is_a_wider_interval() -> None:
    values = [0.1, 0.4, 0.2]
    wide, narrow = mean_interval(values, 0.99), mean_interval(values)
    assert wide.low is not None
    assert narrow.low is not None
    assert wide.low < narrow.low
