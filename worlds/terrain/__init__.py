"""Terrain: height maps, decks, relief, polygons, and the free space of feet and wheels.

Read `heightfield.py` first, then `walk_surface.py`."""
