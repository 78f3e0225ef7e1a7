"""How far simulated boxes are from real ones: two-sample distances of the statistics that trackers depend on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tracker.detector_models.fit import edge_errors
from tracker.detector_models.model import EDGES
from tracker.detector_models.samples import PeopleSamples, Samples
from tracker.geometry import Array

LAG = 1.0
"""s: lag at which autocorrelations are compared."""


def miss_runs(people: PeopleSamples, period: float) -> Array:
    """Durations (n,), s, of misses in a row of a person in a view. Rows are ordered by view, person and frame."""
    missed = ~people.detected
    same = (np.diff(people.view) == 0) & (np.diff(people.person) == 0) & (np.diff(people.frame) == 1)
    begins = missed & ~np.concatenate([[False], missed[:-1] & same])
    group = np.cumsum(begins)[missed]
    return np.asarray(np.bincount(group)[1:] * period if len(group) else np.zeros(0))


def autocorrelation(value: Array, samples: Samples) -> float:
    """Correlation of values (n,), NaN where unknown, of a person in a view at the lag nearest to LAG; NaN without pairs."""
    if not samples.pairs:
        return float("nan")
    _, first, then = min(samples.pairs, key=lambda pair: abs(pair[0] - LAG))
    known = np.isfinite(value[first]) & np.isfinite(value[then])
    if known.sum() < 10:
        return float("nan")
    centred = value - np.nanmean(value)
    return float((centred[first] * centred[then])[known].mean() / np.nanmean(centred**2))


def counts(samples: Samples) -> Array:
    """Number of boxes (n,), false ones included, of each view and frame with true people."""
    people, false = samples.people, samples.false
    found = people.detected.astype(int) + people.seconds
    most = 1 + int(max(people.frame.max(initial=0), false.frame.max(initial=0)))
    total = np.bincount(people.view * most + people.frame, found, len(samples.cameras) * most)
    total += np.bincount(false.view * most + false.frame, minlength=len(samples.cameras) * most)
    return np.asarray(total[np.unique(people.view * most + people.frame)])


def distances(real: Samples, simulated: Samples, filled: tuple[float, float]) -> dict[str, float]:
    """Distances by name: Kolmogorov and Smirnov's of two samples, in [0, 1], and differences of autocorrelations and of the share of misses.

    filled: the model's edges.hidden and edges.border, by which errors of edges are measured. NaN where a sample is empty.
    """
    a, b = real.people, simulated.people
    out = {"share missed": abs(float(a.detected.mean()) - float(b.detected.mean()))}
    out |= {"miss runs": _ks(miss_runs(a, real.period), miss_runs(b, simulated.period))}
    first, second = edge_errors(a, *filled), edge_errors(b, *filled)
    for k, edge in enumerate(EDGES):
        out[f"{edge} edge"] = _ks(first[:, k], second[:, k])
    for k, edge in enumerate(EDGES):
        out[f"{edge} edge, autocorrelation"] = abs(autocorrelation(first[:, k], real) - autocorrelation(second[:, k], simulated))
    out["confidence of people"] = _ks(a.confidence, b.confidence)
    out["confidence of false boxes"] = _ks(real.false.confidence, simulated.false.confidence)
    out["boxes of a view"] = _ks(counts(real), counts(simulated))
    return out


def _ks(first: Array, second: Array) -> float:
    # This import takes half a second, which other commands need not spend.
    from scipy.stats import ks_2samp

    first, second = first[np.isfinite(first)], second[np.isfinite(second)]
    return float(ks_2samp(first, second, method="asymp").statistic) if len(first) and len(second) else float("nan")


def table(columns: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Lines of a table of distances: a row for each statistic, a column for each detector."""
    names = list(next(iter(columns.values())))
    wide = max(map(len, names))
    lines = [f"{'distance from real boxes':{wide}}  " + "  ".join(f"{name:>11}" for name in columns)]
    for name in names:
        cells = [f"{'-' if np.isnan(column[name]) else f'{column[name]:.3f}':>11}" for column in columns.values()]
        lines.append(f"{name:{wide}}  " + "  ".join(cells))
    return lines
