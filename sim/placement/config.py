"""The configuration of a placement environment, checked when it is made."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from sim.placement.visibility import VisibilityLimits
from sim.scenario import INDEPENDENT, bounded
from tracker.detector_models.model import model_of
from tracker.parameter_file import Value, with_fields
from tracker.tracks.parameters import MhtParameters
from worlds import catalogue

DRIVES = ("kinematic", "physics")

OBSERVATIONS = ("state", "tracks", "pixels")

ACTIONS = ("velocity", "waypoint")

DECISION_RATE = 2.0
"""Decisions per second."""

FRAMES_PER_DECISION = 3
"""Sensor frames per decision: 6 per second, as in recorded sequences."""

DRIVING_STEPS = 2
"""Steps of kinematic rovers per sensor frame. People take one step of 1/6 s; their speeds and gaps agree with those of 1/24 s within 5 %."""

DENSITIES: dict[str, dict[str, Any]] = {
    "pilsun": {"world": "pilsun", "people": 10, "robots": 4},
    "s2l1": {"world": "campus", "people": 8, "robots": 4},
    "s2l2": {"world": "campus", "people": 35, "robots": 4},
    "s2l3": {"world": "campus", "people": 43, "robots": 4},
}
"""Presets with the number of people present at once in pilsun and in sequences of PETS 2009. The world campus has the ground of PETS 2009."""

BOUNDS: dict[str, tuple[float, float]] = {
    "difficulty": (0.0, 1.0),
    "robots": (1, 16),
    "people": (0, 200),
    "reach": (1.0, 100.0),
    "smallest": (1.0, 60.0),
    "width": (72, 2048),
    "camera_height": (0.5, 3.0),
    "cells": (4, 64),
    "cell": (0.25, 5.0),
    "misses": (0.0, 1.0),
    "clutter": (0.0, 100.0),
    "delay": (0, 60),
}

SEEDS_PER_MAP = 10
"""Consecutive seeds whose episodes share a map, where map_seed is None."""


@dataclass(frozen=True)
class PlacementConfig:
    """Options of the placement environment. Raises ValueError with name, value and bound.

    * world: a name of worlds.catalogue; difficulty in [0, 1]; robots and people: their numbers.
    * map_seed: the seed of the map of all episodes, or None: an episode of seed s has the map of seed s // 10.
    * drive: kinematic (rovers are unicycles on the ground) or physics (wheels on MuJoCo's terrain).
    * observation: state, tracks (SLAM and tracker in the loop) or pixels (state and panoramas).
    * action: velocity (forward speed and yaw rate) or waypoint (a point on the map).
    * reach (m) and smallest (°): people farther away, or of a smaller apparent height, are not seen. camera_height: m above the ground.
    * cells, cell (m): the local map of a robot has cells × cells of that size. width: px of the panoramas of "pixels".
    * misses, clutter, detector_model: the detector, as in Scenario. parameters: of the people tracker of "tracks", pairs of path and value.
      delay: frames by which the scored tracks are late. Policies get the tracker's current tracks, without delay.
    * panorama: index of the robot whose panorama `render` shows, or None for a plan view.
    """

    world: str = "ruins"
    robots: int = 4
    people: int = 10
    difficulty: float = 0.5
    map_seed: int | None = None
    drive: str = "kinematic"
    observation: str = "state"
    action: str = "velocity"
    reach: float = 12.0
    smallest: float = 7.0
    camera_height: float = 1.5
    cells: int = 16
    cell: float = 1.0
    width: int = 128
    misses: float = 0.1
    clutter: float = 0.05
    panorama: int | None = None
    detector_model: str = INDEPENDENT
    delay: int = 5
    parameters: tuple[tuple[str, Value], ...] = ()

    def __post_init__(self) -> None:
        catalogue.check_name(self.world)
        for name, choices in (("drive", DRIVES), ("observation", OBSERVATIONS), ("action", ACTIONS)):
            if getattr(self, name) not in choices:
                raise ValueError(f"{name} is {getattr(self, name)!r}, needs one of {', '.join(choices)}")
        for field in dataclasses.fields(self):
            if field.name in BOUNDS:
                bounded(field.name, getattr(self, field.name), BOUNDS[field.name], whole=field.type == "int")
        if self.width % 2:
            raise ValueError(f"width is {self.width} px, needs an even number")
        model_of(self.detector_model)
        if self.parameters and self.observation != "tracks":
            raise ValueError(f"parameters are of the observation tracks, and observation is {self.observation!r}")
        # Configurations are keys of caches, so mappings and lists of pairs become tuples.
        object.__setattr__(self, "parameters", tuple(dict(self.parameters).items()))
        with_fields(MhtParameters(), dict(self.parameters))
        if self.map_seed is not None:
            bounded("map_seed", self.map_seed, (0, 2**31), whole=True)
        if self.panorama is not None:
            bounded("panorama", self.panorama, (0, self.robots - 1), whole=True)

    @staticmethod
    def of(options: dict[str, Any], density: str | None = None) -> PlacementConfig:
        """The configuration of a density preset, overridden by `options`. Raises ValueError for an unknown option or density."""
        if density is not None and density not in DENSITIES:
            raise ValueError(f"density is {density!r}, needs one of {', '.join(DENSITIES)}")
        names = [field.name for field in dataclasses.fields(PlacementConfig)]
        unknown = sorted(set(options) - set(names))
        if unknown:
            raise ValueError(f"placement has no options {', '.join(unknown)}, knows {', '.join((*names, 'density', 'reward', 'render_mode'))}")
        return PlacementConfig(**((DENSITIES[density] if density else {}) | options))

    @property
    def visibility_limits(self) -> VisibilityLimits:
        """The limits within which a camera sees a person."""
        return VisibilityLimits(self.reach, math.radians(self.smallest), 0.25)

    @property
    def period(self) -> float:
        """Time between decisions, s."""
        return 1.0 / DECISION_RATE

    @property
    def frame_period(self) -> float:
        """Time between sensor frames, s."""
        return self.period / FRAMES_PER_DECISION

    @property
    def max_tracks(self) -> int:
        """The number of rows of the observation "beliefs"."""
        return self.people if self.observation != "tracks" else 2 * self.people + 4


X, Y, YAW, SPEED, YAW_RATE, TRAVELLED, TURNED = range(7)
"""Columns of a rover's state.

They are position (m), heading (rad), forward speed (m/s), yaw rate (rad/s), and total distance (m) and turn (rad).
"""
