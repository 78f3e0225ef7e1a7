"""Irregular places in MuJoCo: terrain, props and textures, combined into worlds of a given difficulty and seed.

Read `world.py` first, then `scenes/pilsun.py`, a whole world in one file.
"""
