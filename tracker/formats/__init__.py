"""The formats of others, one module or package each: reader, writer, opening of a folder, and export of a sequence of pilsim.

Read `registry.py` first: the table of all formats.
"""
