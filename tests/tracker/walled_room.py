"""A simulated room without images: robots drive in circles on uneven ground among landmarks on walls and floor, with exact truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Pose, exp_so3, rotation_z, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.types import Detections, Mount, Odometry, Setup, Sightings, Start, Tick, View

SIZE = np.array([14.0, 11.0, 2.5])


@dataclass(frozen=True)
class Room:
    """Parameters of the simulation.

    sigma: standard deviation of a bearing, rad per axis. slip: standard deviation of a step's translation over its length.
    turn: standard deviation of a step's rotation, rad. tilt: true rotation of the camera in the body about x and y, rad.
    miss: probability of a missed sighting. wrong: share of outliers. descriptor_noise: relative noise of descriptors.
    named: sightings hold the id of the landmark.
    """

    seed: int = 0
    robots: int = 4
    ticks: int = 120
    landmarks: int = 220
    period: float = 1 / 6
    speed: float = 0.5
    sigma: float = 0.0021
    slip: float = 0.08
    turn: float = 0.008
    tilt: tuple[float, float] = (0.0, 0.0)
    miss: float = 0.3
    wrong: float = 0.0
    named: bool = False
    descriptor_noise: float = 0.25


def landmarks(room: Room, rng: np.random.Generator) -> np.ndarray:
    """Positions (n, 3) m: four fifths on the walls, one fifth on the floor."""
    u = rng.uniform(size=(room.landmarks, 3)) * SIZE
    wall = rng.integers(0, 5, room.landmarks)
    u[wall == 0, 0], u[wall == 1, 0] = 0, SIZE[0]
    u[wall == 2, 1], u[wall == 3, 1] = 0, SIZE[1]
    u[wall == 4, 2] = 0
    return u


def path(room: Room, robot: int) -> list[Pose]:
    """Poses on an ellipse around the middle of the room; roll, pitch and height depend on the position."""
    phase, rate = 2 * np.pi * robot / room.robots + 0.3, room.speed / 3.0 * (1 if robot % 2 == 0 else -1)
    out = []
    for k in range(room.ticks + 1):
        a = phase + rate * k * room.period
        p = np.array([7 + (3.6 + 0.3 * robot) * np.cos(a), 5.5 + (2.6 + 0.2 * robot) * np.sin(a)])
        yaw = np.arctan2((2.6 + 0.2 * robot) * np.cos(a) * np.sign(rate), -(3.6 + 0.3 * robot) * np.sin(a) * np.sign(rate))
        tilt = 0.08 * np.array([np.sin(2.1 * p[0] + robot), np.cos(1.7 * p[1]), 0.0])
        out.append(Pose(rotation_z(yaw) @ exp_so3(tilt), np.array([*p, 0.15 + 0.05 * np.sin(p[0] * 2) * np.cos(p[1])])))
    return out


def simulate(room: Room) -> tuple[Setup, list[Tick], list[dict[str, Pose]], np.ndarray]:
    """Setup, ticks, true poses (for each tick, robot → pose), and true landmarks (n, 3) m."""
    rng = np.random.default_rng(room.seed)
    points = landmarks(room, rng)
    descriptors = rng.normal(size=(room.landmarks, 128))
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    names = [f"r{i}" for i in range(room.robots)]
    paths = [path(room, i) for i in range(room.robots)]
    start = np.diag([0.02, 0.02, 0.02, 0.017, 0.017, 0.017]) ** 2
    T_body_camera = Pose(np.eye(3), np.array([0.1, 0.0, 0.4]))
    offset = exp_so3([*room.tilt, 0.0])
    mounts = {f"c{i}": Mount(Panorama(1024, 512), T_body_camera, n) for i, n in enumerate(names)}
    starts = {n: Start(paths[i][0] @ Pose.exp(rng.multivariate_normal(np.zeros(6), start)), start) for i, n in enumerate(names)}
    setup = Setup(mounts, Flat(0.0), dict(starts), room.period)
    ticks = []
    for k in range(1, room.ticks + 1):
        views = []
        for i in range(room.robots):
            odometry = _odometry(room, paths[i][k - 1], paths[i][k], rng)
            camera = paths[i][k] @ T_body_camera @ Pose(offset, np.zeros(3))
            views.append(View(f"c{i}", Detections.none(), _sightings(room, camera, points, descriptors, rng), odometry))
        ticks.append(Tick(k, k * room.period, tuple(views)))
    return setup, ticks, [{n: paths[i][k] for i, n in enumerate(names)} for k in range(1, room.ticks + 1)], points


def _odometry(room: Room, before: Pose, now: Pose, rng: np.random.Generator) -> Odometry:
    motion = before.inverse() @ now
    step = max(float(np.linalg.norm(motion.translation)), 0.01)
    sigma = np.array([room.slip * step, 0.3 * room.slip * step, 0.3 * room.slip * step, 0.4 * room.turn, 0.4 * room.turn, room.turn])
    noisy = motion @ Pose.exp(sigma * rng.normal(size=6))
    up = now.rotation[2] + 0.01 * rng.normal(size=3)
    return Odometry(noisy, np.diag(sigma**2), up / np.linalg.norm(up), 0.01)


def _sightings(room: Room, camera: Pose, points: np.ndarray, descriptors: np.ndarray, rng: np.random.Generator) -> Sightings:
    subject = np.flatnonzero(rng.uniform(size=len(points)) >= room.miss)
    b = camera.inverse().apply(points[subject])
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    n = len(subject)
    noise = (rng.normal(size=(n, 1, 2)) * room.sigma) @ tangent_basis(b)
    wrong = rng.uniform(size=n) < room.wrong
    noise[wrong] = (rng.normal(size=(int(wrong.sum()), 1, 2)) * 0.03) @ tangent_basis(b[wrong])
    b = b + noise[:, 0]
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    descriptor = descriptors[subject] + room.descriptor_noise / np.sqrt(128) * rng.normal(size=(n, 128))
    covariance = np.tile(np.eye(2) * room.sigma**2, (n, 1, 1))
    return Sightings(b, np.full(n, np.nan), subject if room.named else np.full(n, -1), descriptor.astype(np.float32), covariance)


def dead_reckoning(setup: Setup, ticks: list[Tick]) -> list[dict[str, Pose]]:
    """For each tick, robot → pose from odometry alone."""
    pose = {n: s.T_world_robot for n, s in setup.starts.items() if s is not None}
    out = []
    for tick in ticks:
        for view in tick.views:
            if view.odometry is not None:
                name = setup.mounts[view.camera].robot
                pose[name] = pose[name] @ view.odometry.T_before_now
        out.append(dict(pose))
    return out


def ate(estimate: list[dict[str, Pose]], truth: list[dict[str, Pose]]) -> float:
    """The RMSE of position without alignment, m, averaged over robots."""
    square = np.array([[((e[n].translation - t[n].translation) ** 2).sum() for n in t] for e, t in zip(estimate, truth, strict=True)])
    return float(np.sqrt(square.mean(axis=0)).mean())
