"""Robots of a user: how they move is found from their joints, they stay on their ground or at their height, and their odometry is honest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.placement.movers import VelocityDriver
from sim.recording.tracker_setup import make_setup
from sim.robots.controller import DriveCommand, RobotState
from sim.robots.robot_choice import RobotChoice, parse_robots
from sim.robots.user_robot import encoder_wheels, load_robot, wheel_commands
from sim.scenario import Scenario
from sim.simulation import Simulation
from tests.sim.robots.samples import ackermann, biped, differential, kiwi, mecanum, quadrotor, rolling, self_controlled, skid_steer, tower, walker
from tracker.detections.occlusion import Bodies, Viewpoint
from tracker.geometry import Pose, rotation_from_quaternion
from tracker.sequence.calibration import calibration_of, setup_from

KINDS: dict[Callable[[Path], str], tuple[str, int, int]] = {
    differential: ("wheels", 2, 0),
    skid_steer: ("wheels", 4, 0),
    ackermann: ("wheels", 4, 0),
    kiwi: ("wheels", 3, 0),
    mecanum: ("wheels", 4, 0),
    walker: ("base", 0, 4),
    quadrotor: ("thrust", 0, 0),
}
"""Robot → its motion, wheels and legs."""


def drive(robot: str, seed: int = 0, frames: int = 30, world: str = "hills") -> tuple[Simulation, np.ndarray, np.ndarray]:
    """A simulation after some frames, the positions (frames, 3) m, and the errors of odometry over their covariance (frames, 6)."""
    simulation = Simulation(Scenario(world=world, robots=1, people=1, frames=frames, robot=robot, seed=seed))
    path, errors = [], []
    for _ in range(frames):
        before = simulation.T_world_robot("robot_0")
        simulation.step()
        odometry, now = simulation.odometry()["robot_0"], simulation.T_world_robot("robot_0")
        error = ((before.inverse() @ now).inverse() @ odometry.T_before_now).log()
        errors.append(np.linalg.solve(np.linalg.cholesky(odometry.covariance), error))
        path.append(now.translation)
    return simulation, np.array(path), np.array(errors)


@pytest.mark.parametrize("make", KINDS)
def test_motion_is_found_from_the_joints(tmp_path: Path, make: Callable[[Path], str]) -> None:
    robot = load_robot(RobotChoice(make(tmp_path)))
    motion, wheels, legs = KINDS[make]
    assert (robot.motion, len(robot.wheels), len(robot.legs)) == (motion, wheels, legs)
    if legs:
        assert sorted(leg.phase for leg in robot.legs) == [0, 0, 0.5, 0.5]
        assert robot.height == pytest.approx(0.4, abs=0.01)


@pytest.mark.parametrize("make", KINDS)
def test_robots_drive(tmp_path: Path, make: Callable[[Path], str]) -> None:
    robot = load_robot(RobotChoice(make(tmp_path)))
    # Four rigid Mecanum wheels slip on hills.
    simulation, path, errors = drive(make(tmp_path), world="hall" if make is mecanum else "hills")
    assert np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum() > 1.0, "it moves"
    over = path[:, 2] - simulation.world.terrain.height_at(path[:, :2])
    expected = robot.hover(1.5) if robot.motion == "thrust" else robot.height
    np.testing.assert_allclose(over, expected, atol=0.2 if robot.motion == "thrust" else 0.1)
    assert not simulation.tipped()["robot_0"]
    assert (errors**2).mean() < 6, "odometry is off by no more than it says"
    camera = simulation.T_world_robot("robot_0") @ simulation.mount("robot_0")
    height = camera.translation[2] - simulation.world.terrain.height_at(camera.translation[None, :2])[0]
    assert height == pytest.approx(1.5, abs=0.25)


@pytest.mark.parametrize("make", [walker, quadrotor])
def test_a_state_is_restored_bit_by_bit(tmp_path: Path, make: Callable[[Path], str]) -> None:
    simulation = Simulation(Scenario(world="hall", robots=2, people=2, frames=9, robot=f"rover,{make(tmp_path)}"))
    simulation.step()
    saved = simulation.save()
    simulation.step()
    first = simulation.data.qpos.copy()
    simulation.restore(saved)
    simulation.step()
    np.testing.assert_array_equal(simulation.data.qpos, first)


def test_ankles_keep_the_feet_of_a_robot_level(tmp_path: Path) -> None:
    simulation = Simulation(Scenario(world="hall", difficulty=0.0, robots=1, people=0, robot=biped(tmp_path)))
    up = []
    for _ in range(18):
        simulation.step()
        up.append([simulation.data.body(f"robot_0/{part}").xmat[8] for part in ("l_thigh", "r_thigh", "l_foot", "r_foot")])
    thighs, feet = np.split(np.array(up), 2, axis=1)
    assert thighs.min() < np.cos(0.2), "its legs swing"
    assert feet.min() > np.cos(0.01)


def test_a_robot_that_turns_in_place_moves_its_legs(tmp_path: Path) -> None:
    simulation = Simulation(Scenario(world="hall", difficulty=0.0, robots=1, people=0, robot=biped(tmp_path)))
    simulation.set_drivers([VelocityDriver(0.0, 0.8)], simulation.drives)
    up = []
    for _ in range(18):
        simulation.step()
        up.append(simulation.data.body("robot_0/l_thigh").xmat[8])
    assert min(up) < np.cos(0.08)


def test_the_camera_is_where_it_is_told(tmp_path: Path) -> None:
    robot = load_robot(RobotChoice(differential(tmp_path), camera="eye"))
    np.testing.assert_allclose(robot.mount(1.5).translation, [0.1, 0, 0.6], atol=1e-9)
    with pytest.raises(ValueError, match="has no camera or site 'nose', has eye"):
        load_robot(RobotChoice(differential(tmp_path), camera="nose"))


def cart(state: RobotState, command: DriveCommand) -> list[float]:
    """A controller of two wheels with a radius of 0.1 m, 0.4 m apart."""
    turn = command.yaw_rate + 2 * (command.yaw_rate - state.rate[2])
    assert state.joints.keys() == state.speeds.keys() == {"left", "right"}
    return [(command.speed - 0.2 * turn) / 0.1, (command.speed + 0.2 * turn) / 0.1]


def test_a_controller_of_the_user_drives(tmp_path: Path) -> None:
    simulation, path, errors = drive(self_controlled(tmp_path, f"{__name__}:cart"))
    assert np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum() > 1.0
    assert not simulation.tipped()["robot_0"]
    assert (errors**2).mean() < 6


BAD_CONTROLLERS = {
    "numpy:sum": r"numpy:sum failed at 0\.000 s \(TypeError: ",
    "numpy:nothing": "numpy has no function nothing",
    "builtins:repr": r"builtins:repr failed at 0\.000 s|needs 2 finite numbers",
    "numpy": "controller is 'numpy', needs module:function",
}


@pytest.mark.parametrize("controller", BAD_CONTROLLERS)
def test_a_bad_controller_is_one_line(tmp_path: Path, controller: str) -> None:
    with pytest.raises(ValueError, match=BAD_CONTROLLERS[controller]):
        drive(self_controlled(tmp_path, controller), frames=1)


def test_a_robot_with_steered_wheels_turns_about_one_centre(tmp_path: Path) -> None:
    robot = load_robot(RobotChoice(ackermann(tmp_path)))
    assert robot.turning_radius == pytest.approx(0.4 / np.tan(np.radians(35)) + 0.2)
    left, right, *steer = wheel_commands(robot, 0.5, 0.25, 0.0)
    assert [wheel.joint for wheel in robot.driven] == ["rl", "rr"]
    np.testing.assert_allclose([left, right], np.array([1.8, 2.2]) / 2.0 * 0.5 / 0.1)
    np.testing.assert_allclose(1 / np.tan(steer), [1.8 / 0.4, 2.2 / 0.4])
    assert wheel_commands(robot, -0.5, 0.25, 0.0)[2] < 0
    assert np.abs(wheel_commands(robot, 0.0, 0.8, 0.0)[2:]).max() <= np.radians(35) + 1e-9


def test_wheels_with_rollers_turn_as_their_rollers_let_them(tmp_path: Path) -> None:
    """Mecanum wheels (Muir & Neuman 1987): radius times speed is ahead less left or plus left, less or plus the turn about the sum of both arms."""
    robot = load_robot(RobotChoice(mecanum(tmp_path)))
    ahead, turn = wheel_commands(robot, 0.5, 0.0, 0.0), wheel_commands(robot, 0.0, 0.6, 0.6)
    np.testing.assert_allclose(ahead, np.full(4, 0.5 / 0.1), rtol=1e-3)
    np.testing.assert_allclose(turn, 0.6 * 0.4 / 0.1 * np.array([-1, 1, -1, 1]), rtol=1e-3)
    assert sorted(np.sign([wheel.turns[1] for wheel in robot.wheels])) == [-1, -1, 1, 1]
    three = load_robot(RobotChoice(kiwi(tmp_path)))
    turns = np.array([wheel.turns for wheel in three.wheels])
    way = sum(metres * turns[[w.joint for w in three.wheels].index(joint)] for joint, metres in encoder_wheels(three)) / 4
    np.testing.assert_allclose(way, [1, 0, 0], atol=1e-9)


def test_the_mask_of_its_own_body_is_what_the_camera_sees_of_it(tmp_path: Path) -> None:
    simulation = Simulation(Scenario(world="hall", difficulty=0.0, robots=2, people=0, robot=f"rover,{tower(tmp_path)}:camera=head"))
    setup = make_setup(simulation)
    assert setup.mounts["robot_0_camera"].own_body is None
    mount = setup.mounts["robot_1_camera"]
    angle = np.radians([0, 90, 150, 180])
    assert mount.sees_itself(np.column_stack([np.cos(angle), np.sin(angle), np.zeros(4)])).tolist() == [False, False, True, True]
    again = setup_from(calibration_of(setup), setup.ground, setup.occluders).mounts["robot_1_camera"]
    np.testing.assert_array_equal(again.own_body, mount.own_body)
    pose = simulation.T_world_robot("robot_1") @ mount.T_body_camera
    places = pose.apply(np.array([[4.0, 0, 0], [-4.0, 0, 0]]))[:, :2]
    bodies = Bodies(places, np.arange(2), np.arange(2), replace(setup, occluders=None), lambda _, share: np.ones(len(share)))
    seen = bodies.expected_detection(Viewpoint("robot_1_camera", mount.camera, pose), 20.0)
    assert seen.tolist() == [1.0, 0.0], "nobody is expected behind the tower"


def test_an_imu_at_a_site_measures_what_its_place_and_axes_do(tmp_path: Path) -> None:
    both = f"{tower(tmp_path)}:imu=imu,{tower(tmp_path)}"
    scenario = Scenario(world="hall", difficulty=0.0, robots=2, people=0, robot=both, imu="ideal@100", rate=10)
    simulation = Simulation(scenario)
    assert simulation.imu_mount("robot_1").translation.tolist() == [0, 0, 0]
    simulation.keep_steps = True
    for _ in range(10):
        simulation.step()
    states, mount = simulation.step_states(), simulation.imu_mount("robot_0")
    moved = states.at_sensors([mount, Pose.identity()])
    np.testing.assert_array_equal(moved.specific_force()[:, 1], states.specific_force()[:, 1])
    poses = [Pose(rotation_from_quaternion(q), p) @ mount for q, p in zip(states.quaternion[:, 0], states.position[:, 0], strict=True)]
    np.testing.assert_allclose(moved.position[:, 0], [pose.translation for pose in poses], atol=1e-12)
    np.testing.assert_allclose([rotation_from_quaternion(q) for q in moved.quaternion[:, 0]], [pose.rotation for pose in poses], atol=1e-12)
    speed = np.diff(moved.position[:, 0], axis=0) / states.timestep
    np.testing.assert_allclose(moved.velocity[1:, 0, :3], speed, atol=5e-3)
    turn = states.angular_velocity()[:, 0]
    np.testing.assert_allclose(moved.angular_velocity()[:, 0], turn[:, [1, 0, 2]] * [1, -1, 1], atol=1e-9)


BAD = {
    "": r"needs NAME or FILE\.xml",
    "rover,": r"needs NAME or FILE\.xml",
    "a.xml:motion=swim": "motion=swim, needs one of wheels, base, thrust",
    "a.xml:wings=2": "then :motion=…, :camera=…, :imu=… or :controller=MODULE:FUNCTION",
    "a.xml:controller=m:f:motion=base": "has motion and controller, needs one of them",
    "none.xml": r"robot none\.xml: no such file",
}


@pytest.mark.parametrize("text", BAD)
def test_a_wrong_choice_is_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=BAD[text]):
        [load_robot(choice) for choice in parse_robots(text)]


def test_what_cannot_drive_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wide = rolling(tmp_path / "wide.xml", [("left", 0.05, 0.9), ("right", 0.05, -0.9)])
    with pytest.raises(ValueError, match=r"is 1\.86 m wide, needs at most 1\.1 m"):
        load_robot(RobotChoice(wide))
    with pytest.raises(ValueError, match="has 0 wheels on lateral axles"):
        load_robot(RobotChoice(walker(tmp_path), motion="wheels"))
    menagerie = pytest.importorskip("mujoco_menagerie")
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(ValueError, match=r"cannot be fetched .*not found under MENAGERIE_ROOT"):
        load_robot(RobotChoice(menagerie.names()[0]))
    with pytest.raises(ValueError, match=r"'unitree_go', needs rover, FILE\.xml or a name of MuJoCo Menagerie, as unitree_go"):
        load_robot(RobotChoice("unitree_go"))


def test_a_mesh_is_no_robot(tmp_path: Path) -> None:
    (tmp_path / "dog.glb").write_bytes(b"glTF")
    with pytest.raises(ValueError, match=r"dog\.glb: is no model of a robot, needs MJCF"):
        load_robot(RobotChoice(str(tmp_path / "dog.glb")))


def test_what_falls_over_is_one_line(tmp_path: Path) -> None:
    weight = '<geom name="weight" type="sphere" size="0.1" pos="-0.4 0 0.9" mass="60"/>'
    name = rolling(tmp_path / "weak.xml", [("left", 0.0, 0.2), ("right", 0.0, -0.2)], weight)
    with pytest.raises(ValueError, match=r"weak\.xml: falls over where it stands"):
        Simulation(Scenario(world="hall", robots=1, people=0, robot=name))


@pytest.mark.soak
@pytest.mark.parametrize("make", [walker, quadrotor])
def test_odometry_is_consistent_over_seeds(tmp_path: Path, make: Callable[[Path], str]) -> None:
    """The mean squared error over its covariance, of five seeds, is 0.5 to 2: the covariances are those of the errors, systematic ones included."""
    robot = make(tmp_path)
    squares = np.concatenate([drive(robot, seed, 40)[2] ** 2 for seed in range(5)])
    assert 0.5 < squares.mean() < 2.0, squares.mean(axis=0)
