"""Calibration that is off: what the tracker is told of the mounts of cameras, beside what is true."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sim.recording.view_rendering import MountedRig, mounted_rigs
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Pose
from tracker.types import Setup


def is_off(scenario: Scenario) -> bool:
    """Whether the tracker is told wrong mounts."""
    effects = scenario.camera_effects
    return effects.mount_angle is not None or effects.mount_shift is not None


def told_setup(scenario: Scenario, simulation: Simulation, true: Setup) -> Setup:
    """The setup that the tracker is told: every rig is turned by mount_angle about a random axis, and moved by mount_shift in a random direction.

    The lenses of a rig move together. Axis and direction are of the stream "calibration/NAME".
    """
    mounts = dict(true.mounts)
    for mounted in mounted_rigs(scenario, simulation, true):
        error = _error(scenario, mounted)
        for view in mounted.rig.views:
            name = mounted.name + view.suffix
            mounts[name] = dataclasses.replace(mounts[name], T_body_camera=mounted.T_body_rig @ error @ view.T_rig_view)
    return dataclasses.replace(true, mounts=mounts)


def error_rows(scenario: Scenario, simulation: Simulation, true: Setup) -> list[list[object]]:
    """Rows of truth/effects.csv for all rigs: the size of their errors, degrees and m."""
    given = scenario.camera_effects.given()
    sizes = [(name, given[name]) for name in ("mount_angle", "mount_shift") if name in given]
    return [[mounted.name, name, value, 0.0, 0.0, 0.0] for mounted in mounted_rigs(scenario, simulation, true) for name, value in sizes]


def _error(scenario: Scenario, mounted: MountedRig) -> Pose:
    effects, rng = scenario.camera_effects, scenario.stream(f"calibration/{mounted.name}")
    axis, direction = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    shift, turn = (effects.mount_shift or 0.0) * direction, math.radians(effects.mount_angle or 0.0) * axis
    return Pose(Pose.exp(np.concatenate([np.zeros(3), turn])).rotation, shift)
