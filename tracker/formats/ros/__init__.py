"""Bags of ROS: a sequence as an MCAP file for Foxglove and ROS 2, and the bags of robots, of ROS 1 and ROS 2, as recordings.

Read `scene.py` first for the export, and `bag_import.py` for the import.
"""
