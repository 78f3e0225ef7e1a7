"""What PETS 2009 leaves to its readers: frame rate, tracking area, ground and what stands before the cameras. site.json beside the annotations says
it where it is not PETS's own.

Fields: rate [1/s]; area [[x, y], [x, y]] m, the lowest and the highest corner; terrain: the name of a file of heights, or null for z = 0;
pillars, which may be left out: [[x, y, radius, low, high], ...] m, upright round things that hide people.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
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
PILLARS = ((-13.708, -10.623, 0.07, 0.0, 2.4), (-13.708, -10.623, 0.24, 2.4, 3.03))
"""m: the lamp post of PETS 2009 and the sign on it, which hides people of View_001 for seconds; measured in its first frame by its calibration."""
RATE = 7.0
"""Frames a second of PETS 2009."""
FASTEST = 1e4


@dataclass(frozen=True, eq=False)
class Site:
    """rate in frames/s, area (2, 2) m, the ground, and the top of what stands on it or None; pillars (p, 5) m, as in Setup."""

    rate: float
    area: Array
    ground: Ground
    occluders: Ground | None = None
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))


def read_site(folder: Path) -> Site:
    """That of a folder; PETS 2009's own where it says nothing. Raises ValueError with the file's name for what is none."""
    path = folder / FILE
    if not path.is_file():
        return Site(RATE, np.array(AREA), Flat(), pillars=np.array(PILLARS))
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        rate, area, terrain = float(content["rate"]), np.array(content["area"], dtype=np.float64), content["terrain"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"{path}: needs rate, area and terrain in JSON ({error})") from None
    if not 0 < rate <= FASTEST:
        raise ValueError(f"{path}: rate is {rate}, needs more than 0 and at most {FASTEST:g}")
    if area.shape != (2, 2) or not np.isfinite(area).all() or not (area[0] < area[1]).all():
        raise ValueError(f"{path}: area is {str(content['area'])[:80]}, needs two corners x, y m, the lowest first")
    pillars = _pillars(path, content.get("pillars", []))
    if terrain is None:
        return Site(rate, area, Flat(), pillars=pillars)
    if terrain != TERRAIN:
        raise ValueError(f"{path}: terrain is {str(terrain)[:80]!r}, needs {TERRAIN!r} or null")
    return Site(rate, area, *read_terrain(folder / TERRAIN), pillars=pillars)


def _pillars(path: Path, rows: Any) -> Array:
    try:
        pillars = np.array(rows, dtype=np.float64).reshape(-1, 5)
    except (ValueError, TypeError):
        pillars = np.full((1, 5), np.nan)
    if not np.isfinite(pillars).all() or not (pillars[:, 2] > 0).all() or not (pillars[:, 3] < pillars[:, 4]).all():
        raise ValueError(f"{path}: pillars is {str(rows)[:80]}, needs rows of x, y, radius, low and high in metres, radius over 0 and low under high")
    return pillars


def write_site(folder: Path, site: Site, terrain: Path | None) -> None:
    """Write what read_site reads; terrain: the file of a sequence that holds the site's ground, or None where that is z = 0."""
    if terrain is not None:
        (folder / TERRAIN).write_bytes(terrain.read_bytes())
    content = {"rate": site.rate, "area": site.area.tolist(), "terrain": TERRAIN if terrain is not None else None, "pillars": site.pillars.tolist()}
    write_text(folder / FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")
