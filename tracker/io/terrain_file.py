"""Reading the terrain of a sequence (NPZ) as height maps."""

from __future__ import annotations

from pathlib import Path

from tracker.geometry.ground import Grid
from tracker.io.csv_tables import read_arrays


def read_terrain(path: Path) -> tuple[Grid, Grid]:
    """Height maps of a terrain.npz: the ground, and the ground with walls and furniture. Raises ValueError with the path."""
    arrays = read_arrays(path, ("heights", "origin", "spacing", "tops"))
    try:
        if arrays["spacing"].shape not in ((), (1,)):
            raise ValueError(f"spacing has shape {arrays['spacing'].shape}, needs one number")
        origin, spacing = arrays["origin"], float(arrays["spacing"].ravel()[0])
        return Grid(arrays["heights"], origin, spacing), Grid(arrays["tops"], origin, spacing)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None
