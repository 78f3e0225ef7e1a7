"""The posterior Cramér-Rao bound of the robots' positions: the filter's recursion at the truth (Van Trees 1968; Tichavský et al. 1998).

At the truth all residuals are zero, so the means stay and the covariance is the bound. It holds if the errors of odometry, "up" and
bearings are independent, with the stated covariances, and if all associations are known.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.ekf.linearization import linearize
from tracker.ekf.state import JointState
from tracker.geometry import Array, Ints, Pose
from tracker.slam.features import FeatureParameters
from tracker.types import LandmarkHistory, Odometry, Setup

UNKNOWN = 100.0
"""m: the initial standard deviation of a landmark."""


@dataclass(frozen=True, eq=False)
class BoundFrame:
    """One frame: true poses by robot, odometry since the last frame by robot, and by camera the landmarks seen (k,) and covariances (k, 2, 2)."""

    truth: Mapping[str, Pose]
    odometry: Mapping[str, Odometry]
    seen: Mapping[str, tuple[Ints, Array]]


def position_variances(
    setup: Setup, frames: Sequence[BoundFrame], places: Mapping[int, Array], correction: tuple[float, float, float] | None = None
) -> Array:
    """(frames, robots) m²: the bound on the variance of position, summed over its axes, of moving robots with known starts, in the setup's order.

    places: landmark → (3,) m, without prior knowledge. correction: standard deviations, rad, of a constant correction factor that is estimated
    too. A landmark is in the state from its first sighting to its last, outside of which it carries no information.
    """
    names = setup.anchored_robots
    spans = _spans(frames)
    joint, alive = JointState(1, len(spans), correction), list[int]()
    for name in names:
        start = setup.starts[name]
        assert start is not None
        joint.add_robot(replace(start, T_world_robot=frames[0].truth[name]))
    out = []
    for k, frame in enumerate(frames):
        for i, name in enumerate(names):
            odometry = frame.odometry.get(name) if k else None
            if odometry is not None:
                joint.predict(i, frames[k - 1].truth[name].inverse() @ frame.truth[name], odometry.covariance)
            _update(joint, (setup, i, name), frame, (places, alive))
        out.append([joint.covariance(i)[:3, :3].trace() for i in range(len(names))])
        for removed in [n for n in alive if spans[n] <= k]:
            joint.remove_landmark(alive.index(removed))
            alive[alive.index(removed)] = alive[-1]
            alive.pop()
    return np.array(out)


def _update(joint: JointState, robot: tuple[Setup, int, str], frame: BoundFrame, landmarks: tuple[Mapping[int, Array], list[int]]) -> None:
    """Update by the measurements of a robot (setup, number, name) at a frame.

    landmarks: positions, and the landmarks in the state, to which new ones are appended.
    """
    setup, i, name = robot
    places, alive = landmarks
    odometry, pose = frame.odometry.get(name), frame.truth[name]
    gravity = None if odometry is None or odometry.gravity is None else replace(odometry, gravity=pose.rotation[2])
    for camera, mount in setup.mounts.items():
        if mount.robot != name or camera not in frame.seen:
            continue
        subject, covariance = frame.seen[camera]
        for new in sorted(set(subject.tolist()) - set(alive)):
            joint.add_landmark(places[new], np.zeros(0, dtype=np.intp), np.zeros((3, 0)), np.eye(3) * UNKNOWN**2)
            alive.append(new)
        number = {landmark: n for n, landmark in enumerate(alive)}
        rows = np.array([number[s] for s in subject.tolist()], dtype=np.intp)
        bearing = (pose @ mount.T_body_camera).inverse().apply(joint.point[rows])
        bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
        seen, up, gravity = (mount, rows, bearing, covariance), gravity, None
        if len(rows) or up is not None:
            joint.update(lambda seen=seen, up=up: linearize(joint, i, seen, up), 1, np.inf)  # type: ignore[misc]
    if gravity is not None:
        joint.update(lambda: linearize(joint, i, None, gravity), 1, np.inf)


def _spans(frames: Sequence[BoundFrame]) -> dict[int, int]:
    """Landmark → the last frame in which it was seen."""
    return {int(s): k for k, frame in enumerate(frames) for subject, _ in frame.seen.values() for s in subject}


def bound_step(P: Array, F: Array, Q: Array, information: Array) -> Array:
    """One step of the recursion for n independent states with linear motion (Tichavský et al. 1998, eq. 21): the bounds (n, d, d) one frame later.

    P (n, d, d): the bounds before; F, Q (d, d): transition and process noise; information (n, d, d): that of the frame's measurements.
    """
    predicted = F @ P @ F.T + Q
    return np.asarray(np.linalg.inv(np.linalg.inv(predicted) + information), dtype=np.float64)


def ate_bound(variance: Array) -> float:
    """Variances (frames, robots) m² → m: the mean over robots of the root mean square over frames, as ATE is."""
    return float(np.sqrt(variance.mean(axis=0)).mean())


def bound_of_map(
    setup: Setup, truth: Iterable[Mapping[str, Pose]], odometry: Iterable[Mapping[str, Odometry]], history: LandmarkHistory
) -> float | None:
    """The bound, m, of a run on images, where landmarks have no names: for the sightings that the tracker itself used, by its own map.

    It takes all associations as correct, landmarks at their last estimates, and all features with FeatureParameters.sigma. It leaves out
    sightings that the tracker did not use, other robots, and the bearings from which a landmark was triangulated. So another front end may be
    better than this bound. None if no robot moves from a known start, or nothing was seen.
    """
    if not history.positions or not setup.anchored_robots:
        return None
    cameras = {mount.robot: camera for camera, mount in setup.mounts.items()}
    R = np.eye(2) * FeatureParameters().sigma ** 2
    frames = [
        BoundFrame(poses, motions, {cameras[r]: (ids, np.tile(R, (len(ids), 1, 1))) for r, ids in seen.items() if len(ids)})
        for poses, motions, seen in zip(truth, odometry, history.sighted, strict=False)
    ]
    return ate_bound(position_variances(setup, frames, history.positions))
