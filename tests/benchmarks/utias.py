"""UTIAS sets 1 and 6: the planar filter compared with a batch of the same measurements (GTSAM, Levenberg-Marquardt), known and unknown map.

The batch estimates landmarks, and the pose of each robot whenever it sees or is seen. Sightings have Cauchy weights with the threshold of the filter.
The batch starts from the paths of the filter, so that it finds the nearest minimum. It has no correction factor, so that the filter without one is
shown as well.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.conftest import DATA
from tracker.planar_slam.event_schedule import FilterInput, PlanarParameters, filter_input
from tracker.planar_slam.filter import OUTPUT, SCAN, STEP
from tracker.planar_slam.motion_model import Sensors
from tracker.planar_slam.trajectories import PlanarTrajectories, score_trajectories
from tracker.planar_slam.utias_files import UtiasDataset, read_utias
from tracker.planar_slam.utias_run import track_utias

Array = NDArray[np.float64]

SETS = (1, 6)
KNOWN_SIGMA = 1e-3
"""Standard deviation of starts and of a known map, m and rad."""
MIN_SIGMA = 1e-5
"""Smallest standard deviation of a step of odometry, m and rad."""


@dataclass(eq=False)
class Chain:
    """The poses of a robot in order: times, s; steps (3,) between poses with covariances (3, 3); and the motion since the last pose."""

    times: list[float]
    steps: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    since: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def node(self, moment: float) -> int:
        """The index of the pose at a time, s. A robot that has not moved has no new pose."""
        if self.covariance.any():
            self.steps.append(self.since)
            self.covariances.append(self.covariance + np.eye(3) * MIN_SIGMA**2)
            self.times.append(moment)
            self.since, self.covariance = np.zeros(3), np.zeros((3, 3))
        return len(self.times) - 1


@dataclass(eq=False)
class Problem:
    """The batch problem.

    chains: one a robot. sightings: robot, its pose, subject, pose of the subject (−1 for a landmark), range and bearing (m, rad), and their standard
    deviations. last, since: for each mark and robot, the last pose before it, and the motion since that pose.
    """

    chains: list[Chain]
    sightings: list[tuple[int, int, int, int, Array, Array]]
    last: NDArray[np.intp]
    since: Array


@njit(cache=True)
def compose(since: Array, covariance: Array, motion: Array, noise: Array) -> tuple[Array, Array]:
    """A pose (3,) and its covariance in the right tangent after one more arc."""
    bend = 0.5 * motion[1]
    chord = motion[0] * (np.sin(bend) / bend if abs(bend) > 1e-9 else 1.0)
    c, s = np.cos(since[2] + bend), np.sin(since[2] + bend)
    pose = np.array([since[0] + chord * c, since[1] + chord * s, since[2] + motion[1]])
    c, s = np.cos(motion[1]), np.sin(motion[1])
    x, y = chord * np.cos(bend), chord * np.sin(bend)
    F = np.array([[c, s, s * x - c * y], [-s, c, c * x + s * y], [0.0, 0.0, 1.0]])
    c, s = np.cos(bend), np.sin(bend)
    G = np.array([[c, s, 0.5 * chord * s], [-s, c, 0.5 * chord * c], [0.0, 0.0, 1.0]])
    return pose, F @ covariance @ F.T + (G * noise[:3]) @ G.T


def batch_problem(out: FilterInput) -> Problem:
    """The batch problem of the events of the filter."""
    schedule, robots = out.schedule, len(out.robots)
    chains = [Chain([float(out.times[0])]) for _ in range(robots)]
    sightings, mark = [], 0
    last, since = np.zeros((schedule.outputs, robots), dtype=np.intp), np.zeros((schedule.outputs, robots, 3))
    for kind, robot, item, moment in zip(schedule.kind, schedule.robot, schedule.item, schedule.time, strict=True):
        chain = chains[robot]
        if kind == STEP:
            chain.since, chain.covariance = compose(chain.since, chain.covariance, schedule.motion[item], schedule.noise[item])
        elif kind == SCAN:
            for row in range(schedule.start[item], schedule.start[item + 1]):
                subject = int(schedule.subject[row])
                other = chains[subject].node(moment) if subject < robots else -1
                sightings.append((int(robot), chain.node(moment), subject, other, schedule.z[row], schedule.sigma[row]))
        elif kind == OUTPUT:
            last[mark] = [len(c.times) - 1 for c in chains]
            since[mark] = [c.since for c in chains]
            mark += 1
    return Problem(chains, sightings, last, since)


def solve_batch(out: FilterInput, start: PlanarTrajectories, known_map: bool, threshold: float) -> PlanarTrajectories:
    """Solve the batch problem: paths and map. start: the initial values. threshold: of the Cauchy weights."""
    import gtsam

    task, robots = batch_problem(out), len(out.robots)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()

    def landmark(k: int) -> int:
        return int(gtsam.symbol("l", k))

    def pose(robot: int, k: int) -> int:
        return int(gtsam.symbol(chr(ord("a") + robot), k))

    for i, chain in enumerate(task.chains):
        path = start.poses[out.robots[i]]
        columns = [np.interp(chain.times, start.times, c) for c in (path[:, 0], path[:, 1], np.unwrap(path[:, 2]))]
        for k, values_at in enumerate(zip(*columns, strict=True)):
            values.insert(pose(i, k), gtsam.Pose2(*values_at))
        first = gtsam.Pose2(*out.state.mean[8 * i : 8 * i + 3])
        graph.add(gtsam.PriorFactorPose2(pose(i, 0), first, gtsam.noiseModel.Isotropic.Sigma(3, KNOWN_SIGMA)))
        for k, (step, P) in enumerate(zip(chain.steps, chain.covariances, strict=True)):
            noise = gtsam.noiseModel.Gaussian.Covariance(P)
            graph.add(gtsam.BetweenFactorPose2(pose(i, k), pose(i, k + 1), gtsam.Pose2(*step), noise))
    for k, subject in enumerate(out.subjects):
        if known_map or subject in start.landmarks:
            place = out.state.mean[8 * robots + 2 * k : 8 * robots + 2 * k + 2] if known_map else start.landmarks[subject]
            values.insert(landmark(k), place)
            if known_map:
                graph.add(gtsam.PriorFactorPoint2(landmark(k), place, gtsam.noiseModel.Isotropic.Sigma(2, KNOWN_SIGMA)))
    cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(threshold)
    for robot, k, subject, other, z, sigma in task.sightings:
        noise = gtsam.noiseModel.Robust.Create(cauchy, gtsam.noiseModel.Diagonal.Sigmas(sigma[::-1].copy()))
        seen = (pose(robot, k), pose(subject, other) if other >= 0 else landmark(subject - robots), gtsam.Rot2(z[1]), z[0], noise)
        graph.add(gtsam.BearingRangeFactorPose2(*seen) if other >= 0 else gtsam.BearingRangeFactor2D(*seen))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    poses = {n: _path(task, i, np.array([_row(found.atPose2(pose(i, k))) for k in range(len(c.times))]), out.times)
             for i, (n, c) in enumerate(zip(out.robots, task.chains, strict=True))}  # fmt: skip
    places = {s: found.atPoint2(landmark(k)) for k, s in enumerate(out.subjects) if values.exists(landmark(k))}
    return PlanarTrajectories(out.times, poses, {n: np.tile(np.eye(3), (len(out.times), 1, 1)) for n in poses}, places, {})


def _row(pose) -> list[float]:  # type: ignore[no-untyped-def]
    return [pose.x(), pose.y(), pose.theta()]


def _path(task: Problem, robot: int, nodes: Array, times: Array) -> Array:
    """Poses (n, 3) at all marks: the last pose and odometry since then, corrected in proportion to time by the error at the next pose."""
    chain, last = task.chains[robot], task.last[:, robot]
    when = np.array(chain.times)
    gap = np.zeros((len(nodes), 3))
    if chain.steps:
        gap[:-1] = _relative(_compose_all(nodes[:-1], np.array(chain.steps)), nodes[1:])
    until = np.append(np.diff(when), np.inf)
    share = np.clip((times - when[last]) / until[last], 0.0, 1.0)[:, None]
    return _compose_all(_compose_all(nodes[last], task.since[:, robot]), share * gap[last])


def _compose_all(poses: Array, steps: Array) -> Array:
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, turn = steps.T
    return np.stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y, poses[:, 2] + turn], axis=1)


def _relative(poses: Array, others: Array) -> Array:
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    d = others - poses
    turn = (d[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], turn], axis=1)


def compare_methods(team: UtiasDataset, source: Path, known_map: bool) -> list[tuple[str, dict[str, float | None], float]]:
    """Name, scores and processor time, s, of the filter, of the filter without correction factors, and of the batch."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, parameters in (("filter (default)", PlanarParameters()), ("filter without correction factor", PlanarParameters(correction=False))):
            began = time.process_time()
            paths = track_utias(source, Path(folder) / name, known_map, parameters)
            rows.append((name, score_trajectories(team, paths), time.process_time() - began))
    began = time.process_time()
    batch = solve_batch(filter_input(team, Sensors(), known_map, False), paths, known_map, parameters.robust)
    return [*rows, ("batch (GTSAM)", score_trajectories(team, batch), time.process_time() - began)]


def main() -> None:
    if importlib.util.find_spec("gtsam") is None:
        print("gtsam is not installed: nothing to compare with")
        return
    print("| set, map | | ATE, m | aligned, m | map, m | seconds |\n|---|---|---|---|---|---|")
    for number in SETS:
        source = DATA / "utias" / f"MRCLAM_Dataset{number}"
        if not source.is_dir():
            print(f"set {number} is not there ({source.name})")
            continue
        team = read_utias(source)
        for known_map in (True, False):
            for name, scores, seconds in compare_methods(team, source, known_map):
                cells = ["–" if (v := scores[m]) is None else f"{v:.3f}" for m in ("ate_m", "ate_aligned_m", "map_m")]
                print(f"| {number}, {'known' if known_map else 'unknown'} | {name} | {' | '.join(cells)} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
