"""Pictures for people: boxes on panoramas, plans, videos, overviews of worlds, and Rerun.

Read `overlays.py` first."""
