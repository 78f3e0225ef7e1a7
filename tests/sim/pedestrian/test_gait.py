import numpy as np
import pytest

from sim.pedestrian import gait
from sim.pedestrian.gait import Bodies

DT = 1 / 18
STATURE = np.array([1.55, 1.72, 1.95])


def walked(speed: np.ndarray, seconds: float, turn: float = 0.0):
    """Footings and bodies of three people who walk at speed (3,) m/s, after each step of DT."""
    position, heading = np.zeros((3, 2)), np.zeros(3)
    footing = gait.stand(position, heading, STATURE)
    for k in range(round(seconds / DT)):
        heading = heading + turn * DT
        velocity = min(1.0, k * DT) * speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        position = position + velocity * DT
        bodies = Bodies(position, velocity, heading, STATURE)
        footing = gait.walk(footing, bodies, DT)
        yield footing, bodies


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_standing_feet_do_not_move_and_one_always_stands(turn):
    last = None
    for footing, _ in walked(np.array([0.5, 1.2, 1.8]), 8.0, turn):
        place, yaw = gait.foot_positions(footing)
        assert footing.standing.any(axis=1).all()
        if last is not None:
            both = footing.standing & last[2]
            np.testing.assert_array_equal(place[both], last[0][both])
            np.testing.assert_array_equal(yaw[both], last[1][both])
        last = place, yaw, footing.standing


def test_feet_do_not_jump():
    speed = np.array([0.5, 1.2, 1.8])
    last = None
    for footing, _ in walked(speed, 6.0, 0.3):
        place, _ = gait.foot_positions(footing)
        if last is not None:
            # A swinging foot is as fast as 1.5 / SWING times the body at its fastest.
            assert (np.linalg.norm(place - last, axis=2).max(axis=1) / DT < 5.0 * speed + 0.5).all()
        last = place


def test_steps_grow_with_speed_and_keep_the_walk_ratio():
    states = list(walked(np.array([1.0, 1.2, 1.4]), 12.0))
    # 8 s at full speed: turns of the phase, counted.
    phase = np.unwrap(2 * np.pi * np.array([f.phase for f, _ in states[-144:]]), axis=0) / (2 * np.pi)
    strides = (phase[-1] - phase[0]) / (143 * DT)
    length = np.array([1.0, 1.2, 1.4]) / strides / 2
    assert (np.diff(length) > 0).all()
    np.testing.assert_allclose(length / (2 * strides) / (STATURE / 1.75), gait.WALK_RATIO, rtol=0.05)


def test_a_person_who_stops_brings_the_feet_together():
    *_, (footing, bodies) = walked(np.array([0.8, 1.2, 1.6]), 4.0)
    still = Bodies(bodies.position, np.zeros((3, 2)), bodies.heading, STATURE)
    for _ in range(60):
        footing = gait.walk(footing, still, DT)
    assert footing.standing.all()
    rest = gait.walk(footing, still, DT)
    np.testing.assert_array_equal(rest.phase, footing.phase)
    place, _ = gait.foot_positions(rest)
    assert (np.linalg.norm(place - still.position[:, None], axis=2) < 0.14).all()
    # The left foot is on the left.
    left = np.column_stack([-np.sin(still.heading), np.cos(still.heading)])
    assert (np.einsum("mi,mi->m", place[:, 0] - place[:, 1], left) > 0.03).all()


def test_a_person_who_turns_in_place_takes_steps():
    position = np.zeros((1, 2))
    footing = gait.stand(position, np.zeros(1), np.array([1.7]))
    for _ in range(60):
        footing = gait.walk(footing, Bodies(position, np.zeros((1, 2)), np.full(1, 1.5), np.array([1.7])), DT)
    assert footing.standing.all()
    assert np.abs(footing.planted_yaw - 1.5).max() < 0.41
