"""Second boxes of a person: their probability by features of the body and by whether there is a first box, and examples of each kind."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from tracker.detector_models import processes
from tracker.detector_models.model import SecondBoxes
from tracker.detector_models.samples import Samples
from tracker.detector_models.schema import MOST_SAMPLES
from tracker.geometry import Array, Ints, Mask

MOST_SECONDS = 3
PRIOR = 1.0
"""Strength of the ridge penalty of the logistic regression."""
KINDS = (0.35, 0.75)
"""Visible shares that separate the kinds of examples: mostly hidden, partly hidden, and clear bodies."""


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
    # Frames of a run of second boxes are correlated: the weight of each is less by twice the correlation time.
    beta = processes.logistic(x, some.astype(float), weight * min(1.0, samples.period / max(2 * time_s, 1e-9)), PRIOR)
    time_s = processes.hidden_chain(expit(x @ beta), some, samples.pairs, weight, flickers=(0.0,))[0]
    kept = tuple(tuple(row) for row in np.round(examples(rows), 4).tolist())
    return SecondBoxes(tuple(rates), time_s, kept, tuple(np.round(beta, 4).tolist()), round(samples.period, 6))


def examples(rows: Array) -> Array:
    """Examples (n, 8) as in SecondBoxes, at most MOST_SAMPLES, from rows (m, 10) as in FalseSamples.seconds: whole runs, chosen at random."""
    found = runs(rows)
    taken, total = list[list[int]](), 0
    for k in np.random.default_rng(0).permutation(len(found)).tolist():
        taken.append(found[k][: MOST_SAMPLES - total])
        total += len(taken[-1])
        if total == MOST_SAMPLES:
            break
    order = sorted(taken)
    follows = np.array([float(k + 1 < len(run)) for run in order for k in range(len(run))])
    return np.column_stack([rows[[row for run in order for row in run], 1:8], follows])


def runs(rows: Array) -> list[list[int]]:
    """Numbers of the rows (m, 10) that are one second box of a person in frames one after the other.

    Boxes of a person and view in two such frames are linked greedily by the smallest difference of edges. A run ends when the first box appears or
    disappears, because errors then have another reference.
    """
    order = np.lexsort((rows[:, 9], rows[:, 0], rows[:, 8])).tolist()
    groups = dict[tuple[float, ...], list[int]]()
    for row in order:
        groups.setdefault((rows[row, 8], rows[row, 0], rows[row, 7], rows[row, 9]), []).append(row)
    out, of = list[list[int]](), dict[int, list[int]]()
    for (view, person, base, frame), mine in groups.items():
        before, free = list(groups.get((view, person, base, frame - 1), [])), list(mine)
        while before and free:
            apart = np.abs(rows[before][:, None, 1:5] - rows[free][None, :, 1:5]).sum(axis=2)
            a, b = np.unravel_index(int(np.argmin(apart)), apart.shape)
            of[free[b]] = of[before[a]]
            of[free[b]].append(free[b])
            del before[a], free[b]
        for row in free:
            of[row] = [row]
            out.append(of[row])
    return out


def next_example(second: SecondBoxes, at: int, forward: bool) -> tuple[int, bool]:
    """The example that follows row `at` of the same box, and the direction of traversal; −1 for a box of one frame alone."""
    ahead, behind = second.samples[at][7] > 0.5, at > 0 and second.samples[at - 1][7] > 0.5
    if not ahead and not behind:
        return -1, True
    forward = ahead if forward else not behind
    return at + (1 if forward else -1), forward


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
    """Rows of the examples of each kind; of a kind without examples, those of the kind with the nearest visible share."""
    samples = np.array(second.samples)
    if not len(samples):
        return [np.arange(0)] * 2 * (len(KINDS) + 1)
    kind = example_kinds(samples[:, 5], samples[:, 6] < 0.5)
    out = []
    for each in range(2 * (len(KINDS) + 1)):
        near = sorted(set(kind.tolist()), key=lambda other: (abs(other % 3 - each % 3), other // 3 != each // 3, other))
        out.append(np.flatnonzero(kind == near[0]))
    return out
