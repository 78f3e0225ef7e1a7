"""Appearance without geometry: textures of floors, walls, soils and furniture, materials, lights and the sky.

Read `materials.py` first."""
