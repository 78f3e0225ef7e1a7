"""Confidence intervals: by hand, as laws, and by how often they cover the true mean."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.confidence_intervals import (
    AT_LEAST_ZERO,
    AT_MOST_ONE,
    FEWEST_RESAMPLED,
    SHARE,
    Bounds,
    bounds_of,
    difference_bounds_of,
    mean_interval,
    paired,
    student_interval,
)

SHARES = st.lists(st.floats(0, 1, allow_subnormal=False), min_size=2, max_size=12)


def test_student_by_hand() -> None:
    # Mean 2, s = 1, t(2 degrees of freedom, 97.5 %) = 4.302653: 2 ± 4.302653 / √3.
    found = mean_interval([1.0, 2.0, 3.0])
    assert found == student_interval([1.0, 2.0, 3.0])
    assert found.mean == 2.0
    assert found.low is not None
    assert found.low == pytest.approx(2 - 4.302653 / math.sqrt(3), abs=1e-6)
    assert found.text() == "2.00 (−0.48 to 4.48)"
    assert found.text(1, signed=True) == "+2.0 (−0.5 to +4.5)"
    assert mean_interval([1.0, 2.0, 3.0], bounds=(0.5, 4.0)).text() == "2.00 (0.50 to 4.00)"


def test_bootstrap_of_two_values_by_hand() -> None:
    # Eight values, seven 0 and one 8: the mean of a resample is the number of times that the 8 is drawn, which is binomial(8, 1/8).
    # It is 0 in 34 % of the resamples and above 5 in 0.009 %. BCa moves both ends up here, so the upper end is between 2 and 6.
    found = mean_interval([0.0] * 7 + [8.0])
    assert found.low == 0.0
    assert found.high is not None
    assert 2 <= found.high <= 6


@settings(max_examples=60, deadline=None)
@given(SHARES)
def test_an_interval_stays_in_the_range_and_holds_the_mean(values: list[float]) -> None:
    found = mean_interval(values, bounds=SHARE)
    assert found.low is not None
    assert found.high is not None
    assert found.low <= found.mean <= found.high
    low, high = (min(values), max(values)) if len(values) >= FEWEST_RESAMPLED else (0.0, 1.0)
    rounding = 1e-12
    assert low - rounding <= found.low
    assert found.high <= high + rounding


@settings(max_examples=40, deadline=None)
@given(SHARES, st.permutations(range(12)))
def test_order_and_earlier_calls_do_not_matter(values: list[float], order: list[int]) -> None:
    first = mean_interval(values)
    shuffled = [values[k] for k in order if k < len(values)]
    np.random.seed(1)
    mean_interval([0.1, 0.9, 0.4, 0.4, 0.3, 0.2])
    again, other = mean_interval(values), mean_interval(shuffled)
    assert again == first
    assert (other.mean, other.low, other.high) == pytest.approx((first.mean, first.low, first.high), abs=1e-12)


@pytest.mark.soak
def test_more_values_make_it_narrower() -> None:
    rng = np.random.default_rng(3)
    widths = []
    for count in (3, 6, 12, 48, 192):
        found = [mean_interval(rng.exponential(1.0, count)) for _ in range(40)]
        widths.append(np.mean([one.high - one.low for one in found if one.low is not None and one.high is not None]))
    assert all(wide > narrow for wide, narrow in pairwise(widths))
    # The width goes with 1 / √n: from 48 to 192 values it halves.
    assert widths[-1] / widths[-2] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("values", [[0.7] * 2, [0.7] * 8, [0.1 + 0.2, *[0.3] * 7]])
def test_equal_values_have_no_width(values: list[float]) -> None:
    found = mean_interval(values)
    assert (found.low, found.high) == (pytest.approx(values[0], abs=1e-15), pytest.approx(values[0], abs=1e-15))


def covered(draw: Callable[[int], np.ndarray], true: float, count: int, bounds: Bounds, trials: int = 600) -> float:
    """The share of samples whose interval contains the true mean."""
    found = [mean_interval(draw(count), bounds=bounds) for _ in range(trials)]
    return float(np.mean([one.low is not None and one.high is not None and one.low <= true <= one.high for one in found]))


@pytest.mark.soak
@pytest.mark.parametrize("count", [3, 5, 6, 10, 20])
def test_coverage_of_figures_that_have_a_bound(count: int) -> None:
    """The true mean of skewed values is covered less often than 95 %, by as much as the docstring says."""
    rng = np.random.default_rng(5)
    # A standard deviation of the share over 600 trials is 0.012 at 0.91.
    errors = covered(lambda n: rng.lognormal(0.0, 0.5, n), math.exp(0.125), count, AT_LEAST_ZERO)
    assert 0.87 <= errors <= 0.98
    accuracies = covered(lambda n: rng.beta(9, 1, n), 0.9, count, AT_MOST_ONE)
    assert 0.84 <= accuracies <= 0.98


@pytest.mark.soak
@pytest.mark.parametrize("count", [3, 5, 10])
def test_coverage_of_paired_differences(count: int) -> None:
    """A verdict is wrong in 5 % of the comparisons of equal trackers, for symmetric and for skewed scores."""
    rng = np.random.default_rng(6)
    seeds = range(count)
    for draw in (lambda: rng.normal(0.3, 2.0, count), lambda: rng.lognormal(0.0, 0.5, count)):
        pairs = [paired(dict(zip(seeds, draw(), strict=True)), dict(zip(seeds, draw(), strict=True))) for _ in range(2000)]
        wrong = np.mean([one is not None and one.verdict in ("higher", "lower") for one in pairs])
        # 5 % of 2000 is 100, with a standard deviation of 9.7; Student's t is a little careful on skewed scores.
        assert 0.02 < wrong < 0.065


def test_one_value_has_no_interval_and_none_is_refused() -> None:
    assert (mean_interval([0.5]).low, mean_interval([0.5]).verdict, mean_interval([0.5]).text()) == (None, "one seed", "0.50")
    for interval in (mean_interval, student_interval):
        with pytest.raises(ValueError, match="needs at least 1"):
            interval([])


def test_bounds_by_name() -> None:
    assert [bounds_of(name) for name in ("mota", "ate_m", "idf1", "reward")] == [(None, 1.0), (0.0, None), (0.0, 1.0), (None, None)]
    # The two figures that a report of three seeds showed beyond their range.
    assert mean_interval([0.02, 0.02, 0.068], bounds=bounds_of("ate_m")).low == 0.0
    assert mean_interval([0.97, 0.95, 0.86], bounds=bounds_of("mota")).high == 1.0


def test_pairs_and_verdicts() -> None:
    first = {1: 0.5, 2: 0.6, 3: 0.9, 8: 0.0}
    second = {1: 0.7, 2: 0.81, 3: 1.1, 9: 5.0}
    up = paired(first, second)
    assert up is not None
    assert up.count == 3
    assert up.mean == pytest.approx((0.2 + 0.21 + 0.2) / 3)
    found = [paired(*pair) for pair in ((first, second), (second, first), (first, first), (first, {1: 0.7, 2: 0.4, 3: 0.9}))]
    assert [one.verdict for one in found if one] == ["higher", "lower", "identical", "no difference seen"]
    assert paired(first, {7: 1.0}) is None


def test_bounds_of_differences() -> None:
    assert [difference_bounds_of(name) for name in ("idf1", "mota", "ate_m")] == [(-1.0, 1.0), (None, None), (None, None)]
    found = paired({0: 0.0, 1: 0.0}, {0: 0.9, 1: 0.5}, bounds=difference_bounds_of("idf1"))
    assert found is not None
    assert (found.low, found.high) == (-1.0, 1.0)
