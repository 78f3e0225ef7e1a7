"""The schedule of events that the planar filter processes, its construction from a UTIAS data set, and the filter's run over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from tracker.planar_slam.filter import EVENT, MODES, OUTPUT, ROBOT, SCAN, STEP, EventSchedule, FilterSettings, PlanarState, run_events
from tracker.planar_slam.motion_model import Sensors, integrate, sighting_sigma, step_noise
from tracker.planar_slam.utias_files import LONG_GAP, UtiasDataset, UtiasRobot

GRID = 0.02  # s between output times
MAX_SECONDS = 6 * 3600.0
"""s: the poses of two robots then take 1 GiB. The longest UTIAS set has less than 2 h."""
MAX_LINES = 5
"""Most gaps that are reported by a line each."""


@dataclass(frozen=True)
class PlanarParameters:
    """Parameters of the planar filter.

    mode: ekf, iekf, fej or invariant. iterations: linearisations of an update (of ekf: one). correction: estimate a correction factor per robot.
    robust: standard deviations of a residual beyond which it loses weight (inf: none does). curvature: share of the second-order noise
    (filter.inflated_sigma). max_outlier_excess: recent outliers of a robot in excess of inliers at which its pose covariance is inflated by
    inflation_sigma (m, rad).
    """

    mode: str = "invariant"
    iterations: int = 2
    correction: bool = True
    robust: float = 3.0
    curvature: float = 1.0
    max_outlier_excess: int = 12
    inflation_sigma: tuple[float, float] = (0.2, 0.1)

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ValueError(f"mode is {self.mode!r}, needs one of {', '.join(MODES)}")
        for name, least in (("iterations", 1), ("max_outlier_excess", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, needs at least {least}")
        if not self.robust > 0:
            raise ValueError(f"robust is {self.robust}, needs more than 0")

    def settings(self) -> FilterSettings:
        """The same parameters for the compiled functions."""
        iterations = 1 if self.mode == "ekf" else self.iterations
        return FilterSettings(
            MODES[self.mode], iterations, self.robust, self.curvature, self.max_outlier_excess, self.inflation_sigma, np.zeros((0, 2))
        )


def run_filter(s: PlanarState, settings: FilterSettings, schedule: EventSchedule) -> tuple[Array, Array]:
    """Run the filter; `s` is changed. Returns poses (outputs, robots, 3) m, m, rad and covariances (outputs, robots, 3, 3) at the output times.

    Raises ValueError with time, robot and its estimate if the filter diverges (a number is not finite).
    """
    path, spread = np.zeros((schedule.outputs, len(s.outlier_excess), 3)), np.zeros((schedule.outputs, len(s.outlier_excess), 3, 3))
    try:
        finite = run_events(s, settings, schedule, (path, spread))
    except np.linalg.LinAlgError:
        finite = False
    if not finite:
        event = s.counts[EVENT]
        robot = int(schedule.robot[event])
        pose, inflation_sigma = s.mean[ROBOT * robot : ROBOT * robot + 3], s.P[ROBOT * robot, ROBOT * robot]
        raise ValueError(
            f"the filter diverged at {schedule.time[event]:.3f} s: robot {robot} is at {pose.tolist()}, variance {inflation_sigma:.3g} m²"
        )
    return path, spread


def initial_state(start: Array, covariance: Array, landmarks: int) -> PlanarState:
    """The state of robots (r, 8) with covariances (r, 8, 8), mutually uncorrelated, and room for landmarks."""
    robots = len(start)
    n = ROBOT * robots + 2 * landmarks
    mean, P = np.zeros(n), np.zeros((n, n))
    for i in range(robots):
        at = slice(ROBOT * i, ROBOT * (i + 1))
        mean[at], P[at, at] = start[i], covariance[i]
    return PlanarState(mean, P, mean.copy(), np.zeros(landmarks, dtype=np.bool_), np.zeros(robots, dtype=np.int64), np.zeros(5, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class FilterInput:
    """A data set as input of the filter.

    robots: their numbers. times (outputs,) s: the output times. subjects: the landmarks in the order of the state. unused: numbers of
    measurements that are left out, by reason, and of gaps in the odometry. left_out: a line on each interval without output times.
    """

    robots: tuple[int, ...]
    times: Array
    schedule: EventSchedule
    state: PlanarState
    subjects: tuple[int, ...]
    unused: dict[str, int]
    left_out: tuple[str, ...] = ()


def filter_input(team: UtiasDataset, sensors: Sensors, known_map: bool, correction: bool) -> FilterInput:
    """Schedule and initial state for a data set. Each robot starts at its first true pose; with a known map the landmarks are given.

    There are no output times in gaps of more than LONG_GAP without odometry of any robot.
    Raises ValueError if the odometry ends before the last start, has only gaps, or covers more than MAX_SECONDS, and for a known map without
    landmarks.
    """
    if known_map and not team.landmarks:
        raise ValueError("the set has no landmarks, which a known map needs")
    robots, subjects = tuple(team.robots), tuple(team.landmarks)
    begin = np.array([robot.truth[0, 0] for robot in team.robots.values()])
    first = max(begin.max(), min(robot.odometry[0, 0] for robot in team.robots.values()))
    last = min(robot.odometry[-1, 0] for robot in team.robots.values())
    if last <= first:
        raise ValueError(f"odometry ends at {last:.3f} s, needs to go on after {first:.3f} s, when the last robot's start is known")
    times, left_out = _output_times(team, first, last)
    measurements = [_measurements(team, i, sensors, begin) for i in range(len(robots))]
    z, meta = np.concatenate([s[0] for s in measurements]), np.concatenate([s[1] for s in measurements])
    late = z[:, 0] > times[-1]
    z, meta = z[~late], meta[~late]
    s = _initial_state(team, sensors, correction, known_map)
    unused = {"before the start": sum(s[2] for s in measurements), "after the end": int(late.sum())}
    # In a gap of the commands a robot counts as standing still (motion_model.integrate).
    unused["odometry gap"] = sum(int((np.diff(robot.odometry[:, 0]) > sensors.command_timeout).sum()) for robot in team.robots.values())
    for robot in team.robots.values():
        for reason, count in robot.rejected.items():
            unused[reason] = unused.get(reason, 0) + count
    return FilterInput(robots, times, _schedule(team, sensors, times, (z, meta)), s, subjects, {k: n for k, n in unused.items() if n}, left_out)


def _output_times(team: UtiasDataset, first: float, last: float) -> tuple[Array, tuple[str, ...]]:
    """Times (n,) s at steps of GRID from `first` to `last`, and a line on each gap that is left out."""
    known = np.unique(np.concatenate([robot.odometry[:, 0] for robot in team.robots.values()]))
    known = np.concatenate([[first], known[(known > first) & (known < last)], [last]])
    gaps = np.flatnonzero(np.diff(known) > LONG_GAP)
    begins, ends = known[np.append(0, gaps + 1)], known[np.append(gaps, len(known) - 1)]
    if (seconds := float((ends - begins).sum())) > MAX_SECONDS:
        raise ValueError(f"odometry covers {seconds:.0f} s without gaps, needs at most {MAX_SECONDS:.0f} s")
    times = np.concatenate([np.round(np.arange(begin, end, GRID), 3) for begin, end in zip(begins, ends, strict=True)])
    if not len(times):
        raise ValueError(f"odometry has only gaps of more than {LONG_GAP:.0f} s, needs times in seconds")
    left_out = [
        f"no robot has odometry from {known[k]:.3f} to {known[k + 1]:.3f} s: this gap of {known[k + 1] - known[k]:.0f} s is left out" for k in gaps
    ]
    return times, tuple(left_out[:MAX_LINES]) + ((f"{len(left_out) - MAX_LINES} more gaps are left out",) if len(left_out) > MAX_LINES else ())


def _measurements(team: UtiasDataset, i: int, sensors: Sensors, begin: Array) -> tuple[Array, NDArray[np.int64], int]:
    """The measurements of robot i from the first start on.

    Returns time s, range m, bearing rad and their standard deviations (m, 5). Beside them are the numbers of robot and subject in the
    state (m, 2), and how many measurements are too early.
    """
    robots = list(team.robots)
    place = {subject: k for k, subject in enumerate([*robots, *team.landmarks])}
    robot: UtiasRobot = team.robots[robots[i]]
    subject = np.array([place[s] for s in robot.subject.tolist()], dtype=np.int64)
    seen, other = robot.measurements.copy(), subject < len(robots)
    seen[:, 0] -= sensors.camera_delay
    seen[other, 1] -= sensors.robot_range
    rows = np.concatenate([seen, sighting_sigma(robot.measurements, subject, other, sensors)], axis=1)
    both = np.maximum(begin[i], np.where(other, begin[np.minimum(subject, len(robots) - 1)], -np.inf))
    good = rows[:, 0] >= both
    return rows[good], np.stack([np.full(len(subject), i), subject], axis=1)[good], int((~good).sum())


def _initial_state(team: UtiasDataset, sensors: Sensors, correction: bool, known_map: bool) -> PlanarState:
    n = len(team.robots)
    start, covariance = np.zeros((n, ROBOT)), np.zeros((n, ROBOT, ROBOT))
    for i, robot in enumerate(team.robots.values()):
        start[i, :3] = robot.truth[0, 1:]
        sigma = np.array([1e-3, 1e-3, 1e-3, *(sensors.offsets if correction else (0.0,) * 3), *sensors.scales])
        covariance[i] = np.diag(sigma**2)
    s = initial_state(start, covariance, len(team.landmarks))
    if known_map:
        at = np.arange(ROBOT * n, len(s.mean))
        s.mean[at] = s.first[at] = np.concatenate(list(team.landmarks.values()))
        s.P[at, at] = 1e-3**2
        s.initialized[:] = True
    return s


def _schedule(team: UtiasDataset, sensors: Sensors, times: Array, measurements: tuple[Array, NDArray[np.int64]]) -> EventSchedule:
    """All events in the order of time: steps of each robot to every output time and to every scan that involves it. Scans come before outputs."""
    rows, meta = measurements
    order = np.lexsort((meta[:, 0], rows[:, 0]))
    rows, meta = rows[order], meta[order]
    new_scan = np.ones(len(rows), dtype=bool)
    new_scan[1:] = (np.diff(rows[:, 0]) > 0) | (np.diff(meta[:, 0]) != 0)
    start = np.append(np.flatnonzero(new_scan), len(rows)).astype(np.int64)
    moves = []
    for i, robot in enumerate(team.robots.values()):
        there = rows[(meta == i).any(axis=1), 0]
        t = np.unique(np.concatenate([[robot.truth[0, 0]], times, there]))
        steps = np.diff(integrate(robot.odometry, sensors, t), axis=0)
        moves.append((t[1:], np.full(len(steps), i), steps, step_noise(steps, np.diff(t), sensors)))
    time, mover, steps, noise = (np.concatenate(part) for part in zip(*moves, strict=True))
    kind = np.concatenate([np.full(len(time), STEP), np.full(len(start) - 1, SCAN), np.full(len(times), OUTPUT)])
    when = np.concatenate([time, rows[start[:-1], 0], times])
    robot_of = np.concatenate([mover, meta[start[:-1], 0], np.zeros(len(times), dtype=np.int64)])
    item = np.concatenate([np.arange(len(time)), np.arange(len(start) - 1), np.arange(len(times))])
    order = np.lexsort((kind, when))
    moved = np.ascontiguousarray(steps[:, :2])
    z, sigma = np.ascontiguousarray(rows[:, 1:3]), np.ascontiguousarray(rows[:, 3:])
    subject = np.ascontiguousarray(meta[:, 1])
    return EventSchedule(kind[order], robot_of[order], item[order], moved, noise, start, subject, z, sigma, when[order], len(times))
