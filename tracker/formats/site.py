"""What PETS 2009 leaves to its readers: frame rate, tracking area and ground. site.json beside the annotations says it where it is not PETS's own.

Fields: rate [1/s]; area [[x, y], [x, y]] m, the lowest and the highest corner; terrain: the name of a file of heights, or null for z = 0.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.atomic import write_text
from tracker.calibration import read_terrain
from tracker.geometry import Array
from tracker.ground import Flat, Ground

FILE, TERRAIN = "site.json", "terrain.npz"
AREA = ((-14.0696, -14.2740), (4.9813, 1.7335))
"""m: of the cropped annotations of PETS 2009 (Milan's truth)."""
RATE = 7.0
"""Frames a second of PETS 2009."""
FASTEST = 1e4


@dataclass(frozen=True, eq=False)
class Site:
    """rate in frames/s, area (2, 2) m, the ground, and the top of what stands on it or None."""

    rate: float
    area: Array
    ground: Ground
    occluders: Ground | None = None


def read_site(folder: Path) -> Site:
    """That of a folder; PETS 2009's own where it says nothing. Raises ValueError with the file's name for what is none."""
    path = folder / FILE
    if not path.is_file():
        return Site(RATE, np.array(AREA), Flat())
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        rate, area, terrain = float(content["rate"]), np.array(content["area"], dtype=np.float64), content["terrain"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"{path}: needs rate, area and terrain in JSON ({error})") from None
    if not 0 < rate <= FASTEST:
        raise ValueError(f"{path}: rate is {rate}, needs more than 0 and at most {FASTEST:g}")
    if area.shape != (2, 2) or not np.isfinite(area).all() or not (area[0] < area[1]).all():
        raise ValueError(f"{path}: area is {str(content['area'])[:80]}, needs two corners x, y m, the lowest first")
    if terrain is None:
        return Site(rate, area, Flat())
    if terrain != TERRAIN:
        raise ValueError(f"{path}: terrain is {str(terrain)[:80]!r}, needs {TERRAIN!r} or null")
    return Site(rate, area, *read_terrain(folder / TERRAIN))


def write_site(folder: Path, site: Site, terrain: Path | None) -> None:
    """Write what read_site reads; terrain: the file of a sequence that holds the site's ground, or None where that is z = 0."""
    if terrain is not None:
        (folder / TERRAIN).write_bytes(terrain.read_bytes())
    content = {"rate": site.rate, "area": site.area.tolist(), "terrain": TERRAIN if terrain is not None else None}
    write_text(folder / FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")
