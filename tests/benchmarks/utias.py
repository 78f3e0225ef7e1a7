"""UTIAS sets 1 and 6: the planar filter beside a batch of the same measurements and noise (GTSAM, Levenberg-Marquardt), known and unknown map.

The batch's unknowns are the poses of every robot whenever it sees or is seen, and the landmarks; sightings weigh as Cauchy has it, at the filter's
own threshold. It begins at the filter's paths, so that it finds the nearest minimum and not another. It has no correction factor: beside it stands
the filter without one, too.
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
from tracker.formats.utias import Team, read_team
from tracker.planar_slam.event_schedule import FilterInput, PlanarParameters, filter_input
from tracker.planar_slam.filter import MARK, SCAN, STEP
from tracker.planar_slam.motion_model import Sensors
from tracker.planar_slam.trajectories import Paths, score_paths
from tracker.planar_slam.utias_run import track_utias

Array = NDArray[np.float64]

SETS = (1, 6)
SURE = 1e-3
"""m, rad: how well starts and a known map are known."""
LEAST = 1e-5
"""m, rad: no step of odometry is surer."""


@dataclass(eq=False)
class Chain:
    """A robot's poses in order: times s; steps (3,) and their covariances (3, 3) from each to the next; and what it has done since the last one."""

    times: list[float]
    steps: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    since: Array = field(default_factory=lambda: np.zeros(3))
    doubt: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def node(self, moment: float) -> int:
        """The number of the pose at this moment; a robot that stood still is where it was."""
        if self.doubt.any():
            self.steps.append(self.since)
            self.covariances.append(self.doubt + np.eye(3) * LEAST**2)
            self.times.append(moment)
            self.since, self.doubt = np.zeros(3), np.zeros((3, 3))
        return len(self.times) - 1


@dataclass(eq=False)
class Problem:
    """What a batch solves: a chain a robot; sightings as robot, its pose, subject, the subject's pose (−1 for a landmark), range m, bearing rad and
    their deviations; and of every mark and robot the last pose before it and the way since then.
    """

    chains: list[Chain]
    sightings: list[tuple[int, int, int, int, Array, Array]]
    last: NDArray[np.intp]
    since: Array


@njit(cache=True)
def moved(since: Array, doubt: Array, motion: Array, noise: Array) -> tuple[Array, Array]:
    """A pose (3,) and its covariance in the right tangent after one more arc, as planar.predict has it."""
    bend = 0.5 * motion[1]
    chord = motion[0] * (np.sin(bend) / bend if abs(bend) > 1e-9 else 1.0)
    c, s = np.cos(since[2] + bend), np.sin(since[2] + bend)
    there = np.array([since[0] + chord * c, since[1] + chord * s, since[2] + motion[1]])
    c, s = np.cos(motion[1]), np.sin(motion[1])
    x, y = chord * np.cos(bend), chord * np.sin(bend)
    F = np.array([[c, s, s * x - c * y], [-s, c, c * x + s * y], [0.0, 0.0, 1.0]])
    c, s = np.cos(bend), np.sin(bend)
    G = np.array([[c, s, 0.5 * chord * s], [-s, c, 0.5 * chord * c], [0.0, 0.0, 1.0]])
    return there, F @ doubt @ F.T + (G * noise[:3]) @ G.T


def problem(out: FilterInput) -> Problem:
    """From the filter's own events."""
    course, robots = out.course, len(out.robots)
    chains = [Chain([float(out.times[0])]) for _ in range(robots)]
    sightings, mark = [], 0
    last, since = np.zeros((course.marks, robots), dtype=np.intp), np.zeros((course.marks, robots, 3))
    for kind, robot, item, moment in zip(course.kind, course.robot, course.item, course.time, strict=True):
        chain = chains[robot]
        if kind == STEP:
            chain.since, chain.doubt = moved(chain.since, chain.doubt, course.motion[item], course.noise[item])
        elif kind == SCAN:
            for row in range(course.start[item], course.start[item + 1]):
                subject = int(course.subject[row])
                other = chains[subject].node(moment) if subject < robots else -1
                sightings.append((int(robot), chain.node(moment), subject, other, course.z[row], course.sigma[row]))
        elif kind == MARK:
            last[mark] = [len(c.times) - 1 for c in chains]
            since[mark] = [c.since for c in chains]
            mark += 1
    return Problem(chains, sightings, last, since)


