"""Meshes and the objects made of them: furniture, rooms, plants and rocks.

Read `shapes.py` first."""
