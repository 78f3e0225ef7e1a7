"""Robots of a user: a contact sheet of how each stands in a world and of what its panorama sees; and whether the team's filter is consistent.

python -m tests.benchmarks.own_robots [ROBOT ...] [--world campus] [--sheet runs/robots.png] [--seconds 3]
python -m tests.benchmarks.own_robots ROBOT ... --seeds 10 [--world house.glb] [--frames 40]

ROBOT: texts as of --robot; without any, those on wheels, legs and rotors that the tests write. Each drives alone for some seconds.
A tile has the robot from the side, and its panorama, on which the pixels of its own body are tinted and which says their share.
sole: least and greatest height of its lowest point over the drawn ground, m, every fourth frame. camera: height of the panorama over the ground, m.

--seeds: the robots as one team, without images, with landmarks and each other by ray casting: NEES per degree of freedom of each pose.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.recording.frames import raycast_frames
from sim.recording.tracker_setup import make_setup
from sim.rendering.panorama import PanoramaRenderer
from sim.robots.robot_choice import parse_robots
from sim.robots.user_robot import load_robot
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from sim.visualization.overlays import Image, contact_sheet, save_png
from tests.sim.robots.samples import ackermann, kiwi, mecanum, quadrotor, skid_steer, walker
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Panorama, pinhole
from tracker.metrics.trajectory import score_each
from tracker.pipeline import track
from tracker.recordings.recording import RecordingCamera
from tracker.sequence import Results
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
    for frame in range(frames):
        simulation.step()
        # Corners of fine meshes take long.
        if frame % 4 == 3:
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
    way, height, title = float(np.linalg.norm((body.translation - before)[:2])), eye.translation[2] - ground[1], _name(robot)
    row = f"{title:24s} {motion:10s} {way:6.2f} {min(soles):6.3f} {max(soles):6.3f} {height:7.3f} {own.mean():7.4f}"
    title = f"{title}: {motion}, camera {height:.2f} m, {own.mean():.0%} is itself"
    return Portrait(title, np.hstack([outside.colour, seen]), row)


def consistency(robots: list[str], world: str, frames: int, seed: int) -> list[float]:
    """NEES per degree of freedom of the pose of each robot of a team."""
    simulation = Simulation(Scenario(world=world, robots=len(robots), people=3, frames=frames, robot=",".join(robots), seed=seed))
    setup = make_setup(simulation)
    made = list(raycast_frames(simulation, setup))
    found = Results.of(track(setup, [frame.tick for frame in made]), run={})
    truth: dict[str, list[Pose | None]] = {name: [frame.truth.T_world_robot[name] for frame in made] for name in simulation.robots}
    scores = score_each(truth, found.poses, found.covariances)
    return [scores[name].nees_per_dof for name in simulation.robots]


def _print_consistency(robots: list[str], world: str, frames: int, seeds: int) -> None:
    print("seed " + " ".join(f"{_name(robot):>16s}" for robot in robots))
    rows = []
    for seed in range(seeds):
        rows.append(consistency(robots, world, frames, seed))
        print(f"{seed:4d} " + " ".join(f"{value:16.2f}" for value in rows[-1]), flush=True)
    print("mean " + " ".join(f"{value:16.2f}" for value in np.mean(rows, axis=0)))


def _name(robot: str) -> str:
    path = Path(robot.partition(":")[0])
    return f"{path.parent.name}/{path.stem}" if path.stem == "robot" else path.stem


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
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--sheet", type=Path, default=Path("runs/robots.png"))
    parser.add_argument("--world", default="campus")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--frames", type=int, default=40)
    chosen, _ = parser.parse_known_args()
    # Run by name, the name of this benchmark is among the words.
    named = [robot for robot in chosen.robots if robot != Path(__file__).stem]
    if chosen.seeds:
        _print_consistency(named, chosen.world, chosen.frames, chosen.seeds)
        return
    print(HEADER)
    pictures: dict[str, Image] = {}
    with tempfile.TemporaryDirectory() as folder:
        for robot in named or [make(Path(folder)) for make in WRITTEN]:
            made = portrait(robot, chosen.world, chosen.seconds)
            print(made.row, flush=True)
            pictures[made.title] = made.picture
    sheet = contact_sheet(pictures, f"robots in {chosen.world} after {chosen.seconds:g} s")
    chosen.sheet.parent.mkdir(parents=True, exist_ok=True)
    save_png(chosen.sheet, sheet)
    print(f"{chosen.sheet}: written")


if __name__ == "__main__":
    main()
