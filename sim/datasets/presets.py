"""Presets of datasets: size, crowd and frame rate as in recorded sequences, in any world."""

from __future__ import annotations

import dataclasses
import difflib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.robots.clock import parse_clocks
from sim.scenario import Scenario
from tracker.geometry import Array
from tracker.io.json_files import read_json
from tracker.io.text_files import shown
from tracker.parameter_file import read_toml
from worlds.catalogue import check_name
from worlds.semantics import CLASSES
from worlds.terrain.free_space import FreeSpace, largest_region, spawn_areas
from worlds.terrain.heightfield import Mask
from worlds.world import World

PETS_GROUND = (27.0, 25.0)
"""Size along x and y of the box around all paths in S2.L1 and S1.L1 of PETS 2009, m."""
PETS_CENTRE = (-6.5, -4.0)
"""Centre of that box in the frame of PETS 2009, which is that of the world campus, m."""
PAPER: dict[str, float] = {
    "L_c": 4, "delta_min": 0.05, "omega_delta": 0.3, "epsilon_Phi": 0.5, "epsilon_h": 0.3, "epsilon_3D": 2.5,
    "theta_s": 0.3, "v_max": 0.8, "delta_a": 9, "K_H": 25, "i_bls_max": 2000, "N_conf": 3,
}  # fmt: skip
"""The paper's tracker parameters under its names (m, s, frames; v_max m per frame). Datasets record them but do not depend on them."""


@dataclass(frozen=True)
class Preset:
    """A kind of dataset.

    scenario: of the first sequence; the following ones have the following seeds. views: number of fixed cameras.
    ground: size along x and y of the area of people and rovers (m), or None for the whole world.
    corners: whether the fixed cameras stand in the corners of the free space; otherwise place_cameras places them.
    """

    scenario: Scenario
    views: int
    ground: tuple[float, float] | None = None
    corners: bool = False


def _crowd(people: int, at_once: int, frames: int, views: int) -> Preset:
    scenario = Scenario(world="campus", difficulty=0.0, robots=2, people=people, at_once=at_once, frames=frames, rate=7.0)
    return Preset(scenario, views, PETS_GROUND)


def _room(robots: int, views: int) -> Preset:
    scenario = Scenario(world="hall:room=7.7x3.4", difficulty=0.0, robots=robots, people=10, frames=260, rate=4.0)
    return Preset(scenario, views, corners=True)


PRESETS: dict[str, Preset] = {
    "pilsun": Preset(Scenario(frames=333, robots=4, people=10, rate=6.0), 4),
    "s2l1": _crowd(19, 8, 795, 7),
    "s2l2": _crowd(43, 35, 436, 4),
    "s2l3": _crowd(74, 43, 240, 4),
    "room": _room(0, 4),
    "room-rovers": _room(2, 0),
    "square": Preset(Scenario(world="hall:square=12x36", difficulty=0.0, robots=0, people=72, at_once=24, frames=360, rate=2.0, groups=0.3), 7),
}
"""room is as large as the rooms CMC1 to CMC3, which have 3, 10 and 15 people (Ong et al. 2022); room-rovers is seen by two rovers alone.
square is as large and as dense as WILDTRACK (Chavdarova et al. 2018), with its frame rate and number of cameras.
pilsun is the paper's dataset. s2l1 to s2l3 have the people, frames and views of PETS 2009 S2.L1 to S2.L3."""


def preset_of(name: str, changes: Mapping[str, Any]) -> Preset:
    """The preset of a name, with `changes` of `views` or of fields of its scenario.

    Raises ValueError for an unknown name or field and for a value out of bounds.
    """
    if name not in PRESETS:
        raise ValueError(f"preset is {name!r}, needs one of {', '.join(PRESETS)}")
    preset = PRESETS[name]
    fields = [field.name for field in dataclasses.fields(Scenario)]
    unknown = sorted(set(changes) - {*fields, "views"})
    if unknown:
        similar = difflib.get_close_matches(unknown[0], fields, 1, 0.75)
        raise ValueError(f"setting is {shown(unknown[0])}{f' ({similar[0]}?)' if similar else ''}, needs one of views, {', '.join(fields)}")
    views = changes.get("views", preset.views)
    if not isinstance(views, int) or isinstance(views, bool) or not 0 <= views <= 32:
        raise ValueError(f"views is {shown(repr(views))[1:-1]}, needs a whole number in [0, 32]")
    check_name(changes.get("world", preset.scenario.world))
    scenario = dataclasses.replace(preset.scenario, **{key: value for key, value in changes.items() if key != "views"})
    if not scenario.robots and not views:
        raise ValueError("robots and views are 0, needs one of them above 0: nobody would see anything")
    cameras = [f"View_{k + 1:03d}" for k in range(views)]
    for clock in parse_clocks(scenario.clock) if scenario.clock else ():
        if clock.startswith("View_") and clock not in cameras:
            raise ValueError(f"clock names {clock[:60]!r}, but the fixed cameras are {', '.join(cameras) or 'none'}")
    return dataclasses.replace(preset, scenario=scenario, views=views)


def read_settings(path: Path) -> dict[str, Any]:
    """The settings in a TOML or JSON file, as `preset_of` takes them. Raises ValueError, with the file's name, for a missing or invalid file."""
    if path.suffix not in (".json", ".toml") and path.is_file():
        raise ValueError(f"{path}: needs an ending of .toml or .json")
    if path.suffix != ".json":
        return read_toml(path)
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError(f"{path}: a JSON {type(content).__name__}, needs an object")
    return content


def provenance(name: str, preset: Preset) -> dict[str, Any]:
    """The provenance of a sequence of a preset as JSON values: scenario, number of cameras, class names and the paper's parameters."""
    ground = list(preset.ground) if preset.ground else None
    return json.loads(preset.scenario.to_json()) | {"preset": name, "views": preset.views, "ground": ground, "classes": list(CLASSES), "paper": PAPER}


def confine(world: World, ground: tuple[float, float] | None, rng: np.random.Generator) -> World:
    """The world with people and rovers confined to a box of `ground` m, or the same world where it is None.

    The box keeps the density of a recorded crowd. In `campus` it lies where PETS 2009 was recorded, else at the centre of the walkable area.
    Raises ValueError where nothing in the box is free.
    """
    if ground is None:
        return world
    i, j = np.nonzero(world.feet.free)
    centre = np.array(PETS_CENTRE) if world.name == "campus" else world.feet.origin + world.feet.spacing * np.array([j.mean(), i.mean()])
    low, high = centre - np.array(ground) / 2, centre + np.array(ground) / 2
    feet, wheels = (within(space, low, high, world.name) for space in (world.feet, world.wheels))
    if feet.area == world.feet.area:
        return dataclasses.replace(world, wheels=wheels)
    return dataclasses.replace(world, feet=feet, wheels=wheels, spawn=spawn_areas(feet, rng, len(world.spawn)))


def within(space: FreeSpace, low: Array, high: Array, name: str) -> FreeSpace:
    """The largest connected part of the free space of the world `name` from low (2,) to high (2,) m. Raises ValueError where nothing is free."""
    rows, columns = space.free.shape
    x, y = (space.origin[k] + space.spacing * np.arange(n) for k, n in ((0, columns), (1, rows)))
    free: Mask = space.free & ((y >= low[1]) & (y <= high[1]))[:, None] & ((x >= low[0]) & (x <= high[0]))
    if not free.any():
        raise ValueError(f"free space of {name} is empty from {low} to {high} m")
    return FreeSpace(largest_region(free), space.origin, space.spacing)
