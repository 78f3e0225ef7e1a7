"""The planar filter's run over what happens to a team, and how a UTIAS set becomes such a course."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.formats.utias import Robot, Team
from tracker.geometry import Array
from tracker.planar_slam.filter import EVENT, MARK, MODES, ROBOT, SCAN, STEP, EventSchedule, FilterSettings, PlanarState, run
from tracker.planar_slam.motion_model import Sensors, integrate, sighting_sigma, step_noise

GRID = 0.02  # s between two poses that are told


@dataclass(frozen=True)
class PlanarParameters:
    """mode: ekf, iekf, fej or invariant; iterations: linearisations of an update (of ekf: one); correction: estimate a correction factor a robot.

    robust: a residual beyond so many standard deviations loses weight (inf: none does); curved: share of the noise for the bend of the
    measurement (planar.blurred); reopen: so many bad sightings of a robot more than good ones of late, and its pose is doubted by doubt (m, rad).
    """

    mode: str = "invariant"
    iterations: int = 2
    correction: bool = True
    robust: float = 3.0
    curved: float = 1.0
    reopen: int = 12
    doubt: tuple[float, float] = (0.2, 0.1)

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ValueError(f"mode is {self.mode!r}, needs one of {', '.join(MODES)}")
        for name, least in (("iterations", 1), ("reopen", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, needs at least {least}")
        if not self.robust > 0:
            raise ValueError(f"robust is {self.robust}, needs more than 0")

    def rule(self) -> FilterSettings:
        """For the kernels."""
        iterations = 1 if self.mode == "ekf" else self.iterations
        return FilterSettings(MODES[self.mode], iterations, self.robust, self.curved, self.reopen, self.doubt, np.zeros((0, 2)))


def run_filter(s: PlanarState, rule: FilterSettings, course: EventSchedule) -> tuple[Array, Array]:
    """Run the filter; s is changed. The poses (marks, robots, 3) m, m, rad and covariances (marks, robots, 3, 3) that it believed at the marks.

    Raises ValueError with time, robot and what it believed where the filter diverges (a number is no longer finite).
    """
    path, spread = np.zeros((course.marks, len(s.streak), 3)), np.zeros((course.marks, len(s.streak), 3, 3))
    try:
        whole = run(s, rule, course, (path, spread))
    except np.linalg.LinAlgError:
        whole = False
    if not whole:
        event = s.tally[EVENT]
        robot = int(course.robot[event])
        pose, doubt = s.mean[ROBOT * robot : ROBOT * robot + 3], s.P[ROBOT * robot, ROBOT * robot]
        raise ValueError(f"the filter diverged at {course.time[event]:.3f} s: robot {robot} is at {pose.tolist()}, variance {doubt:.3g} m²")
    return path, spread


def state(start: Array, covariance: Array, landmarks: int) -> PlanarState:
    """Robots (r, 8) with their covariances (r, 8, 8), strangers to each other, and room for landmarks. Raises ValueError for what is none."""
    robots = len(start)
    if start.shape != (robots, ROBOT) or covariance.shape != (robots, ROBOT, ROBOT):
        raise ValueError(f"start has shape {start.shape} and covariance {covariance.shape}, needs (r, {ROBOT}) and (r, {ROBOT}, {ROBOT})")
    n = ROBOT * robots + 2 * landmarks
    mean, P = np.zeros(n), np.zeros((n, n))
    for i in range(robots):
        at = slice(ROBOT * i, ROBOT * (i + 1))
        low = float(np.linalg.eigvalsh(covariance[i])[0]) if np.isfinite(covariance[i]).all() else float("nan")
        if not low > -1e-12:
            raise ValueError(f"covariance of robot {i} has an eigenvalue of {low:.3g}, needs at least 0")
        mean[at], P[at, at] = start[i], covariance[i]
    return PlanarState(mean, P, mean.copy(), np.zeros(landmarks, dtype=np.bool_), np.zeros(robots, dtype=np.int64), np.zeros(5, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class FilterInput:
    """A set as the filter takes it: robots' numbers, times (marks,) s of the grid, course and the state at the start; subjects of the landmarks in
    the order of the state; unused: sightings that were left out, by reason, and
    gaps of the odometry.
    """

    robots: tuple[int, ...]
    times: Array
    course: EventSchedule
    state: PlanarState
    subjects: tuple[int, ...]
    unused: dict[str, int]


def filter_input(team: Team, sensors: Sensors, known_map: bool, correction: bool) -> FilterInput:
    """Each robot starts where its first truth says it was; with a known map the landmarks are told, else they are found."""
    robots, subjects = tuple(team.robots), tuple(team.landmarks)
    begin = np.array([robot.truth[0, 0] for robot in team.robots.values()])
    first = max(begin.max(), min(robot.odometry[0, 0] for robot in team.robots.values()))
    last = min(robot.odometry[-1, 0] for robot in team.robots.values())
    if last <= first:
        raise ValueError(f"odometry ends at {last:.3f} s, needs to go on after {first:.3f} s, when the last robot's start is known")
    times: Array = np.array(np.round(np.arange(first, last, GRID), 3), dtype=np.float64)
    sights = [_sights(team, i, sensors, begin) for i in range(len(robots))]
    z, meta = np.concatenate([s[0] for s in sights]), np.concatenate([s[1] for s in sights])
    late = z[:, 0] > times[-1]
    z, meta = z[~late], meta[~late]
    s = _start(team, sensors, correction, known_map)
    unused = {"before the start": sum(s[2] for s in sights), "after the end": int(late.sum())}
    # In a gap of the commands a robot counts as standing still (unicycle.travelled).
    unused["odometry gap"] = sum(int((np.diff(robot.odometry[:, 0]) > sensors.hold).sum()) for robot in team.robots.values())
    for robot in team.robots.values():
        for reason, count in robot.rejected.items():
            unused[reason] = unused.get(reason, 0) + count
    return FilterInput(robots, times, _course(team, sensors, times, (z, meta)), s, subjects, {k: n for k, n in unused.items() if n})


def _sights(team: Team, i: int, sensors: Sensors, begin: Array) -> tuple[Array, NDArray[np.int64], int]:
    """Of robot i: time s, range, bearing and their deviations (m, 5); robot and subject in the state's count (m, 2); how many came too early."""
    robots = list(team.robots)
    place = {subject: k for k, subject in enumerate([*robots, *team.landmarks])}
    robot: Robot = team.robots[robots[i]]
    subject = np.array([place[s] for s in robot.subject.tolist()], dtype=np.int64)
    seen, other = robot.seen.copy(), subject < len(robots)
    seen[:, 0] -= sensors.camera_delay
    seen[other, 1] -= sensors.robot_range
    rows = np.concatenate([seen, sighting_sigma(robot.seen, subject, other, sensors)], axis=1)
    both = np.maximum(begin[i], np.where(other, begin[np.minimum(subject, len(robots) - 1)], -np.inf))
    good = rows[:, 0] >= both
    return rows[good], np.stack([np.full(len(subject), i), subject], axis=1)[good], int((~good).sum())


