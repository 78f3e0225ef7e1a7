"""Wheel slip on a world: error of ideal wheel odometry, without sensor errors.

The odometry moves along the true heading by the mean wheel rotation times the true radius. Its error is due to slip, bumps and scrubbing wheels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.robots.rover import WHEEL_RADIUS
from sim.simulation.simulation import Simulation
from tracker.geometry import Array

SEGMENT = 5.0
"""m: length of the driven segments whose errors are averaged."""


@dataclass(frozen=True)
class Slip:
    """Result of a measurement.

    error: m of odometry error per metre driven, the mean over segments of about SEGMENT m; NaN without such a segment.
    Geiger et al. (2012, KITTI) define it for longer segments. driven: m, of all rovers.
    tipped: number of frames in which a rover was tipped over, summed over the rovers.
    """

    error: float
    driven: float
    tipped: int


def measure(simulation: Simulation, seconds: float) -> Slip:
    """Drive all rovers from the current state for `seconds` s, which must be at least one frame."""
    steps, tipped = [], 0
    before, turned = _poses(simulation), simulation.wheel_angles()
    for _ in range(round(seconds / simulation.scenario.period)):
        simulation.step()
        after, now = _poses(simulation), simulation.wheel_angles()
        ahead = before[:, :, 0] + after[:, :, 0]
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        rolled = WHEEL_RADIUS * (now - turned).mean(axis=1)
        moved = after[:, :, 3] - before[:, :, 3]
        steps.append(np.column_stack([rolled[:, None] * ahead - moved, np.linalg.norm(moved, axis=1)]))
        before, turned = after, now
        tipped += sum(simulation.tipped().values())
    errors = [error for rover in np.array(steps).transpose(1, 0, 2) for error in _segment_errors(rover)]
    driven = float(np.array(steps)[..., 3].sum())
    return Slip(float(np.mean(errors)) if errors else float("nan"), driven, tipped)


def _poses(simulation: Simulation) -> Array:
    """Rotation and translation m (robots, 3, 4) of the rovers."""
    poses = [simulation.T_world_robot(name) for name in simulation.robots]
    return np.array([np.column_stack([pose.rotation, pose.translation]) for pose in poses])


def _segment_errors(steps: Array) -> list[float]:
    """Errors per metre of one rover's segments. steps (n, 4): error (3) m and distance m of every frame."""
    out: list[float] = []
    error, distance = np.zeros(3), 0.0
    for step in steps:
        error, distance = error + step[:3], distance + step[3]
        if distance >= SEGMENT:
            out.append(float(np.linalg.norm(error)) / distance)
            error, distance = np.zeros(3), 0.0
    return out
