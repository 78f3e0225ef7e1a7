"""Inter-robot measurements: Jacobians in every mode, observability, and the gain for a team."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracker.ekf.test_observability import information_along, rotation_of_the_world, team
from tests.tracker.walled_room import Room, simulate
from tracker.ekf.gaussian import nees
from tracker.ekf.linearization import RobotMeasurements, linearize
from tracker.ekf.measurement_models import predict
from tracker.ekf.odometry_biases import BiasModel
from tracker.ekf.state import JointState, PriorMeans
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.data_association import identify, within_gate
from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters
from tracker.types import Mount, Odometry, RobotDetections, Setup, Start, Tick

Array = NDArray[np.float64]
MODES = ("iekf", "fej")
MOUNTS = [Mount(Panorama(64, 32), Pose.exp([0.1 + 0.2 * k, -0.1, 0.5, 0.1, -0.2, 0.7 * k]), f"r{k}") for k in range(2)]
SIGMA = 0.004


def bearing_of_the_other(state: JointState, robot: int, rng: np.random.Generator, off: float = 0.05) -> RobotMeasurements:
    """The bearing of the other robot's camera, some degrees from where it is expected."""
    other = 1 - robot
    lever = MOUNTS[other].T_body_camera.translation
    place = state.rotation[other] @ lever + state.translation[other]
    bearing, _ = predict(state.camera_pose(robot, MOUNTS[robot]), place[None])
    bearing = bearing + (off * rng.normal(size=(1, 1, 2)) @ tangent_basis(bearing))[:, 0]
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    return RobotMeasurements(MOUNTS[robot], np.array([other]), lever[None], bearing, np.tile(0.02**2 * np.eye(2), (1, 1, 1)))


def update_by_robot(state: JointState, robot: int, rng: np.random.Generator, iterations: int) -> None:
    """An update by the other robot alone."""
    seen = bearing_of_the_other(state, robot, rng)
    state.update(lambda: linearize(state, robot, None, None, seen), iterations, np.inf)


@pytest.mark.parametrize("mode", [*MODES, "biases"])
def test_jacobians_against_differences(mode: str) -> None:
    """With first estimates they are taken at those, in their axes."""
    state, rng = team("fej" if mode == "biases" else mode)
    if mode == "biases":
        state = JointState(1, 4, (0.02, 0.02, 0.01), "fej", BiasModel())
        for start in (Pose.exp(rng.normal(size=6)) for _ in range(2)):
            state.add_robot(Start(start, 0.01 * np.eye(6)))
    for k in range(3):
        update_by_robot(state, k % 2, rng, 2)
    moved = not np.allclose(state.linearization_points[1], state.translation, atol=1e-6)
    assert moved == state.first_estimates
    first = linearize(state, 0, None, None, bearing_of_the_other(state, 0, rng, 0.0))
    state.rotation, state.translation = (anchor.copy() for anchor in state.linearization_points[:2])
    seen = bearing_of_the_other(state, 0, rng, 0.0)
    means = (state.rotation, state.translation, state.correction, state.point[: state.count], state.odometry_bias)
    before = PriorMeans(*(array.copy() for array in means))

    def residual(column: int, step: float) -> Array:
        delta = np.zeros(len(state.P))
        delta[first.columns[column]] = step
        state._retract(before, delta)
        return linearize(state, 0, None, None, seen).residual

    for column in range(len(first.columns)):
        difference = (residual(column, 1e-6) - residual(column, -1e-6)) / 2e-6
        np.testing.assert_allclose(first.H[:, column], -difference, atol=1e-7 * np.abs(first.H).max())


@pytest.mark.parametrize("iterations", [1, 2])
@pytest.mark.parametrize("mode", MODES)
def test_a_rotation_of_the_world_is_unobservable(mode: str, iterations: int) -> None:
    state, rng = team(mode)
    before = [information_along(state, rotation_of_the_world(state, axis)) for axis in np.eye(3)]
    for k in range(4):
        update_by_robot(state, k % 2, rng, iterations)
    after = [information_along(state, rotation_of_the_world(state, axis)) for axis in np.eye(3)]
    assert np.allclose(after, before, rtol=1e-5) == (mode != "iekf")


def with_robot_detections(room: Room, rng: np.random.Generator) -> tuple[Setup, list[Tick], list[dict[str, Pose]]]:
    """The room, where every robot sees every other one with SIGMA rad an axis."""
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
            views.append(replace(view, robot_detections=RobotDetections(bearing, others, np.tile(SIGMA**2 * np.eye(2), (len(others), 1, 1)))))
        out.append(replace(tick, views=tuple(views)))
    return setup, out, truth


def relative_errors(slam: Slam, true: dict[str, Pose]) -> Array:
    """Errors m of the other robot's position in the frame of each of two."""
    a, b = true
    errors = [slam.pose(i).inverse().apply(slam.pose(j).translation) - true[i].inverse().apply(true[j].translation) for i, j in ((a, b), (b, a))]
    return np.linalg.norm(errors, axis=1)


