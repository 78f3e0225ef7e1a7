"""Files of any kind, with no knowledge of sequences: atomic writing, tables, JSON, XML, images, videos, and resumption of a run in a folder.

Read `atomic.py` first.
"""
