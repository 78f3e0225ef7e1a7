"""Irregular places in MuJoCo: terrain, props and textures, put together into worlds of a given difficulty and seed.

Read `world.py` first, then `scenes/pilsun.py`, a whole world in one file.
"""
