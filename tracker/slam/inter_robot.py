"""Inter-robot measurements: identification of detected robots, their gate, and sightings that lie on a robot.

The bearing of another robot's camera correlates two poses of the joint state, and corrects both (Roumeliotis & Bekey 2002). It needs no
common landmarks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from tracker.ekf.gaussian import gate, mahalanobis2
from tracker.ekf.linearization import RobotMeasurements, linearize
from tracker.ekf.measurement_models import CameraPose
from tracker.ekf.state import JointState
from tracker.geometry import Mask
from tracker.types import Mount, RobotDetections, Setup, Sightings


def identify(setup: Setup, mount: Mount, seen: RobotDetections, team: Mapping[str, int]) -> RobotMeasurements:
    """The detections of robots of the `team` (robot → number in the joint state), sorted by number."""
    rows = [(team[name], i) for i, name in enumerate(seen.robot) if name in team]
    other, row = np.array(sorted(rows), dtype=np.intp).reshape(-1, 2).T
    levers = np.array([setup.mount_of(seen.robot[i]).T_body_camera.translation for i in row]).reshape(-1, 3)
    return RobotMeasurements(mount, other, levers, seen.bearing[row], seen.covariance[row])


def within_gate(joint: JointState, robot: int, seen: RobotMeasurements, probability: float) -> Mask:
    """(j,) whether each bearing alone lies within the gate that a correct one passes with `probability`."""
    linear, j = linearize(joint, robot, None, None, seen), np.arange(len(seen))
    spread = linear.H @ joint.P[np.ix_(linear.columns, linear.columns)] @ linear.H.T
    S = spread.reshape(len(j), 2, len(j), 2)[j, :, j] + linear.noise
    inside: Mask = mahalanobis2(linear.residual.reshape(-1, 2), S) < gate(2, probability)
    return inside


def on_robots(joint: JointState, camera: CameraPose, others: Iterable[int], seen: Sightings, radius: float) -> Mask:
    """(n,) whether a sighting without a name lies within `radius` m of the centre of one of the other robots."""
    moving = np.zeros(len(seen), dtype=bool)
    for other in others:
        p = camera.points(joint.translation[other][None])[0]
        distance = np.linalg.norm(p)
        reach = np.arctan2(radius, max(float(distance), 1e-6))
        moving |= (seen.bearing @ p > distance * np.cos(reach)) & (seen.subject < 0)
    return moving
