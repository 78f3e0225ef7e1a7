"""Robots that see each other: Jacobians in every mode, what stays untold, and what a team gains by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracker.ekf.test_invariant_error import known, team, turned
from tests.tracker.walled_room import Room, simulate
from tracker.ekf.gaussian import nees
from tracker.ekf.linearization import RobotMeasurements, linearise
from tracker.ekf.measurement_models import predict
from tracker.ekf.odometry_biases import BiasModel
from tracker.ekf.state import JointState
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.filter import Slam
from tracker.slam.inter_robot import expected, identify
from tracker.slam.parameters import SlamParameters
from tracker.types import Mount, Odometry, RobotDetections, Setup, Start, Tick

Array = NDArray[np.float64]
MODES = ("iekf", "fej", "invariant")
MOUNTS = [Mount(Panorama(64, 32), Pose.exp([0.1 + 0.2 * k, -0.1, 0.5, 0.1, -0.2, 0.7 * k]), f"r{k}") for k in range(2)]
SIGMA = 0.004


def sight_of(state: JointState, robot: int, rng: np.random.Generator, off: float = 0.05) -> RobotMeasurements:
    """How one robot sees the camera of the other, some degrees beside where it is expected."""
    other = 1 - robot
    lever = MOUNTS[other].T_body_camera.translation
    place = state.rotation[other] @ lever + state.translation[other]
    bearing, _ = predict(state.sight(robot, MOUNTS[robot]), place[None])
    bearing = bearing + (off * rng.normal(size=(1, 1, 2)) @ tangent_basis(bearing))[:, 0]
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    return RobotMeasurements(MOUNTS[robot], np.array([other]), lever[None], bearing, np.tile(0.02**2 * np.eye(2), (1, 1, 1)))


def look(state: JointState, robot: int, rng: np.random.Generator, iterations: int) -> None:
    """An update by the other robot alone, seen aside from where it is expected."""
    seen = sight_of(state, robot, rng)
    state.update(lambda: linearise(state, robot, None, None, seen), iterations, np.inf)


@pytest.mark.parametrize("mode", [*MODES, "persistent"])
def test_jacobians_are_those_of_differences(mode: str) -> None:
    """Of first estimates: at them, in their axes."""
    state, rng = team("fej" if mode == "persistent" else mode)
    if mode == "persistent":
        state = JointState(1, 4, (0.02, 0.02, 0.01), "fej", BiasModel())
        for start in (Pose.exp(rng.normal(size=6)) for _ in range(2)):
            state.join(Start(start, 0.01 * np.eye(6)))
    for k in range(3):
        look(state, k % 2, rng, 2)
    moved = not np.allclose(state.anchors[1], state.translation, atol=1e-6)
    assert moved == state.first_estimates
    first = linearise(state, 0, None, None, sight_of(state, 0, rng, 0.0))
    state.rotation, state.translation = (anchor.copy() for anchor in state.anchors[:2])
    seen = sight_of(state, 0, rng, 0.0)
    before = (state.rotation.copy(), state.translation.copy(), state.correction.copy(), state.point[: state.count].copy(), state.lasting.copy())

    def residual(column: int, step: float) -> Array:
        delta = np.zeros(len(state.P))
        delta[first.columns[column]] = step
        state._retract(before, delta, 0)
        return linearise(state, 0, None, None, seen).residual

    for column in range(len(first.columns)):
        difference = (residual(column, 1e-6) - residual(column, -1e-6)) / 2e-6
        np.testing.assert_allclose(first.H[:, column], -difference, atol=1e-7 * np.abs(first.H).max())


@pytest.mark.parametrize("iterations", [1, 2])
@pytest.mark.parametrize("mode", MODES)
def test_another_robot_tells_nothing_of_how_the_world_is_turned(mode: str, iterations: int) -> None:
    state, rng = team(mode)
    before = [known(state, turned(state, axis)) for axis in np.eye(3)]
    for k in range(4):
        look(state, k % 2, rng, iterations)
    after = [known(state, turned(state, axis)) for axis in np.eye(3)]
    assert np.allclose(after, before, rtol=1e-5) == (mode != "iekf")


@pytest.mark.parametrize("mode", MODES)
def test_the_covariance_stays_symmetric_and_positive_and_shrinks(mode: str) -> None:
    state, rng = team(mode)
    doubt = [np.trace(state.covariance(robot)) for robot in range(2)]
    for k in range(40):
        seen = sight_of(state, k % 2, rng, 0.02)
        state.update(lambda seen=seen, k=k: linearise(state, k % 2, None, None, seen), 2, 3.0)  # type: ignore[misc]
    rows = state.active()
    P = state.P[np.ix_(rows, rows)]
    np.testing.assert_allclose(P, P.T, atol=1e-15)
    assert np.linalg.eigvalsh(P).min() > 0
    assert all(np.trace(state.covariance(robot)) < before for robot, before in enumerate(doubt)), "both, the one that sees and the one that is seen"


def with_companions(room: Room, rng: np.random.Generator) -> tuple[Setup, list[Tick], list[dict[str, Pose]]]:
    """The room, where every robot sees every other one, SIGMA rad an axis."""
    setup, ticks, truth, _ = simulate(room)
    out = []
    for tick, poses in zip(ticks, truth, strict=True):
        views = []
        for view in tick.views:
            mount = setup.mounts[view.camera]
            others = tuple(name for name in poses if name != mount.robot)
            places = np.array([(poses[name] @ setup.mount_of(name).T_body_camera).translation for name in others])
            bearing = (poses[mount.robot] @ mount.T_body_camera).inverse().apply(places)
            bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
            bearing = bearing + ((SIGMA * rng.normal(size=(len(others), 1, 2))) @ tangent_basis(bearing))[:, 0]
            bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
            views.append(replace(view, companions=RobotDetections(bearing, others, np.tile(SIGMA**2 * np.eye(2), (len(others), 1, 1)))))
        out.append(replace(tick, views=tuple(views)))
    return setup, out, truth


def apart(slam: Slam, true: dict[str, Pose]) -> Array:
    """How far off the other robot is, m, as each of two sees it."""
    a, b = true
    errors = [slam.pose(i).inverse().apply(slam.pose(j).translation) - true[i].inverse().apply(true[j].translation) for i, j in ((a, b), (b, a))]
    return np.linalg.norm(errors, axis=1)


@pytest.mark.parametrize("mode", MODES)
def test_two_robots_that_see_each_other_know_better_how_they_stand(mode: str) -> None:
    """Five landmarks in all: most of the time a robot knows itself by its wheels."""
    errors: dict[bool, list[float]] = {True: [], False: []}
    consistency = []
    for seed in range(3):
        setup, ticks, truth = with_companions(Room(seed=seed, robots=2, ticks=90, landmarks=5), np.random.default_rng(seed))
        for sees in errors:
            slam = Slam(setup, SlamParameters(mode=mode, level_memory=0.0, turn_memory=0.0))
            for tick, true in zip(ticks, truth, strict=True):
                slam.step(tick if sees else replace(tick, views=tuple(replace(v, companions=None) for v in tick.views)))
                errors[sees].append(float(np.square(apart(slam, true)).mean()))
                if sees:
                    consistency += [nees((slam.pose(name).inverse() @ true[name]).log(), slam.covariance(name)) for name in true]
        assert slam.counters.get("robot seen", 0) == 0
    assert np.sqrt(np.mean(errors[True])) < 0.7 * np.sqrt(np.mean(errors[False]))
    assert 0.4 < np.mean(consistency) < 2.0


def test_an_absurd_companion_is_refused_and_counted() -> None:
    setup, ticks, _ = with_companions(Room(robots=2, ticks=12), np.random.default_rng(0))
    slam, plain = Slam(setup, SlamParameters()), Slam(setup, SlamParameters())
    for tick in ticks:
        views = []
        for view in tick.views:
            assert view.companions is not None
            views.append(replace(view, companions=replace(view.companions, bearing=-view.companions.bearing)))
        slam.step(replace(tick, views=tuple(views)))
        plain.step(replace(tick, views=tuple(replace(view, companions=None) for view in tick.views)))
    assert slam.counters["robot refused"] == 2 * len(ticks)
    assert not slam.counters.get("robot seen")
    np.testing.assert_array_equal(slam.pose("r0").translation, plain.pose("r0").translation)


def test_the_order_of_companions_and_who_is_not_placed() -> None:
    setup, ticks, _ = with_companions(Room(robots=4, ticks=6), np.random.default_rng(0))
    slam, shuffled, lone = (
        Slam(setup, SlamParameters()),
        Slam(setup, SlamParameters()),
        Slam(replace(setup, starts=setup.starts | {"r3": None}), SlamParameters()),
    )
    for tick in ticks:
        slam.step(tick)
        lone.step(tick)
        turned_round = []
        for view in tick.views:
            c = view.companions
            assert c is not None
            turned_round.append(replace(view, companions=RobotDetections(c.bearing[::-1], c.robot[::-1], c.covariance[::-1])))
        shuffled.step(replace(tick, views=tuple(turned_round)))
    np.testing.assert_array_equal(slam._joint.P, shuffled._joint.P)
    assert slam.counters["robot seen"] > 0.95 * 12 * len(ticks)
    # It joins when it has seen enough of what the others have mapped.
    assert lone.counters["robot unplaced"] >= 3


def test_a_robot_without_landmarks_is_corrected_by_who_it_sees() -> None:
    setup, ticks, truth = with_companions(Room(robots=2, ticks=40, landmarks=60), np.random.default_rng(0))
    slam = Slam(setup, SlamParameters())
    for tick in ticks[:-1]:
        slam.step(replace(tick, views=tuple(replace(v, companions=None) for v in tick.views)))
    one, two = ticks[-1].views
    assert two.odometry is not None
    lost = replace(two, sightings=None, companions=None, odometry=Odometry(two.odometry.T_before_now, 0.01 * np.eye(6)))
    slam.step(replace(ticks[-1], views=(replace(one, sightings=None), lost)))
    assert slam.counters["robot seen"] == 1
    doubt = slam.covariance("r1")[:3, :3]
    assert np.linalg.eigvalsh(doubt)[0] < 0.2 * np.linalg.eigvalsh(doubt)[2], "across the line of sight it is known well"
    assert np.linalg.norm(slam.pose("r1").translation - truth[-1]["r1"].translation) < 0.3


def test_a_robot_that_slipped_is_put_right_by_whom_it_sees() -> None:
    """It is pushed by 0.35 m and 6°, which its odometry does not know, and knows no landmark; the three others that it sees all stand elsewhere."""
    setup, ticks, truth = with_companions(Room(robots=4, ticks=40, landmarks=60), np.random.default_rng(0))
    slam, errors = Slam(setup, SlamParameters()), []
    for tick, true in zip(ticks, truth, strict=True):
        view = tick.views[0]
        assert view.odometry is not None
        if tick.index == 20:
            push = Pose.exp(np.array([0.2, 0.28, 0, 0, 0, 0.1]))
            view = replace(view, odometry=replace(view.odometry, T_before_now=view.odometry.T_before_now @ push))
        slam.step(replace(tick, views=(replace(view, sightings=None), *tick.views[1:])))
        errors.append(float(np.linalg.norm(slam.pose("r0").translation - true["r0"].translation)))
    assert slam.counters["reopened"] == 1
    assert errors[-1] < 0.15
    assert max(errors[25:]) < 0.2


@pytest.mark.parametrize(("robot", "said"), [("r7", "robot 'r7' carries no camera"), ("r0", "c0 sees robot 'r0', which carries it")])
def test_whom_nobody_can_see(robot: str, said: str) -> None:
    setup, ticks, _ = with_companions(Room(robots=2, ticks=1), np.random.default_rng(0))
    view = ticks[0].views[0]
    assert view.companions is not None
    with pytest.raises(ValueError, match=said):
        Slam(setup, SlamParameters()).step(replace(ticks[0], views=(replace(view, companions=replace(view.companions, robot=(robot,))),)))


def test_who_is_met_has_the_lever_of_its_own_camera() -> None:
    setup = Setup({f"c{k}": m for k, m in enumerate(MOUNTS)}, Flat(), {"r0": None, "r1": None}, 0.1)
    seen = RobotDetections(np.array([[1.0, 0, 0]]), ("r1",), 1e-4 * np.eye(2)[None])
    found = identify(setup, MOUNTS[0], seen, {"r0": 0, "r1": 1})
    np.testing.assert_array_equal(found.lever, [MOUNTS[1].T_body_camera.translation])
    assert len(identify(setup, MOUNTS[0], seen, {"r0": 0})) == 0
    state, _ = team("invariant")
    assert expected(state, 0, identify(setup, MOUNTS[0], seen, {"r0": 0}), 0.999).shape == (0,)
