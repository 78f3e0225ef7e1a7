"""A sequence as a bag of ROS 2 in an MCAP file, with the definitions of its messages, which Foxglove and ROS 2 open without a plugin.

Read `scene.py` first.
"""
