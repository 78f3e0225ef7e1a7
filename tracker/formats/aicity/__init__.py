"""Track 1 of the AI City Challenge: its files, a scene as a recording, and the export of a sequence or of results.

Read `files.py` first.
"""
