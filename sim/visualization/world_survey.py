"""Survey of worlds: a table of their difficulty measures, previews, and the export of one world."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from sim.scenario import Scenario
from sim.simulation import wheel_slip
from sim.simulation.furnished_world import world_of
from sim.simulation.simulation import Simulation
from sim.visualization.world_preview import preview
from tracker.io.progress import progress_bar
from worlds import catalogue
from worlds.difficulty import measure
from worlds.export import export

PEOPLE, ROBOTS = 10, 3
"""People and robots in a preview, which show the scale."""
DRIVEN = 4
"""Rovers that measure slip."""
LONGEST = 3600
"""s: longest drive for the slip measurement."""
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
    "slip": "slip m/m",
}


@dataclass(frozen=True)
class SurveyOptions:
    """Optional outputs. pictures: folder of previews. file: export of the one world. seconds: duration of the slip measurement, 0 for none.

    distractors: number of things in the world that detectors take for people.
    """

    pictures: Path | None = None
    file: Path | None = None
    seconds: float = 0.0
    distractors: int = 0


def survey(name: str | None, difficulty: float, seed: int, options: SurveyOptions | None = None) -> list[dict[str, Any]]:
    """Rows of measures (worlds.difficulty) for the world `name`, or for all worlds if it is None.

    Raises ValueError for an unknown name, a difficulty, seconds or distractors out of bounds, and an export without a name.
    It is also raised if the folder of pictures is a file.
    """
    options = options or SurveyOptions()
    if options.file is not None and name is None:
        raise ValueError(f"--export {options.file} needs the name of one world: {', '.join(sorted(catalogue.WORLDS))}")
    if not 0 <= options.seconds <= LONGEST:
        raise ValueError(f"seconds is {options.seconds}, needs 0 to {LONGEST}")
    if options.pictures is not None and options.pictures.exists() and not options.pictures.is_dir():
        raise ValueError(f"{options.pictures}: is a file, needs a folder")
    names = sorted(catalogue.WORLDS) if name is None else [name]
    rows = []
    for each in progress_bar(names, desc="worlds", unit="world", disable=len(names) == 1, leave=False):
        scenario = Scenario(world=each, difficulty=difficulty, seed=seed, people=PEOPLE, robots=ROBOTS, distractors=options.distractors)
        world = world_of(scenario)
        if options.file is not None:
            export(world, options.file)
        measures = asdict(measure(world) if options.pictures is None else preview(scenario, world, options.pictures / f"{each}.png"))
        if options.seconds:
            measures["slip"] = wheel_slip.measure(Simulation(replace(scenario, people=0, robots=DRIVEN), world), options.seconds).error
        rows.append({"world": each, "difficulty": difficulty, "seed": seed} | {key: round(value, 4) for key, value in measures.items()})
    return rows


def describe(rows: list[dict[str, Any]]) -> str:
    """The rows as a table, with lines that explain the columns."""
    headings = {key: title for key, title in HEADINGS.items() if key in rows[0]}
    lines = [f"{'world':10}" + "".join(f"{title:>11}" for title in headings.values())]
    for row in rows:
        cells = (f"{row[key]:.0%}" if key.endswith("share") else f"{row[key]:.3g}" for key in headings)
        lines.append(f"{row['world']:10}" + "".join(f"{cell:>11}" for cell in cells))
    lines.append("> 10° and irregular (> 5°, or near a step of 5 cm): shares of the ground that can be walked; feet, wheels: of the extent;")
    lines.append(
        "occluders: per 100 m²" + ("; slip: error of wheel odometry a metre driven (sim.simulation.wheel_slip)" if "slip" in rows[0] else "")
    )
    return "\n".join(lines)
