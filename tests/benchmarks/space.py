"""The SLAM filter of the team from panoramic bearings, compared with the posterior Cramér-Rao bound: all modes, as in benchmarks/slam.py.

Two robots drive one and a half laps of a circle of 4 m on bumps, in opposite directions, at 1 m/s, among 40 landmarks with known identities. Each
robot sees the directions of landmarks within 6 m, and "up" to 0.01 rad. The noise of odometry is that of benchmarks/slam.py. Errors count from 10 s
on, and NEES is that of the whole pose.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from tests.benchmarks.slam import HEAD, Row, show
from tracker.ekf.gaussian import nees
from tracker.geometry import Pose, exp_so3, perturbed_bearings, rotation_z
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.cramer_rao import BoundFrame, position_variances
from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters
from tracker.types import Detections, Mount, Odometry, Setup, Sightings, Start, Tick, View

Array = NDArray[np.float64]

RADIUS, SPEED, LAPS, PERIOD, ROBOTS, LANDMARKS, SIGHT = 4.0, 1.0, 1.5, 0.5, 2, 40, 6.0
LEVELS = {"0.1°": (0.1, 0.1, 0.02), "0.25°": (0.25, 0.1, 0.06), "0.5°": (0.5, 0.2, 0.10)}
"""Noise of bearings (° an axis), forward speed (m/s) and yaw rate (rad/s). The other axes have a third of it."""
OFFSET = 0.02
"""Rotation of cameras about x and y, rad, in runs with offsets. The signs are random."""
UP = 0.01
START = np.array([0.02, 0.02, 0.02, 0.017, 0.017, 0.017])
T_BODY_CAMERA = Pose(np.eye(3), np.array([0.1, 0.0, 0.4]))
SETTLED = 20  # ticks: 10 s


@dataclass(frozen=True, eq=False)
class Drive:
    """A run: setup and ticks for the filter, true poses by tick and robot with the start first, and landmarks (n, 3) m."""

    setup: Setup
    ticks: list[Tick]
    truth: list[list[Pose]]
    landmarks: Array


def true_path(robot: int) -> list[Pose]:
    """The true poses of a robot. Roll, pitch and height are functions of the position."""
    out, sign = [], 1 if robot % 2 == 0 else -1
    for k in range(round(LAPS * 2 * np.pi * RADIUS / SPEED / PERIOD) + 1):
        a = sign * k * SPEED * PERIOD / RADIUS + 2 * np.pi * robot / ROBOTS
        p = RADIUS * np.array([np.cos(a), np.sin(a)])
        lean = 0.08 * np.array([np.sin(2.1 * p[0]), np.cos(1.7 * p[1]), 0.0])
        rotation = rotation_z(a + sign * np.pi / 2) @ exp_so3(lean)
        out.append(Pose(rotation, np.array([*p, 0.15 + 0.05 * np.sin(2 * p[0]) * np.cos(p[1])])))
    return out


def drive(level: str, offset: bool, seed: int) -> Drive:
    """One seeded run."""
    rng = np.random.default_rng(seed)
    radius = np.sqrt(rng.uniform((RADIUS - 3) ** 2, (RADIUS + 3) ** 2, LANDMARKS))
    around = rng.uniform(-np.pi, np.pi, LANDMARKS)
    landmarks = np.stack([radius * np.cos(around), radius * np.sin(around), rng.uniform(0.3, 3.0, LANDMARKS)], axis=1)
    paths = [true_path(i) for i in range(ROBOTS)]
    offsets = [Pose(exp_so3([*(OFFSET * rng.choice([-1, 1], 2) * offset), 0.0]), np.zeros(3)) for _ in paths]
    mounts = {f"c{i}": Mount(Panorama(1024, 512), T_BODY_CAMERA, f"r{i}") for i in range(ROBOTS)}
    starts = {f"r{i}": Start(path[0] @ Pose.exp(START * rng.normal(size=6)), np.diag(START**2)) for i, path in enumerate(paths)}
    ticks = []
    for k in range(1, len(paths[0])):
        views = []
        for i, path in enumerate(paths):
            camera = path[k] @ T_BODY_CAMERA @ offsets[i]
            odometry = _odometry(level, path[k - 1], path[k], rng)
            views.append(View(f"c{i}", Detections.none(), _sightings(level, camera, landmarks, rng), odometry))
        ticks.append(Tick(k, k * PERIOD, tuple(views)))
    return Drive(Setup(mounts, Flat(0.0), dict(starts), PERIOD), ticks, [list(poses) for poses in zip(*paths, strict=True)], landmarks)


def _odometry(level: str, before: Pose, now: Pose, rng: np.random.Generator) -> Odometry:
    _, speed, turn = LEVELS[level]
    sigma = PERIOD * np.array([speed, speed / 3, speed / 3, turn / 3, turn / 3, turn])
    up = exp_so3(np.append(UP * rng.normal(size=2), 0.0)) @ now.rotation[2]
    return Odometry(before.inverse() @ now @ Pose.exp(sigma * rng.normal(size=6)), np.diag(sigma**2), up, UP)


def _sightings(level: str, camera: Pose, landmarks: Array, rng: np.random.Generator) -> Sightings:
    sigma, points = np.deg2rad(LEVELS[level][0]), camera.inverse().apply(landmarks)
    distance = np.linalg.norm(points, axis=1)
    subject = np.flatnonzero(distance < SIGHT)
    bearing, n = points[subject] / distance[subject, None], len(subject)
    bearing = perturbed_bearings(bearing, sigma * rng.normal(size=(n, 2)))
    return Sightings(bearing, np.full(n, np.nan), subject, np.zeros((n, 0)), np.tile(np.eye(2) * sigma**2, (n, 1, 1)))


def bound(run: Drive, correction: tuple[float, float, float] | None) -> float:
    """Mean variance of position of the bound, m². All sightings count from the first one on, and landmarks have no prior."""
    names = list(run.setup.starts)
    frames = [BoundFrame(dict(zip(names, run.truth[0], strict=True)), {}, {})]
    for tick, poses in zip(run.ticks, run.truth[1:], strict=True):
        moved = {name: view.odometry for name, view in zip(names, tick.views, strict=True) if view.odometry is not None}
        seen = {view.camera: (view.sightings.subject, view.sightings.covariance) for view in tick.views if view.sightings is not None}
        frames.append(BoundFrame(dict(zip(names, poses, strict=True)), moved, seen))
    return float(position_variances(run.setup, frames, dict(enumerate(run.landmarks)), correction)[1 + SETTLED :].mean())


def estimate(run: Drive, parameters: SlamParameters) -> tuple[float, float]:
    """Mean squared error of position, m², and mean NEES per degree of freedom. Raises ValueError where the filter diverges."""
    slam, square, consistency = Slam(run.setup, parameters), [], []
    for tick, true in zip(run.ticks, run.truth[1:], strict=True):
        slam.step(tick)
        if tick.index > SETTLED:
            xi = [(slam.pose(f"r{i}").inverse() @ pose).log() for i, pose in enumerate(true)]
            square.append(np.mean([((slam.pose(f"r{i}").translation - pose.translation) ** 2).sum() for i, pose in enumerate(true)]))
            consistency.append(np.mean([nees(e, slam.covariance(f"r{i}")) for i, e in enumerate(xi)]))
    return float(np.mean(square)), float(np.mean(consistency))


def modes() -> dict[str, SlamParameters]:
    """Parameters of all modes. Errors are independent and offsets constant here, and the parameters say so; all others are defaults."""
    own = SlamParameters(gravity_correlation_time=0.0, rotation_correlation_time=0.0, correction_sigma=(OFFSET, OFFSET, 0.004), correction_walk=0.0)
    table = {
        "EKF": replace(own, mode="iekf", iterations=1, robust=np.inf),
        "EKF, 2 iterations": replace(own, mode="iekf", robust=np.inf),
        "EKF, 5 iterations": replace(own, mode="iekf", iterations=5, robust=np.inf),
        "first estimates, plain": replace(own, robust=np.inf),
        "first estimates (default)": own,
    }
    return {f"{name}, {'on' if on else 'off'}": replace(p, correction=on) for name, p in table.items() for on in (False, True)}


def run_seed(level: str, offset: bool, seed: int) -> dict[str, tuple[float, float, float]]:
    """Square, NEES and bound of each mode in the same run, NaN where it diverged."""
    run, out, bounds = drive(level, offset, seed), dict[str, tuple[float, float, float]](), dict[bool, float]()
    for name, parameters in modes().items():
        if parameters.correction not in bounds:
            bounds[parameters.correction] = bound(run, parameters.correction_sigma if parameters.correction else None)
        try:
            out[name] = *estimate(run, parameters), bounds[parameters.correction]
        except ValueError:
            out[name] = (np.nan, np.nan, np.nan)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_known_args()[0]
    for offset in (False, True):
        print(f"\n{'With' if offset else 'Without'} true offsets of ±{OFFSET} rad, {options.runs} runs\n\n{HEAD}")
        for level in LEVELS:
            runs = Parallel(n_jobs=options.workers)(delayed(run_seed)(level, offset, seed) for seed in range(options.runs))
            show(level, {name: Row.of([run[name] for run in runs]) for name in modes()})


if __name__ == "__main__":
    main()
