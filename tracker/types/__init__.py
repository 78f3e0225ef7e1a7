"""Immutable inputs and outputs of the tracker, checked when they are made.

Read `ticks.py` first.
"""

from tracker.types.detections import Detections, RobotDetections, Sightings
from tracker.types.estimate import Estimate, LandmarkHistory, MapSnapshot
from tracker.types.robot_sensors import ImuSamples, SensorSamples, SensorSetup, WheelSamples
from tracker.types.sequence import Sequence, Ticks, TicksInMemory, without_starts
from tracker.types.setup import Mount, Setup, Start
from tracker.types.ticks import Intervals, Odometry, Tick, View
from tracker.types.truth import HIDDEN, KEYPOINT_COUNT, KEYPOINT_NAMES, VISIBLE, Boxes, Keypoints, Truth, ViewTruth

__all__ = [
    "HIDDEN",
    "KEYPOINT_COUNT",
    "KEYPOINT_NAMES",
    "VISIBLE",
    "Boxes",
    "Detections",
    "Estimate",
    "ImuSamples",
    "Intervals",
    "Keypoints",
    "LandmarkHistory",
    "MapSnapshot",
    "Mount",
    "Odometry",
    "RobotDetections",
    "SensorSamples",
    "SensorSetup",
    "Sequence",
    "Setup",
    "Sightings",
    "Start",
    "Tick",
    "Ticks",
    "TicksInMemory",
    "Truth",
    "View",
    "ViewTruth",
    "WheelSamples",
    "without_starts",
]
