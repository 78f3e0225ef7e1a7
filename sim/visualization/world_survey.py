"""Survey of worlds: a table of their difficulty measures, previews on one page each, and the export of one world."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.colors
import matplotlib.figure
import matplotlib.patches
import numpy as np

from sim.rendering.cubemap import RenderedImage
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation import wheel_slip
from sim.simulation.simulation import Simulation, world_of
from sim.visualization.overlays import STANDING, save_figure
from tracker.geometry import Pose, rotation_z
from tracker.geometry.cameras import Panorama, pinhole
from tracker.io.progress import progress_bar
from worlds import catalogue
from worlds.difficulty import Measures, measure
from worlds.engine import mujoco
from worlds.export import export
from worlds.world import World

PEOPLE, ROBOTS = 10, 3
"""People and robots in a preview, which show the scale."""
DRIVEN = 4
"""Rovers that measure slip."""
LONGEST = 3600
"""s: longest drive for the slip measurement."""
PANORAMA = Panorama(2048, 1024)
BAND = (35.0, -50.0)
"""Highest and lowest elevation of the panorama on the page, degrees."""
OVERHEAD_CAMERA = pinhole(1200, 800, np.deg2rad(50))
HEIGHT_COLOURS = matplotlib.colors.ListedColormap(matplotlib.colormaps["YlGn"](np.linspace(0.02, 0.5, 256)))
"""Pale colours of heights, as a background for the plan."""
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


def survey(
    name: str | None, difficulty: float, seed: int, distractors: int = 0, seconds: float = 0.0, pictures: Path | None = None, file: Path | None = None
) -> list[dict[str, Any]]:
    """Rows of measures (worlds.difficulty) for the world `name`, or for all worlds if it is None; with `notes` for a place read from a file.

    distractors: number of things in the world that detectors take for people. seconds: duration of the slip measurement, 0 for none.
    pictures: folder of previews. file: export of the one world.
    Raises ValueError for an unknown name, a difficulty, seconds or distractors out of bounds, and an export without a name.
    It is also raised if the folder of pictures is a file.
    """
    if file is not None and name is None:
        raise ValueError(f"--export {file} needs the name of one world: {', '.join(sorted(catalogue.WORLDS))}")
    if not 0 <= seconds <= LONGEST:
        raise ValueError(f"seconds is {seconds}, needs 0 to {LONGEST}")
    if pictures is not None and pictures.exists() and not pictures.is_dir():
        raise ValueError(f"{pictures}: is a file, needs a folder")
    names = sorted(catalogue.WORLDS) if name is None else [name]
    rows = []
    for each in progress_bar(names, desc="worlds", unit="world", disable=len(names) == 1, leave=False):
        scenario = Scenario(world=each, difficulty=difficulty, seed=seed, people=PEOPLE, robots=ROBOTS, distractors=distractors)
        world = world_of(scenario)
        if file is not None:
            export(world, file)
        measures = asdict(measure(world) if pictures is None else preview(scenario, world, pictures / f"{world.name}.png"))
        if seconds:
            measures["slip"] = wheel_slip.measure(Simulation(replace(scenario, people=0, robots=DRIVEN), world), seconds).error
        rows.append({"world": world.name, "difficulty": difficulty, "seed": seed} | {key: round(value, 4) for key, value in measures.items()})
        if world.notes:
            rows[-1]["notes"] = world.notes
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


def preview(scenario: Scenario, world: World, path: Path) -> Measures:
    """Write the preview of a scenario's world as a PNG: a rover's panorama with people, a view from above, and the plan.

    Returns the measures of the world.
    Raises ValueError if robots or people do not fit in, GLUnavailable without OpenGL.
    """
    simulation = Simulation(scenario, world)
    for _ in range(12):
        simulation.step()
    eyes = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
    # The panorama is that of the robot that sees most people. Under a roof, the view of another robot replaces the view from above.
    with PanoramaRenderer(simulation.model, [PANORAMA, OVERHEAD_CAMERA], simulation.person_of_geom.astype(np.uint16)) as renderer:
        shots = renderer.render(simulation.data, eyes)
        best = int(np.argmax([(shot.instances > 0).sum() for shot in shots]))
        other = _facing_farthest(eyes[best - 1], shots[best - 1]) if _roofed(simulation) else _overhead_pose(simulation.world)
        overhead_image = renderer.render(simulation.data, [other], which=[1])[0].colour
    high, low = ((90 - elevation) / 180 * PANORAMA.height for elevation in BAND)
    measures = measure(simulation.world)
    figure: Any = matplotlib.figure.Figure(figsize=(16, 10.4), layout="constrained")
    figure.suptitle(f"{world.name}, difficulty {scenario.difficulty:g}", fontsize=20)
    grid = figure.add_gridspec(2, 2, height_ratios=(0.62, 1), width_ratios=(1.35, 1))
    for place, image in ((grid[0, :], shots[best].colour[round(high) : round(low)]), (grid[1, 0], overhead_image)):
        axes = figure.add_subplot(place)
        axes.imshow(image)
        axes.set_axis_off()
    _plan(figure.add_subplot(grid[1, 1]), simulation.world, measures)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(path, figure)
    return measures


def _roofed(simulation: Simulation) -> bool:
    """Whether most of the walkable area is covered."""
    places = simulation.world.feet.sample(np.random.default_rng(0), 20, 0.0, 0.0)
    heights = simulation.world.terrain.height_at(places)
    up, geom = np.array([0.0, 0.0, 1.0]), np.zeros(1, np.int32)
    eyes = np.column_stack([places, heights + 2.0])
    groups = np.array([1, 1, 0, 0, 0, 0], dtype=np.uint8)
    return sum(mujoco.mj_ray(simulation.model, simulation.data, eye, up, groups, 1, -1, geom, None) > 0 for eye in eyes) > 10


def _facing_farthest(eye: Pose, shot: RenderedImage) -> Pose:
    """The pose, rotated to the azimuth with the longest mean range over a twelfth of the panorama."""
    band = np.minimum(shot.range[PANORAMA.height * 4 // 9 : PANORAMA.height * 5 // 9], 30.0).mean(axis=0)
    wide = PANORAMA.width // 12
    smooth = np.convolve(np.concatenate([band, band[:wide]]), np.ones(wide), "valid")[: len(band)]
    azimuth = np.pi - 2 * np.pi * (int(np.argmax(smooth)) + wide / 2) / PANORAMA.width
    return eye @ Pose(rotation_z(float(azimuth)), np.zeros(3))


def _overhead_pose(world: World) -> Pose:
    """A camera above a corner of the walkable area that looks down on it."""
    places = world.feet.points(world.feet.free)
    low, high = places.min(axis=0), places.max(axis=0)
    middle = np.append((low + high) / 2, float(np.median(world.terrain.height_at(places))))
    reach = float(np.hypot(*(high - low)))
    eye = middle + reach * np.array([-0.62, -0.42, 0.62])
    forward = (middle - eye) / np.linalg.norm(middle - eye)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    return Pose(np.stack([forward, left, np.cross(forward, left)], axis=1), eye)


def _plan(axes: Any, world: World, measures: Measures) -> None:
    """Plan of heights, objects, free space of wheels and feet, and spawn areas."""
    ground = world.ground
    low, high = ground.extent
    box = (low[0], high[0], low[1], high[1])
    heights = world.terrain.on_grid.heights
    shaded = matplotlib.colors.LightSource(azdeg=315, altdeg=45).shade(
        heights, HEIGHT_COLOURS, vert_exag=2, dx=ground.spacing, dy=ground.spacing, blend_mode="soft"
    )
    axes.imshow(shaded, extent=box, origin="lower", interpolation="bilinear")
    standing = np.where(world.tops().heights - heights > STANDING, 1.0, np.nan)
    axes.imshow(standing, extent=box, origin="lower", cmap="gray", vmin=0, vmax=3, interpolation="nearest")
    for space, colour in ((world.feet, "tab:red"), (world.wheels, "tab:blue")):
        axes.contour(ground.x, ground.y, space.free.astype(float), [0.5], colors=colour, linewidths=1)
    for corner, opposite in world.spawn:
        axes.add_patch(matplotlib.patches.Rectangle(corner, *(opposite - corner), facecolor="gold", edgecolor="black"))
    axes.set_title(_measures_text(measures), fontsize=10)
    axes.set_xlabel("x (m); red: free for feet, blue: free for wheels, yellow: people enter")
    axes.set_ylabel("y (m)")


def _measures_text(m: Measures) -> str:
    lines = (
        f"{m.extent_x:.0f} × {m.extent_y:.0f} m, relief {m.relief:.2f} m, roughness {100 * m.roughness:.1f} cm",
        f"highest step {100 * m.highest_step:.0f} cm, {m.occluders:.1f} occluders per 100 m²",
        f"irregular {m.irregular_share:.0%}, steeper than 10° {m.steep_share:.0%}",
    )
    return "\n".join(lines)
