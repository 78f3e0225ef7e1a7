"""Scores of targets: CLEAR MOT (Bernardin & Stiefelhagen 2008), IDF1, HOTA, MODA and MODP, from one comparison.

Where the tools of the field differ, TrackEval's rules hold:

* A match of the frame before is kept while it is valid; the others maximise the sum of similarities. py-motmetrics also
  keeps a match from before a gap.
* A switch counts against the last known match, also after a gap: A, A, –, B, B is one switch.
* A fragment is each new match of a person but the first, also where the truth was absent. py-motmetrics counts
  only gaps in which the person was present and missed.
* A frame without truth or without estimates neither ends a match nor makes a fragment.
* Mostly tracked is more than 0.8 of a person's frames (py-motmetrics: at least 0.8), mostly lost is less than 0.2.

People that are not evaluated are ignored. All people are matched first. Then the ignored people are removed with the
estimates that were matched to them, and the rest is scored. So an estimate that follows an evaluated person stays with that
person, and an estimate whose best match is an ignored person is no error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array
from tracker.metrics.hota import HotaSums, hota_sums
from tracker.metrics.matching import (
    Comparison,
    Matches,
    MatchingFrame,
    clear_counts,
    compare,
    match_frames,
    match_without_memory,
    matched_sum,
    overlap,
    planar_distance,
    without_ignored,
)

Function = Callable[[Array], Array]

# The gate of a match on the ground, m; that of MODA and MODP (WILDTRACK); the distance at which HOTA's similarity is 0, m.
GATE = 1.0
MODA_GATE = 0.5
HOTA_REACH = 2.0


@dataclass(frozen=True)
class TargetScore:
    """Counts and sums over frames; `+` merges sequences and TargetScore() is neutral. Ratios are derived last, NaN where undefined.

    truths: evaluated detections of the truth over all frames; trajectories: their ids. distance: Σ m over matches (NaN for boxes).
    closeness: Σ over matches of 1 − d/gate, or of the overlap. near_*: the same at MODA's gate. Scores of different kinds or gates must not
    be merged.
    """

    matches: int = 0
    false_positives: int = 0
    misses: int = 0
    switches: int = 0
    fragments: int = 0
    trajectories: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    distance: float = 0.0
    closeness: float = 0.0
    idtp: int = 0
    idfp: int = 0
    idfn: int = 0
    near_matches: int = 0
    near_closeness: float = 0.0
    hota_sums: HotaSums = HotaSums()

    def __add__(self, other: TargetScore) -> TargetScore:
        return TargetScore(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    @property
    def truths(self) -> int:
        return self.matches + self.misses

    @property
    def mota(self) -> float:
        """1 − (misses + false positives + switches) / truths."""
        return 1 - _ratio(self.misses + self.false_positives + self.switches, self.truths)

    @property
    def motp_m(self) -> float:
        """Mean distance of a match, m."""
        return _ratio(self.distance, self.matches)

    @property
    def motp_percent(self) -> float:
        """100 · mean (1 − d/gate), as in tables of 3-D scores, or 100 · mean overlap."""
        return 100 * _ratio(self.closeness, self.matches)

    @property
    def idf1(self) -> float:
        """2 IDTP / (2 IDTP + IDFP + IDFN)."""
        return _ratio(2 * self.idtp, 2 * self.idtp + self.idfp + self.idfn)

    @property
    def hota(self) -> float:
        return self.hota_sums.hota

    @property
    def moda(self) -> float:
        """1 − (misses + false positives) / truths, at MODA's gate."""
        estimates = self.matches + self.false_positives
        return 1 - _ratio(self.truths + estimates - 2 * self.near_matches, self.truths)

    @property
    def modp(self) -> float:
        """Mean over matches of 1 − d/gate, or of the overlap, at MODA's gate."""
        return _ratio(self.near_closeness, self.near_matches)

    def to_dict(self) -> dict[str, int | float | None]:
        """JSON values, None for undefined ones."""
        names = ("mota", "motp_m", "motp_percent", "false_positives", "misses", "switches", "fragments", "mostly_tracked", "mostly_lost")
        values = {name: getattr(self, name) for name in (*names, "truths", "idf1", "hota", "moda", "modp")}
        return {name: None if np.isnan(value) else value for name, value in values.items()}


def _ratio(above: float, below: float) -> float:
    return above / below if below else float("nan")


