"""Formats of other projects, one module or package each: reader, writer, and export of pilsim sequences. `opening.py` opens a folder.

Read `registry.py` first: the table of all formats.
"""
