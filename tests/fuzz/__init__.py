"""Damaged files: every reader of the project gives a value or a ValueError that names the file.

Read `readers.py` first: the table of all readers.
"""
