"""Places of a user: how exact their truth is, over seeds, and what large ones cost.

python -m tests.benchmarks.own_places [WORLD ...] [--seeds N] [--width PX] [--speed] [--triangles 0.1,1,5] [--sides 100,300,1000]

WORLD: texts as of --world, also worlds of ours, as campus; without any, a house (mesh), a site (MJCF) and hills (height map) that the tests write.
For each, a table row:
feet: largest distance of a standing sole from the drawn ground, m. walls: least distance from the axis of a body, 1 m over its feet, to the place, m.
pixels: share whose instance is that of the exact ray, more than 1.5 px from silhouettes. range: its 99th percentile error there, relative.
boxes: share of the edges of true boxes within 1 px of those of the rays' instances. workers: whether one and two write the same bytes.

--speed: a mesh of hills, or a height map (0 triangles). Each case is a process of its own. build: s until the scene is ready.
steps, panoramas: of the physics with one rover and 10 people, and of 1024 x 512 px with instances and range, a second of processor time.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from sim.recording.frames import Frame
from sim.recording.record import record, rendered_frames
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.footfalls import Footfalls
from tests.sim.rays import cast, compare
from tests.sim.recording.test_places import PLACES, digests, named
from tests.worlds.places.samples import hills, write_png
from tracker.geometry import Array
from worlds.catalogue import WORLDS
from worlds.engine import mujoco
from worlds.places.place import is_place

PLACE_GROUPS = np.array([1, 1, 0, 0, 0, 0], np.uint8)
"""Groups of the geoms of places; people and robots have others."""
CAMERA = "robot_0_camera"
FRAMES = 10
"""Frames of which a speed is the mean."""
HEADER = "world                    seeds  feet m  walls m  pixels    range  boxes   people  workers"


def truth_row(world: str, seeds: int, width: int) -> str:
    """The row of a place. width: of its panoramas, px."""
    gaps, walls, edges, agreements = [], [], [], []
    for seed in range(seeds):
        scenario = Scenario(world=world, robots=1, people=8, frames=1, width=width, seed=seed)
        simulation = Simulation(scenario)
        for _ in range(3):
            gaps.append(float(Footfalls(simulation, 12).gap.max()))
            walls.append(_least_gap(simulation))
        (frame,) = rendered_frames(simulation, make_setup(simulation))
        image, pose, camera = frame.images[CAMERA], frame.views[CAMERA].T_world_camera, make_setup(simulation).mounts[CAMERA].camera
        instances = simulation.person_of_geom.astype(np.uint16)
        geom, distance = cast(simulation.model, simulation.data, camera, pose)
        agreements.append(compare(image, instances, geom, distance))
        edges.append(_edge_errors(frame, np.where(geom < 0, 0, instances[geom])))
    errors = np.concatenate(edges)
    same = _same_bytes(world)
    inside, percentile = min(a.inside for a in agreements), max(a.percentile for a in agreements)
    share = float((errors <= 1).mean()) if len(errors) else np.nan
    name = Path(world.partition(":")[0]).name
    return f"{name:24s} {seeds:5d} {max(gaps):7.4f} {min(walls):8.3f} {inside:7.5f} {percentile:8.5f} {share:6.4f} {len(errors):8d}  {same}"


def _least_gap(simulation: Simulation) -> float:
    """m from the axes of the bodies, 1 m over their feet, to the place, in 32 directions."""
    angle = np.arange(32) * np.pi / 16
    directions = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(32)])
    least = np.inf
    for eye in simulation.feet() + np.array([0, 0, 1.0]):
        geom, distance = np.zeros((32, 1), np.int32), np.zeros((32, 1))
        mujoco.mj_multiRay(simulation.model, simulation.data, eye, directions.ravel(), PLACE_GROUPS, 1, -1, geom, distance, None, 32, 1e6)
        least = min([least, *distance[geom >= 0]])
    return float(least)


def _edge_errors(frame: Frame, instances: Array) -> Array:
    """(k, 4) px: edges of true boxes less those of the instances (rows, columns) of rays; of people whom both see away from the seam."""
    out, boxes = [], frame.views[CAMERA].boxes
    for person, box in zip(boxes.person, boxes.seen, strict=True):
        row, column = np.nonzero(instances == person)
        if len(row) and box[2] > box[0] and column.min() > 0 and column.max() < instances.shape[1] - 1:
            out.append(np.abs(box - [column.min(), row.min(), column.max() + 1, row.max() + 1]))
    return np.array(out).reshape(-1, 4)


def _same_bytes(world: str) -> bool:
    scenario = Scenario(world=world, robots=1, people=4, frames=4, width=256, seed=1)
    with tempfile.TemporaryDirectory() as folder:
        for workers in (1, 2):
            record(scenario, Path(folder) / str(workers), workers=workers)
        return digests(Path(folder) / "1") == digests(Path(folder) / "2")


@dataclass(frozen=True)
class Cost:
    """What a place costs: millions of triangles, 0 for a height map, and m a side; as the table says; memory MiB."""

    millions: float
    side: float
    build: float
    steps: float
    panoramas: float
    memory: float

    @property
    def row(self) -> str:
        kind = f"{self.millions:g} million" if self.millions else "height map"
        return f"{kind:12s} {self.side:6.0f} {self.build:8.1f} {self.steps:8.0f} {self.panoramas:11.2f} {self.memory:8.0f}"


def cost(millions: float, side: float) -> Cost:
    """What a mesh of hills of so many triangles costs, or a height map, side m a side."""
    with tempfile.TemporaryDirectory() as folder:
        world = _hills(Path(folder), millions, side) if millions else write_png(Path(folder) / "dem.png", side, 1024)
        start = time.process_time()
        simulation = Simulation(Scenario(world=world, robots=1, people=10, frames=FRAMES + 1, width=1024))
        build = time.process_time() - start
        simulation.step()
        start = time.process_time()
        for _ in range(FRAMES):
            simulation.step()
        stepping = time.process_time() - start
        steps = FRAMES * simulation.scenario.crowd_steps * simulation.scenario.substeps / stepping
        frames = rendered_frames(simulation, make_setup(simulation))
        # The first frame prepares the renderer.
        next(frames)
        start = time.process_time()
        for _ in frames:
            pass
        panoramas = FRAMES / max(time.process_time() - start - stepping, 1e-9)
    return Cost(millions, side, build, steps, panoramas, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def growth(costs: list[Cost]) -> list[str]:
    """How the figures grow with triangles at each side, and with the side at each number of triangles."""
    meshes = [c for c in costs if c.millions]
    with_triangles = [_growth([c for c in meshes if c.side == side], "millions", f"{side:g} m") for side in sorted({c.side for c in meshes})]
    numbers = {c.millions: f"{c.millions:g} million" if c.millions else "height map" for c in costs}
    return [*with_triangles, *(_growth([c for c in costs if c.millions == number], "side", name) for number, name in numbers.items())]


def _growth(costs: list[Cost], by: str, of: str) -> str:
    least, most = (end(costs, key=lambda c: float(getattr(c, by))) for end in (min, max))
    ratio = {name: getattr(most, name) / getattr(least, name) for name in (by, "build", "steps", "panoramas", "memory")}
    return f"{of}: " + ", ".join(f"{name} x {times:.3g}" for name, times in ratio.items())


def _hills(folder: Path, millions: float, side: float) -> str:
    n = round(np.sqrt(millions * 5e5)) + 1
    x, y = np.meshgrid(np.linspace(-side / 2, side / 2, n), np.linspace(-side / 2, side / 2, n))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.column_stack([corner, corner + 1, corner + n + 1]), np.column_stack([corner, corner + n + 1, corner + n])])
    mesh = trimesh.Trimesh(np.column_stack([x.ravel(), y.ravel(), hills(x, y).ravel()]), faces, process=False)
    mesh.export(folder / "hills.ply")
    return str(folder / "hills.ply:up=z,unit=m")


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split(",")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--width", type=int, default=1024, metavar="PX")
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--triangles", type=_numbers, default=[0.0, 0.1, 1.0, 5.0], metavar="MILLIONS")
    parser.add_argument("--sides", type=_numbers, default=[100.0, 300.0, 1000.0], metavar="M")
    chosen, _ = parser.parse_known_args()
    if chosen.speed:
        print("triangles    side m  build s  steps/s panoramas/s      MiB")
        costs = []
        for millions in chosen.triangles:
            for side in chosen.sides:
                with multiprocessing.get_context("spawn").Pool(1) as alone:
                    costs.append(alone.apply(cost, (millions, side)))
                print(costs[-1].row, flush=True)
        print("\n".join(growth(costs)))
        return
    print(HEADER)
    with tempfile.TemporaryDirectory() as folder:
        for world in [world for world in chosen.worlds if is_place(world) or world in WORLDS] or [named(Path(folder), place) for place in PLACES]:
            print(truth_row(world, chosen.seeds, chosen.width), flush=True)


if __name__ == "__main__":
    main()
