"""Robots of a user, side by side in a world: a contact sheet of how each stands and of what its panorama sees, and a row of figures.

python -m tests.benchmarks.own_robots SHEET.jpg [ROBOT ...] [--world campus] [--seconds 3]

ROBOT: texts as of --robot; without any, those on wheels, legs and rotors that the tests write. Each drives alone for some seconds.
A tile has the robot from the side, and its panorama, on which the pixels of its own body are tinted and which says their share.
sole: lowest point of what is drawn over the drawn ground, m. camera: height of the panorama over the ground, m.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from sim.recording.tracker_setup import make_setup
from sim.rendering.panorama import PanoramaRenderer
from sim.robots.robot_choice import parse_robots
from sim.robots.user_robot import load_robot
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from sim.visualization.overlays import Image, contact_sheet
from tests.sim.robots.samples import ackermann, kiwi, mecanum, quadrotor, skid_steer, walker
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Panorama, pinhole
from tracker.recordings.recording import RecordingCamera
from worlds.triangles import geom_triangles

WRITTEN: tuple[Callable[[Path], str], ...] = (skid_steer, ackermann, kiwi, mecanum, walker, quadrotor)
SIDE, PANORAMA = pinhole(480, 320, np.radians(50)), Panorama(640, 320)
OWN = 65535
"""Instance of the robot's own body."""
HEADER = "robot                    motion      way m  sole m       camera m  itself"


@dataclass(frozen=True, eq=False)
class Portrait:
    """A robot after its drive: title and picture of its tile, and its row."""

    title: str
    picture: Image
    row: str


def portrait(robot: str, world: str, seconds: float) -> Portrait:
    """The picture and figures of one robot. Raises ValueError as Simulation."""
    simulation = Simulation(Scenario(world=world, robots=1, people=6, robot=robot, width=PANORAMA.width))
    before, frames = simulation.T_world_robot("robot_0").translation, round(seconds * simulation.scenario.rate)
    soles = []
    for _ in range(frames):
        simulation.step()
        soles.append(_sole(simulation))
    mount = make_setup(simulation).mounts["robot_0_camera"]
    body, eye = simulation.T_world_robot("robot_0"), simulation.T_world_robot("robot_0") @ mount.T_body_camera
    instances = np.where(_own(simulation), OWN, 0).astype(np.uint16)
    with PanoramaRenderer(simulation.model, [PANORAMA, SIDE], instances) as renderer:
        outside, inside = renderer.render(simulation.data, [_beside(body, _points(simulation)), eye], [1, 0])
    own = inside.instances == OWN
    seen = inside.colour.copy()
    seen[own] = seen[own] // 2 + np.array([127, 0, 0], np.uint8)
    ground = simulation.world.terrain.height_at(np.array([body.translation[:2], eye.translation[:2]]))
    (choice,) = parse_robots(robot)
    motion = load_robot(choice).motion
    name, way = Path(robot.partition(":")[0]), float(np.linalg.norm((body.translation - before)[:2]))
    title = f"{name.parent.name}/{name.stem}" if name.stem == "robot" else name.stem
    height = eye.translation[2] - ground[1]
    row = f"{title:24s} {motion:10s} {way:6.2f} {min(soles):6.3f} {max(soles):6.3f} {height:7.3f} {own.mean():7.4f}"
    title = f"{title}: {motion}, camera {height:.2f} m, {own.mean():.0%} is itself"
    return Portrait(title, np.hstack([outside.colour, seen]), row)


def _own(simulation: Simulation) -> Array:
    """(ngeom,) which geoms are drawn and of the robot."""
    model = simulation.model
    root = model.body_rootid[model.body("robot_0").id]
    return np.array([model.body_rootid[model.geom_bodyid[g]] == root and model.geom_group[g] <= 3 for g in range(model.ngeom)])


def _points(simulation: Simulation) -> Array:
    """(n, 3) m: corners of the drawn robot."""
    return np.concatenate([geom_triangles(simulation.model, simulation.data, int(g)).reshape(-1, 3) for g in np.flatnonzero(_own(simulation))])


def _sole(simulation: Simulation) -> float:
    """m: the least height of the drawn robot over the ground below it."""
    points = _points(simulation)
    lowest = points[points[:, 2] < points[:, 2].min() + 0.1]
    return float((lowest[:, 2] - simulation.world.terrain.height_at(lowest[:, :2])).min())


def _beside(body: Pose, points: Array) -> Pose:
    """A camera at the robot's right, ahead of it, that shows all of it."""
    middle, size = (points.min(axis=0) + points.max(axis=0)) / 2, float(np.ptp(points, axis=0).max())
    ahead, left = body.rotation[:, 0], body.rotation[:, 1]
    return RecordingCamera.looking_at(SIDE, middle + 1.1 * size * (ahead - left) + np.array([0, 0, 0.3 * size]), middle).pose


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--world", default="campus")
    parser.add_argument("--seconds", type=float, default=3.0)
    chosen = parser.parse_args()
    print(HEADER)
    pictures: dict[str, Image] = {}
    with tempfile.TemporaryDirectory() as folder:
        for robot in chosen.robots or [make(Path(folder)) for make in WRITTEN]:
            made = portrait(robot, chosen.world, chosen.seconds)
            print(made.row, flush=True)
            pictures[made.title] = made.picture
    sheet = contact_sheet(pictures, f"robots in {chosen.world} after {chosen.seconds:g} s")
    cv2.imwrite(str(chosen.sheet), sheet[..., ::-1])


if __name__ == "__main__":
    main()
