import math

import numpy as np
import pytest

from sim.robots.driving import ACCELERATION, TOP_SPEED, TOP_YAW_RATE, Driver, DriveState, Motion, Traffic, make_driver, turning_space
from tests.sim.yard import yard

DT = 0.05
NOBODY = Traffic(np.zeros((0, 2)), np.zeros(0))


def drive(
    driver: Driver, start: tuple[float, float, float], seconds: float, traffic: Traffic = NOBODY, stuck_wheels: bool = False
) -> tuple[np.ndarray, list[DriveState]]:
    """Poses (n, 3) x, y, yaw of an ideal rover that follows its commands, and the states of its driver."""
    x, y, yaw = start
    plan = driver.start(np.array([x, y]))
    poses, plans = [], []
    for _ in range(round(seconds / DT)):
        moving = 0.0 if stuck_wheels and plan.retreat <= 0 else 1.0
        motion = Motion(np.array([x, y]), yaw, moving * plan.speed, moving * plan.yaw_rate)
        plan = driver.step(plan, motion, traffic, DT)
        yaw += moving * plan.yaw_rate * DT
        x, y = x + moving * plan.speed * math.cos(yaw) * DT, y + moving * plan.speed * math.sin(yaw) * DT
        poses.append((x, y, yaw))
        plans.append(plan)
    return np.array(poses), plans


def test_it_reaches_goal_after_goal_and_stays_in_the_room():
    room = turning_space(yard().wheels)
    driver = Driver(room, np.array([[4.0, 4.0], [-4.0, -4.0], [4.0, -4.0]]))
    poses, plans = drive(driver, (-4.0, 4.0, 3.0), 60.0)
    assert plans[-1].visit >= 2
    assert room.clearance_at(poses[:, :2]).min() > -0.1


def test_commands_are_bounded_and_smooth():
    driver = make_driver(turning_space(yard().wheels), np.random.default_rng(2))
    _, plans = drive(driver, (-4.0, 4.0, 0.0), 60.0)
    speed, turn = np.array([p.speed for p in plans]), np.array([p.yaw_rate for p in plans])
    assert np.abs(speed).max() <= TOP_SPEED
    assert np.abs(turn).max() <= TOP_YAW_RATE
    # Braking, also out of driving backwards, may be twice as hard.
    assert np.diff(np.abs(speed)).max() <= ACCELERATION * DT + 1e-9
    assert np.abs(np.diff(speed)).max() <= 2 * ACCELERATION * DT + 1e-9


def test_it_drives_around_a_standing_person():
    driver = Driver(turning_space(yard().wheels), np.array([[4.0, 3.0], [-4.0, -3.0]]))
    person = Traffic(np.array([[0.0, 3.0]]), np.array([0.22]))
    poses, plans = drive(driver, (-4.0, 3.0, 0.0), 20.0, person)
    assert (np.linalg.norm(poses[:, :2] - person.position, axis=1) > 0.22 + 0.4).all()
    assert poses[:, 0].max() > 1.0
    assert plans[-1].visit > 0


def test_it_requests_way_when_blocked_and_then_takes_another_goal():
    driver = Driver(turning_space(yard().wheels), np.array([[4.0, 3.0], [-4.0, -3.0]]))
    # A ring of people who do not move.
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = Traffic(np.array([-4.0, 3.0]) + 1.4 * np.column_stack([np.cos(angle), np.sin(angle)]), np.full(12, 0.22))
    poses, plans = drive(driver, (-4.0, 3.0, 0.0), 8.0, ring)
    assert max(math.hypot(*p.requested_velocity) for p in plans) == pytest.approx(TOP_SPEED)
    assert any(p.retreat > 0 for p in plans)
    assert (np.linalg.norm(poses[:, None, :2] - ring.position, axis=2) > 0.22 + 0.4).all()
    assert all(p.requested_velocity == (0.0, 0.0) for p in drive(driver, (-4.0, 3.0, 0.0), 8.0)[1])


def test_people_beside_the_lane_do_not_stop_it():
    driver = Driver(turning_space(yard().wheels), np.array([[4.0, 3.0], [-4.0, -3.0]]))
    beside = Traffic(np.array([[0.0, 4.6], [-5.5, 3.0]]), np.array([0.22, 0.22]))
    assert drive(driver, (-4.0, 3.0, 0.0), 9.0, beside)[0][-1, 0] > 1.0


def test_a_stuck_rover_reverses():
    driver = Driver(turning_space(yard().wheels), np.array([[4.0, 3.0], [-4.0, -3.0]]))
    _, plans = drive(driver, (-4.0, 3.0, 0.0), 6.0, stuck_wheels=True)
    assert min(p.speed for p in plans) < -0.1
    assert plans[-1].visit >= 1


def test_a_start_outside_of_free_space_is_handled():
    driver = Driver(turning_space(yard().wheels), np.array([[4.0, 4.0]]))
    assert not driver.wheels.free_at(np.array([[-5.7, 0.0]]))[0]
    poses, _ = drive(driver, (-5.7, 0.0, 1.0), 6.0)
    assert driver.wheels.free_at(poses[-1:, :2])[0]


def test_turning_space_is_within_free_space():
    wheels = yard().wheels
    room = turning_space(wheels)
    assert not (room.free & ~wheels.free).any()
    assert wheels.clearance[room.free].min() >= 0.19
    assert room.area > 0.5 * wheels.area