@pytest.mark.soak
@pytest.mark.parametrize("mode", MODES)
def test_detections_of_each_other_improve_relative_positions(mode: str) -> None:
    """Five landmarks in all: mostly a robot has its odometry alone."""
    errors: dict[bool, list[float]] = {True: [], False: []}
    consistency = []
    for seed in range(3):
        setup, ticks, truth = with_robot_detections(Room(seed=seed, robots=2, ticks=90, landmarks=5), np.random.default_rng(seed))
        for sees in errors:
            slam = Slam(setup, SlamParameters(mode=mode, gravity_correlation_time=0.0, rotation_correlation_time=0.0))
            for tick, true in zip(ticks, truth, strict=True):
                slam.step(tick if sees else replace(tick, views=tuple(replace(v, robot_detections=None) for v in tick.views)))
                errors[sees].append(float(np.square(relative_errors(slam, true)).mean()))
                if sees:
                    consistency += [nees((slam.pose(name).inverse() @ true[name]).log(), slam.covariance(name)) for name in true]
        assert slam.counters.get("robot seen", 0) == 0
    assert np.sqrt(np.mean(errors[True])) < 0.7 * np.sqrt(np.mean(errors[False]))
    assert 0.4 < np.mean(consistency) < 2.0


def test_a_wrong_robot_detection_is_rejected_and_counted() -> None:
    setup, ticks, _ = with_robot_detections(Room(robots=2, ticks=12), np.random.default_rng(0))
    slam, plain = Slam(setup, SlamParameters()), Slam(setup, SlamParameters())
    for tick in ticks:
        views = []
        for view in tick.views:
            assert view.robot_detections is not None
            views.append(replace(view, robot_detections=replace(view.robot_detections, bearing=-view.robot_detections.bearing)))
        slam.step(replace(tick, views=tuple(views)))
        plain.step(replace(tick, views=tuple(replace(view, robot_detections=None) for view in tick.views)))
    assert slam.counters["robot refused"] == 2 * len(ticks)
    assert not slam.counters.get("robot seen")
    np.testing.assert_array_equal(slam.pose("r0").translation, plain.pose("r0").translation)


def test_a_robot_without_landmarks_is_corrected_by_another() -> None:
    setup, ticks, truth = with_robot_detections(Room(robots=2, ticks=40, landmarks=60), np.random.default_rng(0))
    slam = Slam(setup, SlamParameters())
    for tick in ticks[:-1]:
        slam.step(replace(tick, views=tuple(replace(v, robot_detections=None) for v in tick.views)))
    one, two = ticks[-1].views
    assert two.odometry is not None
    lost = replace(two, sightings=None, robot_detections=None, odometry=Odometry(two.odometry.T_before_now, 0.01 * np.eye(6)))
    slam.step(replace(ticks[-1], views=(replace(one, sightings=None), lost)))
    assert slam.counters["robot seen"] == 1
    covariance = slam.covariance("r1")[:3, :3]
    assert np.linalg.eigvalsh(covariance)[0] < 0.2 * np.linalg.eigvalsh(covariance)[2], "across the line of sight it is information_along well"
    assert np.linalg.norm(slam.pose("r1").translation - truth[-1]["r1"].translation) < 0.3


def test_a_slipped_robot_is_corrected_by_the_robots_that_it_sees() -> None:
    """It slips by 0.35 m and 6° without a change of its odometry, and sees three robots but no landmark."""
    setup, ticks, truth = with_robot_detections(Room(robots=4, ticks=40, landmarks=60), np.random.default_rng(0))
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


@pytest.mark.parametrize(("robot", "message"), [("r7", "robot 'r7' carries no camera"), ("r0", "c0 sees robot 'r0', which carries it")])
def test_impossible_robot_detections_are_errors(robot: str, message: str) -> None:
    setup, ticks, _ = with_robot_detections(Room(robots=2, ticks=1), np.random.default_rng(0))
    view = ticks[0].views[0]
    assert view.robot_detections is not None
    with pytest.raises(ValueError, match=message):
        Slam(setup, SlamParameters()).step(replace(ticks[0], views=(replace(view, robot_detections=replace(view.robot_detections, robot=(robot,))),)))


def test_a_detected_robot_has_the_lever_of_its_own_camera() -> None:
    setup = Setup({f"c{k}": m for k, m in enumerate(MOUNTS)}, Flat(), {"r0": None, "r1": None}, 0.1)
    seen = RobotDetections(np.array([[1.0, 0, 0]]), ("r1",), 1e-4 * np.eye(2)[None])
    found = identify(setup, MOUNTS[0], seen, {"r0": 0, "r1": 1})
    np.testing.assert_array_equal(found.lever, [MOUNTS[1].T_body_camera.translation])
    assert len(identify(setup, MOUNTS[0], seen, {"r0": 0})) == 0
    state, _ = team("fej")
    assert within_gate(state, 0, identify(setup, MOUNTS[0], seen, {"r0": 0}), 0.999).shape == (0,)
