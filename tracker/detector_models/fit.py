"""Fit of a detector's error model to the samples of a recording, with 95 % intervals by a bootstrap over people and blocks of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import expit, gammaincinv, ndtri, stdtrit

from tracker.detector_models import processes
from tracker.detector_models.bodies import FEATURES, LEAST_VISIBLE, OVERLAPS
from tracker.detector_models.model import (
    CLEAR,
    EDGES,
    KNOTS,
    Confidences,
    DetectorModel,
    EdgeErrors,
    FalseBoxes,
    Merges,
    Misses,
    StandingBoxes,
)  # fmt: skip
from tracker.detector_models.samples import FalseSamples, PeopleSamples, Samples
from tracker.detector_models.schema import MOST_SAMPLES, Row, Table
from tracker.detector_models.second_boxes import fit_second
from tracker.detector_models.trends import fit_trend, folds_of, trend_features
from tracker.geometry import Array, Ints, Mask

LEAST_BODIES, LEAST_PEOPLE, LEAST_FOUND = 200, 2, 100
"""Fewest true bodies, true people, and boxes of them, of a fit."""
LEAST_GROUP = 50
"""Fewest boxes of clear bodies, and of others, for separate distributions of errors."""
REPLICATES = 100
BLOCK = 5.0
"""s: blocks of time of the bootstrap of false boxes."""
INFORMATIVE = 0.05
"""Least shift of an edge inward, in body heights, to estimate how far a detector extends boxes over hidden parts."""
PRIOR = 1.0
"""Strength of the ridge penalty of the logistic regression."""


def fit(samples: Samples, name: str, bodies: str, made: Mapping[str, Any], replicates: int = REPLICATES, view_alone: bool = False) -> DetectorModel:
    """The model of a detector. bodies, made: as in DetectorModel. replicates: of the bootstrap.

    view_alone: the model is of one view, so that errors of edges may depend on the place in the image. Raises ValueError where there is too little
    truth.
    """
    people, false = samples.people, samples.false
    found, persons = int(people.detected.sum()), np.unique(people.person)
    if len(people) < LEAST_BODIES or len(persons) < LEAST_PEOPLE or found < LEAST_FOUND:
        raise ValueError(
            f"too little truth: {len(people)} true bodies of {len(persons)} people, {found} of these bodies with a box,"
            f" needs at least {LEAST_BODIES} bodies, {LEAST_PEOPLE} people and {LEAST_FOUND} boxes"
        )
    plain, rng = (np.ones(len(people)), np.ones(len(false.view))), np.random.default_rng(0)
    parts = _parts(samples, *plain, view_alone)
    drawn = list[dict[str, float]]()
    of_person = np.searchsorted(persons, people.person)
    blocks = _blocks(false, samples.period)
    for _ in range(replicates):
        weight = np.bincount(rng.integers(0, len(persons), len(persons)), minlength=len(persons)).astype(float)
        frame_weight = np.bincount(rng.integers(0, blocks[1], blocks[1]), minlength=blocks[1]).astype(float)
        weights = weight[of_person], frame_weight[blocks[0]]
        if not (np.isfinite(people.confidence) & (weights[0] > 0)).any():
            continue  # Only people without boxes of their own are drawn.
        drawn.append(figures(_parts(samples, *weights), samples, *weights))
    best = figures(parts, samples, *plain)
    found_figures = {}
    for key, value in best.items():
        if np.isfinite(value) and len(values := _finite(one[key] for one in drawn)):
            low, high = np.percentile(values, [2.5, 97.5]).tolist()
            wider = _few(len(persons))
            found_figures[key] = (value, value - wider * max(value - low, 0.0), value + wider * max(high - value, 0.0))
    found_figures |= _exact(parts, samples)
    counts = {
        "bodies": len(people), "people": len(persons), "found": found, "views": len(samples.cameras), "frames": int(false.frames.sum()),
        "second": len(false.seconds), "new": int((false.site < 0).sum()), "standing": int((false.site >= 0).sum()),
        "sites": len(np.unique(false.site[false.site >= 0])), "unjudged": false.unjudged, "merged": int(people.merged.sum()),
    }  # fmt: skip
    rounded = {key: _rounded(key, *triple) for key, triple in found_figures.items()}
    return DetectorModel(name, bodies, made=dict(made), figures=rounded, counts=counts, **parts)


def _exact(parts: Mapping[str, Any], samples: Samples) -> dict[str, tuple[float, float, float]]:
    """Figures whose intervals a bootstrap cannot give: the number of places, and shares that are 0 or 1 in the samples."""
    people, false = samples.people, samples.false
    # Garwood's interval of the count, scaled to the mean number of places per view.
    sites, known = len(np.unique(false.site[false.site >= 0])), parts["standing"].sites
    scale = known / sites if sites else 1.0 / max(1, len(false.frames))
    low, high = gammaincinv(sites, 0.025) if sites else 0.0, gammaincinv(sites + 1, 0.975)
    out = {"standing.sites": (known, float(low * scale), float(high * scale))}
    for group, masks in miss_groups(people).items():
        for label, mask in masks.items():
            missed, number = int((~people.detected & mask & ~people.merged).sum()), int((mask & ~people.merged).sum())
            if number and missed in (0, number):
                # The rule of three.
                bound = min(1.0, 3 / number)
                out[f"misses.{group}.{label}"] = (0.0, 0.0, bound) if missed == 0 else (1.0, 1 - bound, 1.0)
    return out


def _rounded(key: str, value: float, low: float, high: float) -> tuple[float, float, float]:
    """A figure and its interval, clipped to the range of such a figure."""
    signed = key.endswith(".mean") or ".coefficients." in key
    share = key.startswith(("misses.", "merges.", "edges.hidden", "edges.border")) or key.endswith((".lasting", ".median"))
    least, most = -np.inf if signed else 0.0, 1.0 if share and not signed and not key.endswith("_s") else np.inf
    return round(value, 5), round(float(np.clip(low, least, most)), 5), round(float(np.clip(high, least, most)), 5)


def _few(people: int) -> float:
    """Factor on the bootstrap's interval for few people: Student's t over the normal quantile, times √(n / (n − 1))."""
    return float(stdtrit(people - 1, 0.975) / ndtri(0.975) * np.sqrt(people / (people - 1)))


def _finite(values: Iterable[float]) -> list[float]:
    return [value for value in values if np.isfinite(value)]


def _blocks(false: FalseSamples, period: float) -> tuple[Ints, int]:
    """The block of time of each false box, and the number of blocks of all views."""
    length = max(1, round(BLOCK / period))
    each = int(max(false.frames, default=1)) // length + 1
    return false.view * each + np.minimum(false.frame // length, each - 1), each * max(1, len(false.frames))


def _parts(samples: Samples, weight: Array, box_weight: Array, view_alone: bool = False) -> dict[str, Any]:
    """The parts of a model, with a weight (n,) for each true body and (m,) for each false box."""
    sizes = _sizes(samples.people)
    features = samples.people.features(sizes)
    return {
        "misses": _misses(samples, features, sizes, weight),
        "edges": _edges(samples, weight, view_alone),
        "confidences": _confidences(samples, features, weight),
        "merges": _merges(samples, weight),
        "second": fit_second(samples, features, weight),
        "false": _new(samples.false, box_weight),
        "standing": _standing(samples),
    }


def _sizes(people: PeopleSamples) -> tuple[float, float]:
    low, high = np.percentile(people.size, [2, 98])
    return round(float(low), 4), round(float(max(high, low + 1e-3)), 4)


def _misses(samples: Samples, features: Array, sizes: tuple[float, float], weight: Array) -> Misses:
    people = samples.people
    used = ~people.merged & (people.visible > LEAST_VISIBLE)
    missed = ~people.detected
    coefficients = processes.logistic(features[used], missed[used].astype(float), weight[used], PRIOR)
    p = expit(features @ coefficients)
    pairs = [pair for pair in samples.pairs if pair[0] <= 4.0]
    time_s, flicker = processes.hidden_chain(p, missed, pairs, weight * used)
    return Misses(tuple(np.round(coefficients, 4).tolist()), sizes, time_s, flicker)


def edge_errors(people: PeopleSamples, hidden: float, border: float) -> Array:
    """Errors (n, 4) of edges from what the model expects, in body heights; NaN for people without a box and for edges beyond the border."""
    inward = np.array([1.0, 1.0, -1.0, -1.0])
    expected = inward * ((1 - hidden) * people.hidden_in + (1 - border) * people.border_in)
    return np.where(people.border_in > 1e-6, np.nan, people.whole_error - expected)


def terms_of(error: Array) -> Array:
    """Errors (n, 4) of the edges → those of TERMS."""
    left, top, right, bottom = error.T
    return np.column_stack([(left + right) / 2, top, right - left, bottom])


def _share_filled(moved: Array, inward: Array, weight: Array) -> float:
    """Share of the inward distance over which boxes extend: the weighted median of 1 − moved / inward, within [0, 1]."""
    used = (inward > INFORMATIVE) & np.isfinite(moved) & (weight > 0)
    if used.sum() < 20:
        return 1.0 if inward.size == 0 else 0.5
    value = 1 - moved[used] / inward[used]
    return float(np.clip(_weighted_quantiles(value, weight[used], np.array([0.5]))[0], 0.0, 1.0))


def _weighted_quantiles(value: Array, weight: Array, at: Array) -> Array:
    if not len(value):
        return np.zeros(len(at))  # Errors of an edge that no box shows are taken to be 0.
    order = np.argsort(value)
    rank = np.cumsum(weight[order]) - weight[order] / 2
    return np.asarray(np.interp(at * weight.sum(), rank, value[order]))


def _edges(samples: Samples, weight: Array, view_alone: bool) -> EdgeErrors:
    people = samples.people
    tiled = np.repeat(weight[:, None], 4, axis=1)
    border = _share_filled(people.moved, people.border_in, tiled * (people.border_in > INFORMATIVE))
    inside = (people.border_in <= 1e-6) & (people.hidden_in > INFORMATIVE)
    hidden = _share_filled(people.moved, people.hidden_in, tiled * inside)
    # Hidden edges show how far a detector extends boxes, and not its errors.
    error = terms_of(np.where(people.hidden_in > INFORMATIVE, np.nan, edge_errors(people, hidden, border)))
    place = people.place, people.size, people.visible
    trend, bounds = fit_trend(place, error, folds_of(people.person, people.frame)) if view_alone else ((), ())
    if trend:
        error = error - trend_features(*place, np.array(bounds)) @ np.array(trend).T
    clear = people.visible >= CLEAR
    tables, lasting, times, scores = [list[Row](), list[Row]()], [], [], []
    for k in range(4):
        score = np.full(len(error), np.nan)
        for table, group in zip(tables, (clear, ~clear), strict=True):
            used = np.isfinite(error[:, k]) & (weight > 0) & group
            mine = used if used.sum() >= LEAST_GROUP else np.isfinite(error[:, k]) & (weight > 0)
            table.append(_knots(error[mine, k], weight[mine], 5))
            score[used] = normal_scores(np.where(used, error[:, k], np.nan), weight)[used]
        share, time_s = processes.lasting_and_drifting(score, samples.pairs, weight)
        lasting.append(share)
        times.append(time_s)
        scores.append(score)
    matrix = _correlation(np.array(scores).T, weight)
    if view_alone:
        # Boxes that match hidden bodies are often a neighbour's. Their errors are taken to be those of clear ones.
        tables[1] = tables[0]
    rows = tuple(map(tuple, tables))
    return EdgeErrors(rows, tuple(lasting), tuple(times), matrix, hidden, border, trend, bounds)


def _knots(value: Array, weight: Array, digits: int) -> Row:
    """Quantiles (KNOTS,) of values. The first and the last one are the 0.5 % and 99.5 % quantiles, so that no single outlier sets them."""
    grid = np.clip(np.linspace(0.0, 1.0, KNOTS), 0.005, 0.995)
    return tuple(np.round(_weighted_quantiles(value, weight, grid), digits).tolist())


def normal_scores(value: Array, weight: Array) -> Array:
    """Standard normal scores (n,) of values by their weighted ranks; NaN where a value is NaN or has no weight."""
    out = np.full(len(value), np.nan)
    used = np.flatnonzero(np.isfinite(value) & (weight > 0))
    if not len(used):
        return out
    kinds, inverse = np.unique(value[used], return_inverse=True)
    total = np.bincount(inverse, weight[used], len(kinds))
    out[used] = ndtri(((np.cumsum(total) - total / 2) / total.sum())[inverse])
    return out


def _correlation(scores: Array, weight: Array) -> Table:
    whole = np.isfinite(scores).all(axis=1) & (weight > 0)
    if whole.sum() < 20:
        return tuple(tuple(row) for row in np.eye(4).tolist())
    matrix = np.cov(scores[whole].T, aweights=weight[whole])
    scale = np.sqrt(np.diag(matrix))
    matrix = np.round(matrix / np.maximum(np.outer(scale, scale), 1e-12), 4)  # Boxes that equal the true ones have no errors.
    np.fill_diagonal(matrix, 1.0)
    return tuple(tuple(row) for row in matrix.tolist())


def _confidences(samples: Samples, features: Array, weight: Array) -> Confidences:
    people = samples.people
    used = np.isfinite(people.confidence) & (weight > 0)
    score = normal_scores(people.confidence, weight)
    w = np.sqrt(weight[used])[:, None]
    gram = (features[used] * w).T @ (features[used] * w) + 1e-3 * np.eye(len(FEATURES))
    coefficients = np.linalg.solve(gram, (features[used] * w).T @ (score[used] * w[:, 0]))
    rest = score - features @ coefficients
    spread = float(np.sqrt(np.average(rest[used] ** 2, weights=weight[used])))
    lasting, time_s = processes.lasting_and_drifting(rest / max(spread, 1e-6), samples.pairs, weight)
    knots = _knots(people.confidence[used], weight[used], 4)
    return Confidences(knots, tuple(np.round(coefficients, 4).tolist()), round(spread, 4), lasting, time_s)


def _merges(samples: Samples, weight: Array) -> Merges:
    people = samples.people
    bin_ = np.searchsorted(OVERLAPS, people.overlap, side="right") - 1
    near = (people.near_detected | people.merged) & (weight > 0)
    shares = []
    for k in range(len(OVERLAPS)):
        mine = near & (bin_ == k)
        total = weight[mine].sum()
        shares.append(round(float((weight * people.merged)[mine].sum() / total), 4) if total else 0.0)
    mine = near & (bin_ >= 0)
    pairs = [(lag, first[mine[first] & mine[then]], then[mine[first] & mine[then]]) for lag, first, then in samples.pairs]
    p = np.array([*shares, 0.0])[bin_]
    return Merges(tuple(shares), processes.hidden_chain(p, people.merged, pairs, weight * mine, flickers=(0.0,))[0])


def _thinned(rows: Array) -> Table:
    """At most MOST_SAMPLES rows, evenly spread in their order."""
    step = max(1, -(-len(rows) // MOST_SAMPLES))
    return tuple(tuple(row) for row in np.round(rows[::step], 4).tolist())


def _new(false: FalseSamples, weight: Array) -> FalseBoxes:
    mine = false.site < 0
    rate = float(weight[mine].sum() / max(1, false.frames.sum()))
    return FalseBoxes(round(rate, 5), _thinned(np.column_stack([false.size, false.confidence])[mine]))


def _standing(samples: Samples) -> StandingBoxes:
    """Standing false boxes: a place counts with the share of the frames from its first box to its last."""
    false, rows, spans, pairs, deviation = samples.false, list[list[float]](), 0.0, [0.0, 0.0], list[Array]()
    for site in np.unique(false.site[false.site >= 0]).tolist():
        mine = false.site == site
        frames, frame_count = np.unique(false.frame[mine]), int(false.frames[int(false.view[mine][0])])
        span = int(frames[-1] - frames[0] + 1)
        share = len(frames) / span
        rows.append([*np.median(false.size[mine], axis=0), share, *np.percentile(false.confidence[mine], [10, 90])])
        spans += min(1.0, span / max(1, frame_count))
        present = np.isin(np.arange(frames[0], frames[-1] + 1), frames).astype(float) - share
        pairs[0] += float((present[1:] * present[:-1]).sum())
        pairs[1] += float((present**2).sum())
        height = np.maximum(false.edges[mine, 3] - false.edges[mine, 1], 1.0)
        deviation.append(((false.edges[mine] - np.median(false.edges[mine], axis=0)) / height[:, None]).ravel())
    rho = float(np.clip(pairs[0] / pairs[1], 0.0, 0.999)) if pairs[1] > 0 else 0.0
    jitter = float(np.clip(1.4826 * np.median(np.abs(np.concatenate(deviation))), 0.0, 10.0)) if deviation else 0.0
    samples_ = tuple(tuple(row) for row in np.round(np.array(rows).reshape(-1, 6), 4).tolist())[:MOST_SAMPLES]
    return StandingBoxes(round(spans / max(1, len(false.frames)), 4), processes.time_constant(rho, samples.period), round(jitter, 4), samples_)


def figures(parts: Mapping[str, Any], samples: Samples, weight: Array, box_weight: Array) -> dict[str, float]:
    """The figures of a model that have intervals, by name."""
    people, false = samples.people, samples.false
    used = (~people.merged) & (weight > 0)
    out = {"misses.share": float(np.average(~people.detected[used], weights=weight[used])) if used.any() else np.nan}
    out |= {"misses.time_s": parts["misses"].time_s, "misses.flicker": parts["misses"].flicker}
    for k, name in enumerate(FEATURES):
        out[f"misses.coefficients.{name}"] = parts["misses"].coefficients[k]
    for group, masks in miss_groups(people).items():
        for label, mask in masks.items():
            mine = used & mask
            out[f"misses.{group}.{label}"] = float(np.average(~people.detected[mine], weights=weight[mine])) if mine.any() else np.nan
    e = parts["edges"]
    error = edge_errors(people, e.hidden, e.border)
    for k, edge in enumerate(EDGES):
        rows = np.isfinite(error[:, k]) & (weight > 0)
        if not rows.any():
            out |= dict.fromkeys((f"edges.{edge}.{name}" for name in ("mean", "deviation", "lasting", "time_s")), np.nan)
            continue
        mean = float(np.average(error[rows, k], weights=weight[rows]))
        out[f"edges.{edge}.mean"] = mean
        out[f"edges.{edge}.deviation"] = float(np.sqrt(np.average((error[rows, k] - mean) ** 2, weights=weight[rows])))
        found = processes.lasting_and_drifting(normal_scores(error[:, k], weight), samples.pairs, weight)
        out[f"edges.{edge}.lasting"], out[f"edges.{edge}.time_s"] = found
    out |= {"edges.hidden": e.hidden, "edges.border": e.border}
    c = parts["confidences"]
    out |= {"confidences.median": c.quantiles[KNOTS // 2], "confidences.lasting": c.lasting, "confidences.time_s": c.time_s}
    out |= {f"merges.{low:g}": share for low, share in zip(OVERLAPS, parts["merges"].probability, strict=True)}
    out["second.rate"] = float(np.average(people.seconds, weights=weight)) if weight.any() else np.nan
    out["false.rate"] = parts["false"].rate
    stands = false.site >= 0
    out["standing.rate"] = float(box_weight[stands].sum() / max(1, false.frames.sum()))
    return out


def miss_groups(people: PeopleSamples) -> dict[str, dict[str, Mask]]:
    """Groups of true bodies with separate shares of misses: by visible share, height over image height, place in the image, and border."""
    size, (u, v) = 2.0**people.size, people.place.T
    ends, middle = (0.0, 0.25, 0.5, 0.75, 1.0), np.percentile(size, [0, 33, 67, 100])
    visible = {f"{a:.2f}-{b:.2f}": (people.visible >= a) & (people.visible < b) for a, b in pairwise(ends)}
    return {
        "visible": visible | {"1.00": people.visible >= 1.0},
        "height": {f"{a:.2f}-{b:.2f}": (size >= a) & (size <= b) for a, b in pairwise(middle)},
        "place": {
            f"{row} {column}": (np.clip(v * 3, 0, 2).astype(int) == r) & (np.clip(u * 3, 0, 2).astype(int) == c)
            for r, row in enumerate(("top", "middle", "bottom"))
            for c, column in enumerate(("left", "centre", "right"))
        },
        "border": {"whole": people.cut <= 1e-6, "cut": people.cut > 1e-6},
    }
