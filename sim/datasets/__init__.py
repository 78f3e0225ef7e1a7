"""Data sets of many sequences: presets, fixed cameras, resumable generation, and the twin of PETS 2009.

Read `generation.py` first."""