def solved(out: FilterInput, start: Paths, known_map: bool, threshold: float) -> Paths:
    """The batch's paths and map."""
    import gtsam

    task, robots = problem(out), len(out.robots)
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
        graph.add(gtsam.PriorFactorPose2(pose(i, 0), first, gtsam.noiseModel.Isotropic.Sigma(3, SURE)))
        for k, (step, P) in enumerate(zip(chain.steps, chain.covariances, strict=True)):
            noise = gtsam.noiseModel.Gaussian.Covariance(P)
            graph.add(gtsam.BetweenFactorPose2(pose(i, k), pose(i, k + 1), gtsam.Pose2(*step), noise))
    for k, subject in enumerate(out.subjects):
        if known_map or subject in start.landmarks:
            place = out.state.mean[8 * robots + 2 * k : 8 * robots + 2 * k + 2] if known_map else start.landmarks[subject]
            values.insert(landmark(k), place)
            if known_map:
                graph.add(gtsam.PriorFactorPoint2(landmark(k), place, gtsam.noiseModel.Isotropic.Sigma(2, SURE)))
    cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(threshold)
    for robot, k, subject, other, z, sigma in task.sightings:
        noise = gtsam.noiseModel.Robust.Create(cauchy, gtsam.noiseModel.Diagonal.Sigmas(sigma[::-1].copy()))
        seen = (pose(robot, k), pose(subject, other) if other >= 0 else landmark(subject - robots), gtsam.Rot2(z[1]), z[0], noise)
        graph.add(gtsam.BearingRangeFactorPose2(*seen) if other >= 0 else gtsam.BearingRangeFactor2D(*seen))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    poses = {n: _path(task, i, np.array([_row(found.atPose2(pose(i, k))) for k in range(len(c.times))]), out.times)
             for i, (n, c) in enumerate(zip(out.robots, task.chains, strict=True))}  # fmt: skip
    places = {s: found.atPoint2(landmark(k)) for k, s in enumerate(out.subjects) if values.exists(landmark(k))}
    return Paths(out.times, poses, {n: np.tile(np.eye(3), (len(out.times), 1, 1)) for n in poses}, places, {})


def _row(pose) -> list[float]:  # type: ignore[no-untyped-def]
    return [pose.x(), pose.y(), pose.theta()]


def _path(task: Problem, robot: int, nodes: Array, times: Array) -> Array:
    """Poses (n, 3) at all marks: from the last pose on by odometry, and of what is then amiss at the next one the share of the time."""
    chain, last = task.chains[robot], task.last[:, robot]
    when = np.array(chain.times)
    gap = np.zeros((len(nodes), 3))
    if chain.steps:
        gap[:-1] = _seen_from(_onward(nodes[:-1], np.array(chain.steps)), nodes[1:])
    until = np.append(np.diff(when), np.inf)
    share = np.clip((times - when[last]) / until[last], 0.0, 1.0)[:, None]
    return _onward(_onward(nodes[last], task.since[:, robot]), share * gap[last])


def _onward(poses: Array, steps: Array) -> Array:
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, turn = steps.T
    return np.stack([poses[:, 0] + c * x - s * y, poses[:, 1] + s * x + c * y, poses[:, 2] + turn], axis=1)


def _seen_from(poses: Array, others: Array) -> Array:
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    d = others - poses
    turn = (d[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], turn], axis=1)


def compared(team: Team, source: Path, known_map: bool) -> list[tuple[str, dict[str, float | None], float]]:
    """Name, scores and seconds of processor time of the filter, of the filter without correction factors, and of the batch."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, parameters in (("filter (default)", PlanarParameters()), ("filter without correction factor", PlanarParameters(correction=False))):
            began = time.process_time()
            paths = track_utias(source, Path(folder) / name, known_map, parameters)
            rows.append((name, score_paths(team, paths), time.process_time() - began))
    began = time.process_time()
    batch = solved(filter_input(team, Sensors(), known_map, False), paths, known_map, parameters.robust)
    return [*rows, ("batch (GTSAM)", score_paths(team, batch), time.process_time() - began)]


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
        team = read_team(source)
        for known_map in (True, False):
            for name, scores, seconds in compared(team, source, known_map):
                cells = ["–" if (v := scores[m]) is None else f"{v:.3f}" for m in ("ate_m", "ate_aligned_m", "map_m")]
                print(f"| {number}, {'known' if known_map else 'unknown'} | {name} | {' | '.join(cells)} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()
