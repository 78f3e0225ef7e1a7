"""Truth beside estimates, frame by frame: the ground on which every score of targets stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, frozen

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Frame:
    """One moment: who stands where, and what was said about it.

    truth_id (m,), truth (m, d), estimate_id (k,), estimate (k, d): positions in metres (d ≥ 2; x and y are compared) or boxes
    (d = 4: left, top, width, height px). counts (m,): False for truth that is ignored both ways, None where all of it counts.
    Raises ValueError for a wrong shape or a number that is not finite.
    """

    truth_id: Ints
    truth: Array
    estimate_id: Ints
    estimate: Array
    counts: Mask | None = None

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
        if self.counts is not None:
            counts = np.array(self.counts, dtype=bool)
            if counts.shape != self.truth_id.shape:
                raise ValueError(f"counts has shape {counts.shape}, needs {self.truth_id.shape}")
            counts.flags.writeable = False
            object.__setattr__(self, "counts", counts)


@dataclass(frozen=True, eq=False)
class Pairing:
    """One frame with its ids numbered from 0 over the whole sequence: truth (m,), estimate (k,), and how they compare: value (m, k)."""

    truth: Ints
    estimate: Ints
    value: Array

    def restricted(self, truth: Mask, estimate: Mask) -> Pairing:
        return Pairing(self.truth[truth], self.estimate[estimate], self.value[np.ix_(truth, estimate)])


@dataclass(frozen=True, eq=False)
class Comparison:
    """A sequence of pairings; truths and estimates are the numbers of ids on either side."""

    frames: tuple[Pairing, ...]
    truths: int
    estimates: int

    def mapped(self, function: Callable[[Array], Array]) -> Comparison:
        """The same with `function` applied to every value: distances to similarities."""
        return Comparison(tuple(Pairing(f.truth, f.estimate, function(f.value)) for f in self.frames), self.truths, self.estimates)

    def lengths(self) -> tuple[Ints, Ints]:
        """In how many frames each truth id (truths,) and each estimate id (estimates,) is present."""
        truth, estimate = np.zeros(self.truths, dtype=np.int64), np.zeros(self.estimates, dtype=np.int64)
        for frame in self.frames:
            truth[frame.truth] += 1
            estimate[frame.estimate] += 1
        return truth, estimate


def compare(frames: Sequence[Frame], measure: Callable[[Array, Array], Array]) -> Comparison:
    """Number the ids and measure every truth (m, d) against every estimate (k, d): `measure` gives (m, k).

    Raises ValueError naming frame (from 0) and id where an id comes twice in a frame.
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
