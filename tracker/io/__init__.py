"""Files of any kind, with no knowledge of sequences: atomic writing, tables, JSON, XML, images, videos, and resumption of runs.

Read `atomic.py` first.
"""
