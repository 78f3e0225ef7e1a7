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
    names, spans = setup.anchored_robots, _spans(frames)
    recursion, joint = _Recursion(setup, places), JointState(1, len(spans), correction)
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
            recursion.update(joint, i, frame)
        out.append([joint.covariance(i)[:3, :3].trace() for i in range(len(names))])
        recursion.remove(joint, [n for n in recursion.alive if spans[n] <= k])
    return np.array(out)


class _Recursion:
    """Landmarks at their true positions that come into the state and leave it. alive: those in the state, in its order."""

    def __init__(self, setup: Setup, places: Mapping[int, Array]) -> None:
        self.setup, self.places, self.alive = setup, places, list[int]()

    def update(self, joint: JointState, robot: int, frame: BoundFrame) -> None:
        """Update by all measurements of a robot, given by its number, at a frame. Landmarks seen first are added."""
        name = self.setup.anchored_robots[robot]
        odometry, pose = frame.odometry.get(name), frame.truth[name]
        gravity = None if odometry is None or odometry.gravity is None else replace(odometry, gravity=pose.rotation[2])
        for camera, mount in self.setup.mounts.items():
            if mount.robot != name or camera not in frame.seen:
                continue
            subject, covariance = frame.seen[camera]
            for new in sorted(set(subject.tolist()) - set(self.alive)):
                joint.add_landmark(self.places[new], np.zeros(0, dtype=np.intp), np.zeros((3, 0)), np.eye(3) * UNKNOWN**2)
                self.alive.append(new)
            rows = np.array([self.alive.index(s) for s in subject.tolist()], dtype=np.intp)
            bearing = (pose @ mount.T_body_camera).inverse().apply(joint.point[rows])
            bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
            seen, up, gravity = (mount, rows, bearing, covariance), gravity, None
            if len(rows) or up is not None:
                joint.update(lambda seen=seen, up=up: linearize(joint, robot, seen, up), 1, np.inf)  # type: ignore[misc]
        if gravity is not None:
            joint.update(lambda: linearize(joint, robot, None, gravity), 1, np.inf)

    def remove(self, joint: JointState, landmarks: Iterable[int]) -> None:
        """Remove landmarks; as in the state, the last one takes the place of each."""
        for landmark in landmarks:
            at = self.alive.index(landmark)
            joint.remove_landmark(at)
            self.alive[at] = self.alive[-1]
            self.alive.pop()


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
