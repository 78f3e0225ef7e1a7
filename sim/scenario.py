"""Scenario: all parameters of a run as one value, with conversion to and from JSON.

The same scenario gives the same truth, odometry and detections on every machine.
"""

from __future__ import annotations

import dataclasses
import json
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

BOUNDS: dict[str, tuple[float, float]] = {
    "difficulty": (0.0, 1.0),
    "seed": (0, 2**63 - 1),
    "robots": (1, 64),
    "people": (0, 1000),
    "at_once": (0, 1000),
    "children": (0.0, 1.0),
    "frames": (1, 1_000_000),
    "rate": (0.5, 60.0),
    "width": (64, 8192),
    "camera_height": (0.5, 3.0),
    "timestep": (0.0005, 0.01),
    "exposure": (0.0, 4.0),
    "image_noise": (0.0, 100.0),
    "misses": (0.0, 1.0),
    "clutter": (0.0, 100.0),
    "bearing_noise": (0.0, math.radians(10.0)),
    "min_visible": (0.0, 1.0),
}
"""Lowest and highest value of every numeric field, both included."""


@dataclass(frozen=True)
class Scenario:
    """Parameters of a simulation and of its sensors.

    world: a name of worlds.catalogue. difficulty: in [0, 1]. seed: of all random streams. frames: number of frames. rate: frames/s.
    people: number of people in the whole run. children: share of them who are children (1.1 to 1.5 m tall; adults 1.5 to 2 m).
    at_once: how many people are present at once, entering and leaving through spawn areas; 0 means all of them throughout.
    width: of the panorama, px; its height is half of it. camera_height: m above the ground.
    timestep: of the physics, s; the nearest value that divides the crowd's step is used.
    Images: exposure is the sigma of its slow drift in stops, image_noise the sigma of every pixel and channel in counts of 255.
    Detector: misses is the share of visible people not detected, clutter the mean number of false detections a view and frame.
    bearing_noise is one sigma of a box's edge, rad; a body with a smaller visible fraction than min_visible is never detected.
    Raises ValueError with name, value and bound for any field out of its bounds, NaN included.
    """

    world: str = "pilsun"
    difficulty: float = 0.5
    seed: int = 0
    robots: int = 4
    people: int = 10
    at_once: int = 0
    children: float = 0.0
    frames: int = 60
    rate: float = 6.0
    width: int = 1024
    camera_height: float = 1.5
    timestep: float = 0.005
    exposure: float = 0.0
    image_noise: float = 0.0
    misses: float = 0.1
    clutter: float = 0.05
    bearing_noise: float = math.radians(0.15)
    min_visible: float = 0.2

    def __post_init__(self) -> None:
        if not isinstance(self.world, str) or not self.world:
            raise ValueError(f"world is {self.world!r}, needs a name")
        for field in dataclasses.fields(self):
            if field.name in BOUNDS:
                object.__setattr__(self, field.name, _bounded(field.name, getattr(self, field.name), whole=field.type == "int"))
        if self.width % 2:
            raise ValueError(f"width is {self.width} px, needs an even number")

    @property
    def height(self) -> int:
        """Height of the panorama, px."""
        return self.width // 2

    @property
    def period(self) -> float:
        """s between frames."""
        return 1.0 / self.rate

    def stream(self, name: str) -> np.random.Generator:
        """The random stream of that name, seeded by (seed, crc32(name)). Streams are independent of each other."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])

    def to_json(self) -> str:
        """One JSON object with a key for each field, and floats as their shortest exact decimals."""
        return json.dumps(dataclasses.asdict(self), indent=2, allow_nan=False) + "\n"

    @staticmethod
    def from_json(text: str) -> Scenario:
        """Inverse of to_json. Raises ValueError if the text is no object, or a field is unknown, missing or out of bounds."""
        content = json.loads(text)
        if not isinstance(content, dict):
            raise ValueError(f"scenario is a JSON {type(content).__name__}, needs an object")
        names = [field.name for field in dataclasses.fields(Scenario)]
        unknown, missing = sorted(set(content) - set(names)), [name for name in names if name not in content]
        if unknown:
            raise ValueError(f"scenario has unknown fields {unknown}, knows {names}")
        if missing:
            raise ValueError(f"scenario lacks the fields {missing}, needs all of {names}")
        return Scenario(**content)


def _bounded(name: str, value: Any, whole: bool) -> float:
    """`value` as an int or a float. Raises ValueError if it is not a number within BOUNDS[name]."""
    low, high = BOUNDS[name]
    kind = "a whole number" if whole else "a number"
    fits = isinstance(value, (int, np.integer)) if whole else isinstance(value, (int, float, np.integer, np.floating))
    if not fits or isinstance(value, bool):
        raise ValueError(f"{name} is {repr(value)[:60]}, needs {kind} in [{low:g}, {high:g}]")
    if not low <= value <= high:
        raise ValueError(f"{name} is {repr(value)[:60]}, needs {kind} in [{low:g}, {high:g}]")
    return int(value) if whole else float(value)
