"""JRDB: its labels, a sequence as a recording in the frame of the robot, and the export of panoramas.

Read `files.py` first.
"""
