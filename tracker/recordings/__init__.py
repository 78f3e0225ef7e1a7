"""A recording of one's own: fixed and moving cameras with boxes of people, optional truth, images and odometry.

Read `recording.py` first.
"""

from tracker.recordings.recording import FrameBoxes, Recording, RecordingCamera, RecordingRobot

__all__ = ["FrameBoxes", "Recording", "RecordingCamera", "RecordingRobot"]
