"""Second boxes of a person: their probability by features of the body and by whether there is a first box, and examples of each kind."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from tracker.detector_models import processes
from tracker.detector_models.model import MOST_SAMPLES, SecondBoxes
from tracker.detector_models.samples import Samples
from tracker.geometry import Array, Ints, Mask

MOST_SECONDS = 3
PRIOR = 1.0
"""Ridge of the logistic regression, as so many squared coefficients."""
KINDS = (0.35, 0.75)
"""Visible shares that part the kinds of examples: mostly hidden, partly hidden, and clear bodies."""


def fit_second(samples: Samples, features: Array, weight: Array) -> SecondBoxes:
    """The part of a model; features (n, 5) and weight (n,) of the rows of people."""
    people, rows = samples.people, samples.false.seconds
    rates = [float(np.average(people.seconds >= k, weights=weight)) for k in range(1, MOST_SECONDS + 1)]
    rates = [round(rate, 5) for rate in rates if rate > 0]
    some = people.seconds > 0
    if not rates:
        return SecondBoxes((), 0.0, ())
    x = np.column_stack([features, ~people.detected])
    alone = np.full(len(people), rates[0])
    time_s = processes.hidden_chain(alone, some, samples.pairs, weight, flickers=(0.0,))[0]
    # Frames of a run of second boxes are one observation, not many: the weight of each is less by the correlation time.
    beta = processes.logistic(x, some.astype(float), weight * min(1.0, samples.period / max(2 * time_s, 1e-9)), PRIOR)
    time_s = processes.hidden_chain(expit(x @ beta), some, samples.pairs, weight, flickers=(0.0,))[0]
    step = max(1, -(-len(rows) // MOST_SAMPLES))
    kept = np.round(rows[::step, 1:], 4)
    return SecondBoxes(tuple(rates), time_s, tuple(tuple(row) for row in kept.tolist()), tuple(np.round(beta, 4).tolist()))


def second_rates(second: SecondBoxes, features: Array, found: Mask) -> Array:
    """Probability (n, k) of at least 1 to k second boxes of bodies with features (n, 5), of which `found` (n,) have a first box."""
    rates = np.array(second.rates)
    if not second.coefficients:
        return np.tile(rates, (len(features), 1))
    first = expit(np.column_stack([features, ~found]) @ np.array(second.coefficients))
    return np.asarray(first[:, None] * rates[None] / rates[0])


def example_kinds(visible: Array, found: Mask) -> Ints:
    """The kind (n,) of examples that bodies have: by visible share, those with a first box before those without."""
    return np.asarray(np.searchsorted(KINDS, visible, side="right") + (len(KINDS) + 1) * ~np.asarray(found, dtype=bool))


def examples_by_kind(second: SecondBoxes) -> list[Ints]:
    """Rows of the examples of each kind; of a kind without examples, those of the nearest visible share, or else all."""
    samples = np.array(second.samples)
    if not len(samples) or samples.shape[1] == 5:
        return [np.arange(len(samples))] * 2 * (len(KINDS) + 1)
    kind = example_kinds(samples[:, 5], samples[:, 6] < 0.5)
    out = []
    for each in range(2 * (len(KINDS) + 1)):
        near = sorted(set(kind.tolist()), key=lambda other: (abs(other % 3 - each % 3), other // 3 != each // 3, other))
        out.append(np.flatnonzero(kind == near[0]))
    return out
