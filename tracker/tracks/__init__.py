"""What both trackers of people share: track state and Kalman filter, sensor models of the views, re-identification, and track ids.

Read `tracks.py` first."""
