"""Scores: CLEAR MOT, IDF1, HOTA, ATE, RPE, NEES, landmark maps, and the posterior Cramér-Rao bound.

Read `evaluation.py` first."""
