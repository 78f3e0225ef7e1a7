"""Truth and estimates compared frame by frame, their matching, and the counts of CLEAR MOT."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Ints, Mask, frozen
from tracker.geometry.ground import inside_area


@dataclass(frozen=True, eq=False)
class MatchingFrame:
    """One frame: the true and the estimated people.

    truth_id (m,), truth (m, d), estimate_id (k,), estimate (k, d): positions in metres (d ≥ 2; x and y are compared) or boxes
    (d = 4: left, top, width, height px). counts (m,): False for truth that is ignored with the estimates on it, None if all is evaluated.
    estimate_counts (k,): False for estimates that are no false positives where they match no evaluated truth, None if all may be.
    Raises ValueError for a wrong shape or a number that is not finite.
    """

    truth_id: Ints
    truth: Array
    estimate_id: Ints
    estimate: Array
    counts: Mask | None = None
    estimate_counts: Mask | None = None

    def __post_init__(self) -> None:
        for name in ("truth", "estimate"):
            ids = np.array(getattr(self, f"{name}_id"), dtype=np.int64)
            if ids.ndim != 1:
                raise ValueError(f"{name}_id has shape {ids.shape}, needs (n,)")
            rows = np.asarray(getattr(self, name), dtype=np.float64)
            array = frozen(rows.reshape(0, 2) if rows.size == 0 and len(ids) == 0 else rows, (len(ids), None), name)
            if array.shape[1] < 2 or not np.isfinite(array).all():
                raise ValueError(f"{name} of shape {array.shape} needs at least 2 columns and finite numbers")
            ids.flags.writeable = False
            object.__setattr__(self, f"{name}_id", ids)
            object.__setattr__(self, name, array)
        for name, ids in (("counts", self.truth_id), ("estimate_counts", self.estimate_id)):
            if (given := getattr(self, name)) is not None:
                mask = np.array(given, dtype=bool)
                if mask.shape != ids.shape:
                    raise ValueError(f"{name} has shape {mask.shape}, needs {ids.shape}")
                mask.flags.writeable = False
                object.__setattr__(self, name, mask)

    def within(self, area: Array) -> MatchingFrame:
        """The frame with what is outside of `area` (2, 2) m, lowest and highest x, y, ignored: truth, and estimates that match no evaluated truth."""
        truth, estimate = (inside_area(places, area) for places in (self.truth, self.estimate))
        return replace(
            self,
            counts=truth if self.counts is None else self.counts & truth,
            estimate_counts=estimate if self.estimate_counts is None else self.estimate_counts & estimate,
        )


@dataclass(frozen=True, eq=False)
class Pairing:
    """One frame with ids numbered from 0 over the whole sequence: truth (m,), estimate (k,), and value (m, k) of each pair."""

    truth: Ints
    estimate: Ints
    value: Array

    def restricted(self, truth: Mask, estimate: Mask) -> Pairing:
        """The pairing of a subset: masks truth (m,) and estimate (k,)."""
        return Pairing(self.truth[truth], self.estimate[estimate], self.value[np.ix_(truth, estimate)])


@dataclass(frozen=True, eq=False)
class Comparison:
    """The pairings of a sequence; truths and estimates are the numbers of ids on either side."""

    frames: tuple[Pairing, ...]
    truths: int
    estimates: int

    def mapped(self, function: Callable[[Array], Array]) -> Comparison:
        """The same with `function` applied to every value, for instance from distances to similarities."""
        return Comparison(tuple(Pairing(f.truth, f.estimate, function(f.value)) for f in self.frames), self.truths, self.estimates)

    def lengths(self) -> tuple[Ints, Ints]:
        """The number of frames in which each truth id (truths,) and each estimate id (estimates,) is present."""
        truth, estimate = np.zeros(self.truths, dtype=np.int64), np.zeros(self.estimates, dtype=np.int64)
        for frame in self.frames:
            truth[frame.truth] += 1
            estimate[frame.estimate] += 1
        return truth, estimate


def compare(frames: Sequence[MatchingFrame], measure: Callable[[Array, Array], Array]) -> Comparison:
    """Number the ids and measure every truth (m, d) against every estimate (k, d): `measure` returns (m, k).

    Raises ValueError with frame (from 0) and id for an id twice in a frame.
    """
    for index, frame in enumerate(frames):
        for name, ids in (("truth", frame.truth_id), ("estimate", frame.estimate_id)):
            found, number = np.unique(ids, return_counts=True)
            if (number > 1).any():
                raise ValueError(f"frame {index} holds {name} id {found[np.argmax(number > 1)]} twice, needs it once")
    none = np.zeros(0, dtype=np.int64)
    truths = np.unique(np.concatenate([none, *(f.truth_id for f in frames)]))
    estimates = np.unique(np.concatenate([none, *(f.estimate_id for f in frames)]))
    pairings = tuple(
        Pairing(np.searchsorted(truths, f.truth_id), np.searchsorted(estimates, f.estimate_id), measure(f.truth, f.estimate)) for f in frames
    )
    return Comparison(pairings, len(truths), len(estimates))


def planar_distance(truth: Array, estimate: Array) -> Array:
    """Positions (m, d), (k, d) m → distances in x, y (m, k) m."""
    return np.asarray(np.linalg.norm(truth[:, None, :2] - estimate[None, :, :2], axis=2))


def overlap(truth: Array, estimate: Array) -> Array:
    """Boxes (m, 4), (k, 4) left, top, width, height → intersection over union (m, k); 0 where the union has no area.

    Raises ValueError for other than four columns or a negative size.
    """
    for name, boxes in (("truth", truth), ("estimate", estimate)):
        if len(boxes) and (boxes.shape[1] != 4 or (boxes[:, 2:] < 0).any()):
            raise ValueError(f"{name} boxes of shape {boxes.shape} need (n, 4) and sizes of at least 0")
    if not len(truth) or not len(estimate):
        return np.zeros((len(truth), len(estimate)))
    low = np.maximum(truth[:, None, :2], estimate[None, :, :2])
    high = np.minimum((truth[:, :2] + truth[:, 2:])[:, None], (estimate[:, :2] + estimate[:, 2:])[None])
    both = np.prod(np.clip(high - low, 0.0, None), axis=2)
    union = np.prod(truth[:, 2:], axis=1)[:, None] + np.prod(estimate[:, 2:], axis=1)[None] - both
    return np.asarray(np.where(union > 0, both / np.where(union > 0, union, 1.0), 0.0))


# Rows and columns of each frame's matched pairs.
Matches = list[tuple[Ints, Ints]]

# A kept match outweighs every sum of similarities.
MATCH_BONUS = 1000

EPSILON = float(np.finfo(np.float64).eps)

MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2


def match_frames(comparison: Comparison, threshold: float) -> Matches:
    """Match each frame by TrackEval's rule; the values of `comparison` are similarities, a pair is valid from `threshold` on.

    A match of the frame before is kept while it is valid; the other matches maximise the sum of similarities. A frame without truth or without
    estimates leaves the memory unchanged.
    """
    previous = np.full(comparison.truths, -1)
    out: Matches = []
    for frame in comparison.frames:
        kept = frame.estimate[None, :] == previous[frame.truth][:, None]
        gain = np.where(frame.value < threshold - EPSILON, 0.0, MATCH_BONUS * kept + frame.value)
        rows, columns = linear_sum_assignment(-gain)
        valid_pairs = gain[rows, columns] > EPSILON
        rows, columns = rows[valid_pairs], columns[valid_pairs]
        out.append((rows, columns))
        if gain.size:
            previous[:] = -1
            previous[frame.truth[rows]] = frame.estimate[columns]
    return out


def without_ignored(frames: Sequence[MatchingFrame], comparison: Comparison, matches: Matches) -> Comparison:
    """Remove the people that are not evaluated, with the estimates that `matches` assigns to them or that are not evaluated and match nobody."""
    kept = []
    for frame, pairing, (rows, columns) in zip(frames, comparison.frames, matches, strict=True):
        counts = np.ones(len(pairing.truth), dtype=bool) if frame.counts is None else frame.counts
        kept_estimates = np.ones(len(pairing.estimate), dtype=bool) if frame.estimate_counts is None else frame.estimate_counts.copy()
        kept_estimates[columns] = counts[rows]
        kept.append(pairing.restricted(counts, kept_estimates))
    return Comparison(tuple(kept), comparison.truths, comparison.estimates)


def clear_counts(comparison: Comparison, matches: Matches) -> dict[str, int]:
    """The counts of CLEAR MOT, by the names of TargetScore's fields."""
    last = np.full(comparison.truths, -1)
    tracked = np.zeros(comparison.truths, dtype=bool)
    starts, matched_frames = np.zeros((2, comparison.truths), dtype=np.int64)
    switches = 0
    for frame, (rows, columns) in zip(comparison.frames, matches, strict=True):
        truth, estimate = frame.truth[rows], frame.estimate[columns]
        switches += int(((last[truth] >= 0) & (last[truth] != estimate)).sum())
        last[truth] = estimate
        matched_frames[truth] += 1
        if frame.value.size:
            now = np.zeros_like(tracked)
            now[truth] = True
            starts += now & ~tracked
            tracked = now
    length, estimated = comparison.lengths()
    present = length > 0
    share = matched_frames[present] / length[present]
    total = int(matched_frames.sum())
    return {
        "matches": total,
        "false_positives": int(estimated.sum()) - total,
        "misses": int(length.sum()) - total,
        "switches": switches,
        "fragments": int(np.maximum(starts - 1, 0).sum()),
        "trajectories": int(present.sum()),
        "mostly_tracked": int((share > MOSTLY_TRACKED).sum()),
        "mostly_lost": int((share < MOSTLY_LOST).sum()),
    }


def matched_sum(comparison: Comparison, matches: Matches) -> float:
    """Σ of the values of the matched pairs."""
    return float(sum(frame.value[pair].sum() for frame, pair in zip(comparison.frames, matches, strict=True)))


def match_without_memory(comparison: Comparison, threshold: float) -> tuple[int, float]:
    """Matching of each frame alone, as in WILDTRACK: the most pairs with a value in [threshold, 1], at the greatest sum.

    Returns the number of pairs and the sum of their values, over all frames.
    """
    number, total = 0, 0.0
    for frame in comparison.frames:
        rows, columns = best_pairs(frame.value, threshold)
        number += len(rows)
        total += float(frame.value[rows, columns].sum())
    return number, total


def best_pairs(value: Array, least: float) -> tuple[Ints, Ints]:
    """Rows and columns of the most pairs of a matrix with a value in [least, 1], at the greatest sum of values."""
    valid = value >= least
    rows, columns = linear_sum_assignment(-np.where(valid, min(valid.shape) + 1 + value, 0.0))
    good = valid[rows, columns]
    return rows[good], columns[good]
