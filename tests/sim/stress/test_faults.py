"""Injected faults."""

from dataclasses import replace

import numpy as np
import pytest

from sim.stress.sweeps import Faults
from tests.tracker.walled_room import Room, simulate
from tracker.geometry import Pose
from tracker.geometry.ground import Flat, Grid
from tracker.types import Setup, Tick

ROOM = Room(seed=3, robots=4, ticks=90, landmarks=20)


@pytest.fixture(scope="module")
def recorded() -> tuple[Setup, list[Tick]]:
    setup, ticks, _, _ = simulate(ROOM)
    return setup, ticks


def test_without_faults_nothing_changes(recorded: tuple[Setup, list[Tick]]) -> None:
    setup, ticks = recorded
    assert Faults().degraded_ticks(setup, ticks, 1) == ticks
    assert Faults().degraded_setup(setup) is setup


def test_dropout_has_its_share_and_mean_length(recorded: tuple[Setup, list[Tick]]) -> None:
    setup, ticks = recorded
    degraded = Faults(dropout=0.3).degraded_ticks(setup, ticks * 40, 0)
    gone = np.array([[tick.views[c].sightings is None for tick in degraded] for c in range(4)])
    assert all(view.odometry is not None for tick in degraded for view in tick.views)
    assert gone.mean() == pytest.approx(0.3, abs=0.03)
    ends = (gone[:, :-1] & ~gone[:, 1:]).sum()
    assert gone[:, :-1].sum() / ends == pytest.approx(5.0, rel=0.15)


def test_every_second_robot_is_delayed(recorded: tuple[Setup, list[Tick]]) -> None:
    setup, ticks = recorded
    degraded = Faults(skew=2).degraded_ticks(setup, ticks, 1)
    for k, tick in enumerate(degraded):
        assert tick.index == ticks[k].index
        for c, late in enumerate((0, 2, 0, 2)):
            assert tick.views[c] is ticks[max(k - late, 0)].views[c]


def test_slip_changes_the_length_of_motion_only(recorded: tuple[Setup, list[Tick]]) -> None:
    setup, ticks = recorded
    degraded = Faults(slip=0.2).degraded_ticks(setup, ticks, 5)
    shares = []
    for before, now in zip(ticks, degraded, strict=True):
        for a, b in zip(before.views, now.views, strict=True):
            assert a.odometry is not None
            assert b.odometry is not None
            np.testing.assert_array_equal(a.odometry.T_before_now.rotation, b.odometry.T_before_now.rotation)
            shares.append(b.odometry.T_before_now.translation[0] / a.odometry.T_before_now.translation[0] - 1)
    by_robot = np.array(shares).reshape(len(ticks), 4)
    assert by_robot.std(axis=0) == pytest.approx(np.full(4, 0.1), rel=0.3)
    assert 0.05 < np.abs(by_robot.mean(axis=0)).max() < 0.6


def test_the_first_robot_is_kidnapped_blind(recorded: tuple[Setup, list[Tick]]) -> None:
    setup, ticks = recorded
    degraded = Faults(kidnapped=10 * setup.period).degraded_ticks(setup, ticks, 1)
    blind = [k for k, tick in enumerate(degraded) if tick.views[0].sightings is None]
    assert blind == list(range(45, 55))
    for k in blind:
        odometry = degraded[k].views[0].odometry
        assert odometry is not None
        np.testing.assert_array_equal(odometry.T_before_now.translation, Pose.identity().translation)
        assert degraded[k].views[1:] == ticks[k].views[1:]


def test_knowledge_of_the_terrain(recorded: tuple[Setup, list[Tick]]) -> None:
    x, y = np.meshgrid(np.arange(61) * 0.25, np.arange(41) * 0.25)
    ground = Grid(0.1 * x - 0.05 * y, np.zeros(2), 0.25)
    setup = replace(recorded[0], ground=ground, occluders=ground)
    places = np.random.default_rng(0).uniform([0.0, 0.0], [14.0, 9.0], (50, 2))
    coarse = Faults(terrain="coarse").degraded_setup(setup)
    assert isinstance(coarse.ground, Grid)
    assert coarse.ground.spacing == 2.0
    assert coarse.occluders is None
    # A coarse grid represents a plane exactly.
    np.testing.assert_allclose(coarse.ground.height_at(places), ground.height_at(places), atol=1e-9)
    assert Faults(terrain="none").degraded_setup(setup).ground == Flat(0.0)
    flat = Faults(terrain="flat").degraded_setup(setup).ground
    assert isinstance(flat, Flat)
    assert 0.2 < flat.level < 1.0


def test_bounds() -> None:
    with pytest.raises(ValueError, match=r"dropout is 1\.5, needs 0 to 1"):
        Faults(dropout=1.5)
    with pytest.raises(ValueError, match="terrain is 'lunar', needs one of exact, coarse, flat, none"):
        Faults(terrain="lunar")
    assert Faults(skew=1).to_dict() == {"skew": 1}