@dataclass(frozen=True)
class _Rules:
    """The measure of a pair, and how each score uses its value. similarity: in [0, 1]; it decides the matching, and HOTA uses it."""

    measure: Callable[[Array, Array], Array]
    similarity: Function
    threshold: float
    distance: Function
    closeness: Function
    near: Function
    near_threshold: float


_GROUND = _Rules(
    measure=planar_distance,
    similarity=lambda d: np.maximum(0.0, 1 - d / HOTA_REACH),
    threshold=1 - GATE / HOTA_REACH,
    distance=np.asarray,
    closeness=lambda d: 1 - d / GATE,
    near=lambda d: 1 - d / MODA_GATE,
    near_threshold=0.0,
)


def score(frames: Iterable[MatchingFrame]) -> TargetScore:
    """Score positions on the ground: distances in x, y, metres; a match lies within GATE.

    MODA and MODP have a gate of 0.5 m, and HOTA's similarity is max(0, 1 − d / 2 m). Raises ValueError for an id twice in a frame,
    with the frame (from 0) and the id.
    """
    return _score(list(frames), _GROUND)


def match_on_ground(frames: list[MatchingFrame]) -> tuple[Comparison, Matches]:
    """Distances, m, without people and estimates that do not count, and the matches of `score`."""
    values, _, matches = _matched(frames, _GROUND)
    return values, matches


def score_boxes(frames: Iterable[MatchingFrame], *, iou: float = 0.5) -> TargetScore:
    """Score boxes (left, top, width, height px): a match overlaps by at least `iou` (intersection over union).

    MODA and MODP use the same threshold, HOTA the overlap itself; motp_m is undefined. Raises ValueError as `score` does.
    """
    if not 0 < iou <= 1:
        raise ValueError(f"iou is {iou}, needs to be in (0, 1]")
    rules = _Rules(
        measure=overlap,
        similarity=np.asarray,
        threshold=iou,
        distance=lambda overlaps: np.full_like(overlaps, np.nan),
        closeness=np.asarray,
        near=np.asarray,
        near_threshold=iou,
    )
    return _score(list(frames), rules)


def _matched(frames: list[MatchingFrame], rules: _Rules) -> tuple[Comparison, Comparison, Matches]:
    """Values of the pairs that count, their similarities, and the matches."""
    values = compare(frames, rules.measure)
    if any(frame.counts is not None for frame in frames):
        values = without_ignored(frames, values, match_frames(values.mapped(rules.similarity), rules.threshold))
    similarity = values.mapped(rules.similarity)
    return values, similarity, match_frames(similarity, rules.threshold)


def _score(frames: list[MatchingFrame], rules: _Rules) -> TargetScore:
    values, similarity, matches = _matched(frames, rules)
    idtp, idfp, idfn = identity_counts(similarity, rules.threshold)
    near_matches, near_closeness = match_without_memory(values.mapped(rules.near), rules.near_threshold)
    return TargetScore(
        **clear_counts(values, matches),
        distance=matched_sum(values.mapped(rules.distance), matches),
        closeness=matched_sum(values.mapped(rules.closeness), matches),
        idtp=idtp,
        idfp=idfp,
        idfn=idfn,
        near_matches=near_matches,
        near_closeness=near_closeness,
        hota_sums=hota_sums(similarity),
    )


def identity_counts(comparison: Comparison, threshold: float) -> tuple[int, int, int]:
    """IDTP, IDFP, IDFN: true positives, false positives and misses under the best one-to-one assignment of whole trajectories.

    Ristani et al. 2016, "Performance measures and a data set for multi-target, multi-camera tracking", section 3.

    The values of `comparison` are similarities; a pair agrees in a frame where its similarity is at least `threshold`. The assignment maximises
    the frames of agreement, which is the same as Ristani's least IDFP + IDFN. An unassigned pair adds its two lengths, and an assigned one
    its two lengths less twice the agreement.
    """
    agreement = np.zeros((comparison.truths, comparison.estimates))
    for frame in comparison.frames:
        rows, columns = np.nonzero(frame.value >= threshold)
        agreement[frame.truth[rows], frame.estimate[columns]] += 1
    rows, columns = linear_sum_assignment(-agreement)
    right = int(agreement[rows, columns].sum())
    truth, estimate = comparison.lengths()
    return right, int(estimate.sum()) - right, int(truth.sum()) - right
