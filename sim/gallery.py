"""All worlds side by side: their measures, their pictures, and one of them given away."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from sim.preview import preview
from sim.scenario import Scenario
from worlds import catalogue
from worlds.export import export
from worlds.measures import measure

PEOPLE, ROBOTS = 10, 3
"""Who is about in a picture: a place without anybody has no size."""
HEADINGS = {
    "extent_x": "x m",
    "extent_y": "y m",
    "relief": "relief m",
    "roughness": "rough m",
    "steep_share": "> 10°",
    "highest_step": "step m",
    "feet_share": "feet",
    "wheels_share": "wheels",
    "occluders": "occluders",
    "irregular_share": "irregular",
}


def survey(name: str | None, difficulty: float, seed: int, pictures: Path | None = None, file: Path | None = None) -> list[dict[str, Any]]:
    """A row of measures (worlds.measures) for the world of that name, or for all; pictures: draws into that folder; file: exports the one world.

    Raises ValueError for an unknown name, a difficulty out of bounds, or a file without a name.
    """
    if file is not None and name is None:
        raise ValueError(f"--export {file} needs the name of one world: {', '.join(sorted(catalogue.WORLDS))}")
    names = sorted(catalogue.WORLDS) if name is None else [name]
    rows = []
    for each in tqdm(names, desc="worlds", disable=len(names) == 1, leave=False):
        scenario = Scenario(world=each, difficulty=difficulty, seed=seed, people=PEOPLE, robots=ROBOTS)
        world = catalogue.build(each, scenario.stream("world"), difficulty)
        if file is not None:
            export(world, file)
        measures = measure(world) if pictures is None else preview(scenario, pictures / f"{each}.png")
        rows.append({"world": each, "difficulty": difficulty, "seed": seed} | {key: round(value, 4) for key, value in asdict(measures).items()})
    return rows


def describe(rows: list[dict[str, Any]]) -> str:
    """The rows as a table with a line that explains it."""
    lines = [f"{'world':10}" + "".join(f"{title:>11}" for title in HEADINGS.values())]
    for row in rows:
        cells = (f"{row[key]:.0%}" if key.endswith("share") else f"{row[key]:.3g}" for key in HEADINGS)
        lines.append(f"{row['world']:10}" + "".join(f"{cell:>11}" for cell in cells))
    lines.append("> 10° and irregular (> 5°, or near a step of 5 cm): shares of the ground that can be walked; feet, wheels: of the extent;")
    lines.append("occluders: per 100 m²")
    return "\n".join(lines)
