"""What a tracker would score before given cameras: twins of a recording, seen by a detector model, beside the real boxes.

Read `predict.py` first."""

from sim.prediction.predict import PredictionPlan, predict

__all__ = ["PredictionPlan", "predict"]
