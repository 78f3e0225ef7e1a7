"""Offscreen rendering: OpenGL draws a MuJoCo model into cube faces, which are sampled for any camera.

Read `panorama.py` first."""
