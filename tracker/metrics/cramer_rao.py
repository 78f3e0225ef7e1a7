"""The posterior Cramér-Rao bound of the robots' places, by the filter's own recursion at the truth (Van Trees 1968; Tichavský et al. 1998).

Nothing is wrong there, so the means stay where they are and the covariance is the bound. It holds where odometry, "up" and bearings err as their
covariances say, frame by frame anew, and where somebody tells which landmark is which.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tracker.ekf.linearization import linearise
from tracker.ekf.state import JointState
from tracker.geometry import Array, Ints, Pose
from tracker.slam.features import Extraction
from tracker.types import LandmarkHistory, Odometry, Setup

UNKNOWN = 100.0
"""m: the deviation of a landmark of which nothing is known."""


@dataclass(frozen=True, eq=False)
class BoundFrame:
    """One moment: true poses by robot, odometry since the frame before by robot, and by camera which landmarks it saw (k,), covariances (k, 2, 2)."""

    truth: Mapping[str, Pose]
    odometry: Mapping[str, Odometry]
    seen: Mapping[str, tuple[Ints, Array]]


def variances(setup: Setup, frames: Sequence[BoundFrame], places: Mapping[int, Array], correction: tuple[float, float, float] | None = None) -> Array:
    """(frames, robots) m²: the least variance of position, summed over its axes, of the robots that move and whose start is told, in setup's order.

    places: landmark → (3,) m; nothing was known of them before they were seen. correction: spreads, rad, of a standing correction factor that is
    estimated too. A landmark is in the state from its first sighting to its last: before and after it tells nothing.
    """
    names = setup.anchored_robots
    spans = _spans(frames)
    joint, alive = JointState(1, len(spans), correction), list[int]()
    for name in names:
        start = setup.starts[name]
        assert start is not None
        joint.join(replace(start, T_world_robot=frames[0].truth[name]))
    out = []
    for k, frame in enumerate(frames):
        for i, name in enumerate(names):
            odometry = frame.odometry.get(name) if k else None
            if odometry is not None:
                joint.predict(i, frames[k - 1].truth[name].inverse() @ frame.truth[name], odometry.covariance)
            _look(joint, (setup, i, name), frame, (places, alive))
        out.append([joint.covariance(i)[:3, :3].trace() for i in range(len(names))])
        for gone in [n for n in alive if spans[n] <= k]:
            joint.remove(alive.index(gone))
            alive[alive.index(gone)] = alive[-1]
            alive.pop()
    return np.array(out)


def _look(joint: JointState, who: tuple[Setup, int, str], frame: BoundFrame, atlas: tuple[Mapping[int, Array], list[int]]) -> None:
    """What a robot (setup, number, name) learns at a frame; `atlas` = places, and the landmarks in the state, which may become more."""
    setup, i, name = who
    places, alive = atlas
    odometry, pose = frame.odometry.get(name), frame.truth[name]
    level = None if odometry is None or odometry.gravity is None else replace(odometry, gravity=pose.rotation[2])
    for camera, mount in setup.mounts.items():
        if mount.robot != name or camera not in frame.seen:
            continue
        subject, covariance = frame.seen[camera]
        for new in sorted(set(subject.tolist()) - set(alive)):
            joint.add(places[new], np.zeros(0, dtype=np.intp), np.zeros((3, 0)), np.eye(3) * UNKNOWN**2)
            alive.append(new)
        number = {landmark: n for n, landmark in enumerate(alive)}
        rows = np.array([number[s] for s in subject.tolist()], dtype=np.intp)
        bearing = (pose @ mount.T_body_camera).inverse().apply(joint.point[rows])
        bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
        seen, up, level = (mount, rows, bearing, covariance), level, None
        if len(rows) or up is not None:
            joint.update(lambda seen=seen, up=up: linearise(joint, i, seen, up), 1, np.inf)  # type: ignore[misc]
    if level is not None:
        joint.update(lambda: linearise(joint, i, None, level), 1, np.inf)


def _spans(frames: Sequence[BoundFrame]) -> dict[int, int]:
    """Landmark → the last frame in which it was seen."""
    return {int(s): k for k, frame in enumerate(frames) for subject, _ in frame.seen.values() for s in subject}


def bound_step(P: Array, F: Array, Q: Array, information: Array) -> Array:
    """One step of the recursion for n independent states that move linearly (Tichavský et al. 1998, eq. 21): the bounds (n, d, d) one frame later.

    P (n, d, d): the bounds before; F, Q (d, d): transition and process noise; information (n, d, d): what the measurements of the frame add.
    """
    predicted = F @ P @ F.T + Q
    return np.asarray(np.linalg.inv(np.linalg.inv(predicted) + information), dtype=np.float64)


def ate_bound(variance: Array) -> float:
    """Variances (frames, robots) m² → m: the mean over robots of the root mean square over frames, as ATE is."""
    return float(np.sqrt(variance.mean(axis=0)).mean())


def surveyed(setup: Setup, truth: Iterable[Mapping[str, Pose]], odometry: Iterable[Mapping[str, Odometry]], survey: LandmarkHistory) -> float | None:
    """The bound, m, for a run from pictures, where no landmark has a name: for sightings that the tracker itself took in, as its own map had them.

    So it takes each of the tracker's associations for right and each landmark to be where it was last believed to be, and a feature to be as good
    as Extraction says. What a tracker could have seen beside is not in it, nor are other robots, nor the rays that a landmark was placed from before:
    another front end may well be below it. None where no robot moves from a start that was told, or nothing was seen.
    """
    if not survey.places or not setup.anchored_robots:
        return None
    cameras = {mount.robot: camera for camera, mount in setup.mounts.items()}
    R = np.eye(2) * Extraction().sigma ** 2
    frames = [
        BoundFrame(poses, moved, {cameras[r]: (ids, np.tile(R, (len(ids), 1, 1))) for r, ids in seen.items() if len(ids)})
        for poses, moved, seen in zip(truth, odometry, survey.sighted, strict=False)
    ]
    return ate_bound(variances(setup, frames, survey.places))
