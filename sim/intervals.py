"""Means over seeds with 95 % intervals, and paired differences: how sure a figure is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

Verdict = Literal["higher", "lower", "no difference seen", "identical", "one seed"]


@dataclass(frozen=True)
class Interval:
    """A mean of `count` independent values and the interval that holds the true mean with the confidence asked for; one value has none
    (low and high are None).
    """

    mean: float
    low: float | None
    high: float | None
    count: int

    def text(self, digits: int = 2, signed: bool = False) -> str:
        """As in 0.61 (0.55 to 0.67)."""
        sign = "+" if signed else ""
        mean, low, high = (None if v is None else f"{v:{sign}.{digits}f}".replace("-", "−") for v in (self.mean, self.low, self.high))
        return str(mean) if low is None else f"{mean} ({low} to {high})"

    @property
    def verdict(self) -> Verdict:
        """What a difference says: only an interval that leaves out 0 is a difference."""
        if self.low is None or self.high is None:
            return "one seed"
        if self.low == self.high == 0:
            return "identical"
        return "higher" if self.low > 0 else "lower" if self.high < 0 else "no difference seen"


def mean_interval(values: Sequence[float], confidence: float = 0.95) -> Interval:
    """Student's t interval of the mean: mean ± t(n − 1) · s / √n. Raises ValueError where there is no value."""
    array = np.asarray(values, dtype=np.float64)
    if not len(array):
        raise ValueError("values has length 0, needs at least 1")
    mean = float(array.mean())
    if len(array) == 1:
        return Interval(mean, None, None, 1)
    spread = float(array.std(ddof=1)) / float(np.sqrt(len(array)))
    reach = float(stats.t.ppf(0.5 + confidence / 2, len(array) - 1)) * spread
    return Interval(mean, mean - reach, mean + reach, len(array))


def paired(first: Mapping[int, float], second: Mapping[int, float], confidence: float = 0.95) -> Interval | None:
    """Second less first, seed by seed, over the seeds that both have; None where they share none."""
    seeds = sorted(set(first) & set(second))
    return mean_interval([second[seed] - first[seed] for seed in seeds], confidence) if seeds else None
