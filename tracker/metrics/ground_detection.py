"""MODA, MODP, precision and recall of positions on the ground, as detectors are scored on WILDTRACK and MultiviewX.

The rules are those of CLEAR_MOD_HUN.m and evaluateDetection.m in the evaluation kit of MVDet (Hou et al. 2020,
https://github.com/hou-yz/MVDet, multiview_detector/evaluation), after Kasturi et al. 2009:

* Each frame is matched alone, without ids: the most pairs within 0.5 m (td = 50 / 2.5 = 20 cells of 2.5 cm), at the least sum of distances.
* MODA = 1 − (misses + false positives) / truths. MODP = mean over pairs of 1 − d / 0.5 m.
* Only frames with a detection are scored, so that the misses of a frame without any do not count. Such frames are counted as `skipped`.

The kit's Python translation (pyeval) refuses a pair at exactly 0.5 m and turns a negative MODA into 0. MATLAB's version and this module do neither.

The same data are scored for tracking with a gate of 1 m, which is `clear_mot.score`'s own: EarlyBird (Teepe et al. 2024, evaluation/mot_bev.py)
passes positions in cells times 0.025 m and squared distances up to 1 m² to py-motmetrics; TrackTacular does the same.
"""

from __future__ import annotations

from collections.abc import Iterable

from tracker.metrics.matching import MatchingFrame, compare, match_without_memory, planar_distance

GATE = 0.5
"""m: the largest distance of a pair."""
ROUNDING = 1e-9
"""Tolerance as a share of the gate: positions on a grid can lie exactly at the gate, up to rounding."""


def score_ground_detections(frames: Iterable[MatchingFrame]) -> dict[str, float | int | None]:
    """Scores of positions in x, y, metres, frame by frame, as JSON values, None where undefined; everybody in `frames` is evaluated.

    truths, detections: positions of the frames with a detection; skipped: number of frames that have truth and no detection. Raises as `compare`.
    """
    listed = list(frames)
    scored = [frame for frame in listed if len(frame.estimate_id)]
    matches, closeness = match_without_memory(compare(scored, planar_distance).mapped(lambda d: 1 - d / GATE), -ROUNDING)
    truths, detections = (sum(len(getattr(frame, name)) for frame in scored) for name in ("truth_id", "estimate_id"))
    return {
        "moda": (2 * matches - detections) / truths if truths else None,
        "modp": closeness / matches if matches else None,
        "precision": matches / detections if detections else None,
        "recall": matches / truths if truths else None,
        "truths": truths,
        "detections": detections,
        "skipped": sum(len(frame.truth_id) > 0 and not len(frame.estimate_id) for frame in listed),
    }
