"""ROS bags: export of a sequence as an MCAP file for Foxglove and ROS 2, import of ROS 1 and ROS 2 bags as recordings.

Read `scene.py` first for the export, and `bag_import.py` for the import.
"""
