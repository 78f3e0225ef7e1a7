"""MODA, MODP, precision and recall of positions on the ground, as detectors are scored on WILDTRACK and MultiviewX.

The rules are those of CLEAR_MOD_HUN.m and evaluateDetection.m in the evaluation kit of MVDet (Hou et al. 2020,
https://github.com/hou-yz/MVDet, multiview_detector/evaluation), after Kasturi et al. 2009:

* Each frame is matched alone, without ids: the most pairs within 0.5 m (td = 50 / 2.5 = 20 cells of 2.5 cm), and of those the least sum.
* MODA = 1 − (misses + false positives) / truths. MODP = mean over pairs of 1 − d / 0.5 m.
* Only frames with a detection are scored, so that the misses of a frame without any do not count. Such frames are counted as `skipped`.

The kit's translation to Python (pyeval) refuses a pair at exactly 0.5 m and turns a negative MODA into 0; MATLAB's does neither, nor does this one.

The same data are scored for tracking with a gate of 1 m, which is `clear_mot.score`'s own: EarlyBird (Teepe et al. 2024, evaluation/mot_bev.py)
takes positions in cells times 0.025 m and squared distances up to 1 m² to py-motmetrics; TrackTacular does the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

from tracker.metrics.matching import MatchingFrame, compare, match_without_memory, planar_distance

GATE = 0.5
"""m: the largest distance of a pair."""
ROUNDING = 1e-9
"""Share of the gate: positions on a grid, in metres, are at exactly the gate but for rounding."""


@dataclass(frozen=True)
class GroundDetectionScore:
    """Counts over the frames with a detection; `+` merges sequences and GroundDetectionScore() is neutral. Ratios are None where undefined.

    truths, detections: positions; matches: pairs; closeness: Σ over pairs of 1 − d / GATE; skipped: frames that have truth and no detection.
    """

    truths: int = 0
    detections: int = 0
    matches: int = 0
    closeness: float = 0.0
    skipped: int = 0

    def __add__(self, other: GroundDetectionScore) -> GroundDetectionScore:
        return GroundDetectionScore(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    @property
    def moda(self) -> float | None:
        """1 − (misses + false positives) / truths; below 0 with many false positives."""
        return _ratio(2 * self.matches - self.detections, self.truths)

    @property
    def modp(self) -> float | None:
        """Mean over pairs of 1 − d / GATE."""
        return _ratio(self.closeness, self.matches)

    @property
    def precision(self) -> float | None:
        return _ratio(self.matches, self.detections)

    @property
    def recall(self) -> float | None:
        return _ratio(self.matches, self.truths)

    def to_dict(self) -> dict[str, int | float | None]:
        """JSON values."""
        return {name: getattr(self, name) for name in ("moda", "modp", "precision", "recall", "truths", "detections", "skipped")}


def _ratio(above: float, below: float) -> float | None:
    return above / below if below else None


def score_ground_detections(frames: Iterable[MatchingFrame], gate: float = GATE) -> GroundDetectionScore:
    """Score positions in x, y, metres, frame by frame; everybody in `frames` is evaluated.

    gate: the largest distance of a pair, m. Raises ValueError for a gate that is not above 0, and as `compare`.
    """
    if not gate > 0:
        raise ValueError(f"gate is {gate} m, needs more than 0")
    listed = list(frames)
    scored = [frame for frame in listed if len(frame.estimate_id)]
    matches, closeness = match_without_memory(compare(scored, planar_distance).mapped(lambda d: 1 - d / gate), -ROUNDING)
    truths, detections = (sum(len(getattr(frame, name)) for frame in scored) for name in ("truth_id", "estimate_id"))
    skipped = sum(len(frame.truth_id) > 0 and not len(frame.estimate_id) for frame in listed)
    return GroundDetectionScore(truths, detections, matches, closeness, skipped)
