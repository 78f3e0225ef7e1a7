"""A small real sequence for exports: a rover and three fixed cameras before four people on level ground."""

import json
from pathlib import Path

import numpy as np

from sim.crowd.replay import Paths
from sim.datasets.twin import confine_rovers
from sim.recording.record import SimulatedSequence, write_sequence
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.plaza import plaza
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import pinhole
from tracker.recordings import RecordingCamera

FRAMES = 6
RATE = 6.0
PEOPLE = (4, 9, 17, 300)
LATE = 17
"""Who comes in frame 3."""
EYES = ((8.0, -4.0, 5.0), (-5.0, 9.0, 5.0), (-16.0, -12.0, 5.0))


def looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Pose:
    """T_world_camera without roll."""
    forward = np.array(at) - np.array(eye)
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    return Pose(np.column_stack([forward, left, np.cross(forward, left)]), np.array(eye))


def positions() -> Array:
    """(people, frames, 2) m."""
    start = np.array([[-8.0, -6.0], [-2.0, -3.0], [-5.0, 0.0], [-6.0, -5.0]])
    velocity = np.array([[1.3, 0.1], [-0.8, -1.0], [0.0, -1.2], [1.0, 1.0]])
    position = start[:, None] + velocity[:, None] * np.arange(FRAMES)[None, :, None] / RATE
    position[PEOPLE.index(LATE), :3] = np.nan
    return position


SEED = 11
"""With this seed the rover has somebody over the seam in three frames."""


def record(folder: Path) -> None:
    """Write the sequence."""
    position = positions()
    scenario = Scenario(world="campus", difficulty=0.0, seed=SEED, robots=1, people=len(PEOPLE), frames=FRAMES, rate=RATE, width=256)
    paths = Paths(np.array(PEOPLE), np.arange(FRAMES) / RATE, position, np.array([1.62, 1.85, 1.75, 1.7]))
    simulation = Simulation(scenario, world=confine_rovers(plaza(), position), paths=paths)
    camera = pinhole(320, 240, 1.2)
    fixed = {f"view_{k}": RecordingCamera(camera, looking(eye, (-5.0, -4.0, 0.5))) for k, eye in enumerate(EYES)}
    write_sequence(SimulatedSequence(simulation, fixed, json.loads(scenario.to_json())), folder)
