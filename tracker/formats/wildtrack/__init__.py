"""WILDTRACK, MultiviewX and GMVD: their files, a folder as a recording, and the export of fixed cameras.

Read `files.py` first.
"""
