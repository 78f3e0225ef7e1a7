"""Visualization: overlays on images, plans, videos, previews of worlds, and Rerun.

Read `overlays.py` first."""