def _start(team: Team, sensors: Sensors, correction: bool, known_map: bool) -> PlanarState:
    n = len(team.robots)
    start, covariance = np.zeros((n, ROBOT)), np.zeros((n, ROBOT, ROBOT))
    for i, robot in enumerate(team.robots.values()):
        start[i, :3] = robot.truth[0, 1:]
        sigma = np.array([1e-3, 1e-3, 1e-3, *(sensors.offsets if correction else (0.0,) * 3), *sensors.scales])
        covariance[i] = np.diag(sigma**2)
    s = state(start, covariance, len(team.landmarks))
    if known_map:
        at = np.arange(ROBOT * n, len(s.mean))
        s.mean[at] = s.first[at] = np.concatenate(list(team.landmarks.values()))
        s.P[at, at] = 1e-3**2
        s.known[:] = True
    return s


def _course(team: Team, sensors: Sensors, times: Array, sights: tuple[Array, NDArray[np.int64]]) -> EventSchedule:
    """Steps of all robots up to each mark and to each scan they take part in, in the order of time; scans before marks."""
    rows, meta = sights
    order = np.lexsort((meta[:, 0], rows[:, 0]))
    rows, meta = rows[order], meta[order]
    fresh = np.ones(len(rows), dtype=bool)
    fresh[1:] = (np.diff(rows[:, 0]) > 0) | (np.diff(meta[:, 0]) != 0)
    start = np.append(np.flatnonzero(fresh), len(rows)).astype(np.int64)
    moves = []
    for i, robot in enumerate(team.robots.values()):
        there = rows[(meta == i).any(axis=1), 0]
        t = np.unique(np.concatenate([[robot.truth[0, 0]], times, there]))
        steps = np.diff(integrate(robot.odometry, sensors, t), axis=0)
        moves.append((t[1:], np.full(len(steps), i), steps, step_noise(steps, np.diff(t), sensors)))
    time, who, steps, noise = (np.concatenate(part) for part in zip(*moves, strict=True))
    kind = np.concatenate([np.full(len(time), STEP), np.full(len(start) - 1, SCAN), np.full(len(times), MARK)])
    when = np.concatenate([time, rows[start[:-1], 0], times])
    robot_of = np.concatenate([who, meta[start[:-1], 0], np.zeros(len(times), dtype=np.int64)])
    item = np.concatenate([np.arange(len(time)), np.arange(len(start) - 1), np.arange(len(times))])
    order = np.lexsort((kind, when))
    moved = np.ascontiguousarray(steps[:, :2])
    z, sigma = np.ascontiguousarray(rows[:, 1:3]), np.ascontiguousarray(rows[:, 3:])
    subject = np.ascontiguousarray(meta[:, 1])
    return EventSchedule(kind[order], robot_of[order], item[order], moved, noise, start, subject, z, sigma, when[order], len(times))
