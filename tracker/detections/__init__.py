"""Detections of a view prepared for tracking: ground points, occlusion, cross-view groups, silhouettes, optical flow and appearance.

Read `ground_points.py` first.
"""

from tracker.detections.boxes import detections_from_boxes

__all__ = ["detections_from_boxes"]
