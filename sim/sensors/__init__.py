"""Sensor models: detections of people and robots, key points, landmarks and exposure, from rendered images or by ray casting.

Read `true_boxes.py` first."""
