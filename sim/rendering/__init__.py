"""Offscreen OpenGL: a MuJoCo model drawn into cube faces and sampled into any camera, with colour, instances, classes and range.

Read `panorama.py` first."""
