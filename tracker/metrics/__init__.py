"""Scores: CLEAR MOT, IDF1, HOTA, ATE, RPE, NEES and maps.

Read `evaluation.py` first.
"""

from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import evaluate
from tracker.metrics.trajectory import score_robots

__all__ = ["evaluate", "score", "score_robots"]
