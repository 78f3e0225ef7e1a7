"""Robots with unknown starts: when they join, with which accuracy, and the reasons for which they wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.tracker.walled_room import Room, simulate
from tracker.ekf.gaussian import nees
from tracker.metrics.trajectory import score_robots
from tracker.pipeline import track
from tracker.sequence.results import Results
from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters
from tracker.slam.unknown_start import level_start
from tracker.types import Setup, Sightings, Tick

HALL = Room(seed=20, robots=3, ticks=45, landmarks=110)
Errors = dict[str, list[float]]


def with_unknown_start(setup: Setup, name: str = "r1") -> Setup:
    """The setup with an unknown start of one robot."""
    return replace(setup, starts=setup.starts | {name: None})


@cache
def run(seed: int) -> tuple[Slam, int, Errors, Errors]:
    """A run in which r1 starts unknown: the filter, the tick at which r1 joined, and errors m and NEES of each robot since."""
    setup, ticks, truth, _ = simulate(replace(HALL, seed=seed))
    slam, joined = Slam(with_unknown_start(setup), SlamParameters()), -1
    errors: Errors = {name: [] for name in setup.starts}
    consistency: Errors = {name: [] for name in setup.starts}
    for tick, true in zip(ticks, truth, strict=True):
        slam.step(tick)
        joined = tick.index if joined < 0 and slam.is_localized("r1") else joined
        for name in true if joined >= 0 else ():
            errors[name].append(float(np.linalg.norm(slam.pose(name).translation - true[name].translation)))
            consistency[name].append(nees((slam.pose(name).inverse() @ true[name]).log(), slam.covariance(name)))
    return slam, joined, errors, consistency


def with_sightings(tick: Tick, camera: str, change: Callable[[Sightings], Sightings]) -> Tick:
    """The tick with changed sightings of one camera."""
    views = tuple(replace(v, sightings=change(v.sightings)) if v.camera == camera and v.sightings else v for v in tick.views)
    return replace(tick, views=views)


def test_a_robot_joins_with_the_accuracy_of_the_others() -> None:
    runs = [run(seed) for seed in (20, 21, 22)]
    for slam, joined, *_ in runs:
        assert 0 < joined < 25
        assert slam.counters["joined"] == 1
        assert slam.counters["unknown start"] == joined
        assert sum(n for reason, n in slam.counters.items() if reason.startswith("waits")) == joined - 1
    error = {name: np.mean([np.mean(errors[name]) for _, _, errors, _ in runs]) for name in ("r0", "r1", "r2")}
    assert error["r1"] < 1.5 * max(error["r0"], error["r2"]) + 0.01 < 0.2
    # The errors of the two given starts are common to all, so r1 is at best as consistent as the others.
    mean = {name: np.mean([np.mean(consistency[name]) for *_, consistency in runs]) for name in ("r0", "r1", "r2")}
    assert 0.3 < mean["r1"] < 1.5 * max(mean["r0"], mean["r2"]) + 1.0


def test_landmarks_are_unique_and_the_covariance_is_joint() -> None:
    slam, *_ = run(20)
    apart = np.linalg.norm(slam.landmarks()[:, None] - slam.landmarks(), axis=2) + 10 * np.eye(len(slam.landmarks()))
    assert np.median(apart.min(axis=1)) > 0.2
    assert len(np.unique(slam.identities())) == len(slam.landmarks())
    joint, book = slam.state
    assert joint.count == book.count
    rows = joint.active()
    P = joint.P[np.ix_(rows, rows)]
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > -1e-12
    a, b = (slice(joint.offset(i), joint.offset(i) + 6) for i in (0, 2))
    scale = np.sqrt(np.outer(np.diag(joint.P[a, a]), np.diag(joint.P[b, b])))
    assert np.abs(joint.P[a, b] / scale).max() > 0.2, "its pose is known through the others' landmarks alone"


def test_a_robot_without_common_landmarks_never_joins() -> None:
    setup, ticks, *_ = simulate(replace(HALL, seed=23, ticks=30))
    other = [with_sightings(tick, "c1", lambda s: replace(s, descriptor=s.descriptor[:, ::-1])) for tick in ticks]
    slam = Slam(with_unknown_start(setup), SlamParameters())
    without_r1 = {camera: mount for camera, mount in setup.mounts.items() if mount.robot != "r1"}
    without = Slam(replace(setup, mounts=without_r1, starts={name: setup.starts[name] for name in ("r0", "r2")}), SlamParameters())
    for tick in other:
        slam.step(tick)
        without.step(replace(tick, views=tuple(v for v in tick.views if v.camera != "c1")))
    assert not slam.is_localized("r1")
    assert slam.counters["unknown start"] == sum(n for reason, n in slam.counters.items() if reason.startswith("waits")) == len(ticks)
    for name in ("r0", "r2"):
        np.testing.assert_array_equal(slam.pose(name).translation, without.pose(name).translation)
        np.testing.assert_array_equal(slam.covariance(name), without.covariance(name))


@pytest.mark.soak
def test_wrong_names_do_not_admit_a_robot() -> None:
    """All landmarks that r1 sees have the name of another."""
    setup, ticks, *_ = simulate(replace(HALL, seed=24, ticks=30, named=True))
    names = np.random.default_rng(0).permutation(HALL.landmarks)
    slam, correct = Slam(with_unknown_start(setup), SlamParameters()), Slam(with_unknown_start(setup), SlamParameters())
    for tick in ticks:
        slam.step(with_sightings(tick, "c1", lambda s: replace(s, subject=names[s.subject])))
        correct.step(tick)
    assert correct.is_localized("r1")
    assert not slam.is_localized("r1")
    assert slam.counters["waits: places disagree"] > 5


def test_a_robot_without_gravity_waits() -> None:
    setup, ticks, *_ = simulate(replace(HALL, ticks=2))
    slam = Slam(with_unknown_start(setup), SlamParameters())
    for tick in ticks:
        views = tuple(replace(v, odometry=replace(v.odometry, gravity=None)) if v.odometry else v for v in tick.views)
        slam.step(replace(tick, views=views))
    assert slam.counters["waits: no level"] == 2


def test_a_level_start_is_vertical_along_the_measured_up() -> None:
    up = np.array([0.2, -0.1, 0.9])
    start = level_start(up)
    np.testing.assert_allclose(start.T_world_robot.rotation @ (up / np.linalg.norm(up)), [0, 0, 1], atol=1e-12)
    assert start.T_world_robot.yaw == pytest.approx(0, abs=1e-12)
    world = start.T_world_robot.rotation @ start.covariance[3:, 3:] @ start.T_world_robot.rotation.T
    assert world[2, 2] < 1e-6 < world[0, 0]


@pytest.mark.soak
def test_the_tracker_reports_no_pose_before_a_robot_joins() -> None:
    setup, ticks, truth, _ = simulate(HALL)
    shifted = [replace(tick, index=tick.index - 1) for tick in ticks]
    estimates = list(track(with_unknown_start(setup), shifted))
    _, joined, *_ = run(20)
    assert ["r1" in e.T_world_robot for e in estimates] == [e.index + 1 >= joined for e in estimates]
    results = Results.of(estimates, {})
    assert [pose is None for pose in results.poses["r1"]] == ["r1" not in e.T_world_robot for e in estimates]
    score = score_robots({name: [t[name] for t in truth] for name in truth[0]}, results.poses, results.covariances)
    assert score.absent == joined - 1


@pytest.mark.soak
def test_joining_keeps_the_covariance_consistent_over_many_seeds() -> None:
    """NEES of the whole team after r1 has joined, beside that of the two others without r1 on the same draws."""
    joined, baseline = [], []
    for seed in range(20, 28):
        slam, tick, _, consistency = run(seed)
        if tick < 0:
            print(seed, slam.counters)
            continue
        joined.append(np.mean([np.mean(consistency[name]) for name in consistency]))
        setup, ticks, truth, _ = simulate(replace(HALL, seed=seed))
        without_r1 = {camera: mount for camera, mount in setup.mounts.items() if mount.robot != "r1"}
        slam = Slam(replace(setup, mounts=without_r1, starts={name: setup.starts[name] for name in ("r0", "r2")}), SlamParameters())
        values = []
        for k, true in zip(ticks, truth, strict=True):
            slam.step(replace(k, views=tuple(v for v in k.views if v.camera != "c1")))
            values += [nees((slam.pose(n).inverse() @ true[n]).log(), slam.covariance(n)) for n in ("r0", "r2") if k.index >= tick]
        baseline.append(np.mean(values))
    print(np.round(joined, 2), np.round(baseline, 2), np.mean(joined), np.mean(baseline))
    assert np.mean(joined) < 1.3 * np.mean(baseline) + 0.2
    assert np.mean(joined) < 2.5
