"""Simulations whose robots follow a placement policy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.placement.config import PlacementConfig
from sim.placement.map import MapKey, map_of
from sim.policies.driven_simulation import LEAD_TIME, PolicySimulation
from sim.policies.policy import best_ring
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.robots.samples import ackermann

SCENARIO = Scenario(world="pilsun", difficulty=0.2, seed=1007, robots=2, people=3, frames=6)


def places(simulation: Simulation) -> np.ndarray:
    return np.array([simulation.T_world_robot(name).translation for name in simulation.robots])


@pytest.mark.soak
def test_without_a_policy_it_equals_a_plain_simulation() -> None:
    driven, plain = PolicySimulation(SCENARIO, ""), Simulation(SCENARIO)
    for _ in range(round(LEAD_TIME / SCENARIO.period)):
        plain.step()
    assert driven.frame == 0
    np.testing.assert_array_equal(places(driven), places(plain))
    np.testing.assert_array_equal(driven.feet(), plain.feet())


def test_policies_keep_the_speed_and_the_turning_radius_of_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.policies.driven_simulation.LEAD_TIME", 0.0)
    simulation = PolicySimulation(replace(SCENARIO, speed=0.3, robot=f"rover,{ackermann(tmp_path)}"), "static")
    fastest = 0.0
    for _ in range(12):
        simulation.step()
        fastest = max(fastest, *(abs(drive.speed) for drive in simulation.drives))
    assert 0.2 < fastest < 0.3 + 1e-9
    assert [driver.driver.turning_radius > 0 for driver in simulation._goal_drivers] == [False, True]


@pytest.mark.parametrize("policy", ["", "greedy"])
def test_the_things_and_seats_of_a_scenario_stand_in_its_world(policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.policies.driven_simulation.LEAD_TIME", 0.0)
    scenario = replace(SCENARIO, distractors=4, sitting=0.7)
    driven, plain = PolicySimulation(scenario, policy), Simulation(scenario)
    assert driven.model.ngeom == plain.model.ngeom > Simulation(SCENARIO).model.ngeom
    driven.step()
    assert np.isfinite(places(driven)).all()


@pytest.mark.soak
def test_a_static_team_drives_to_its_ring_and_stays_there() -> None:
    one, other = PolicySimulation(SCENARIO, "static"), PolicySimulation(SCENARIO, "static")
    np.testing.assert_array_equal(places(one), places(other))
    place = map_of(MapKey(SCENARIO.world, SCENARIO.difficulty, SCENARIO.seed, SCENARIO.people))
    ring = place.roadmap.nodes[best_ring(place, 2, PlacementConfig().reach)]
    away = np.linalg.norm(places(one)[:, None, :2] - ring, axis=2)
    assert away.min(axis=0).max() < 0.8
    before = places(one)
    for _ in range(3):
        one.step()
    assert np.linalg.norm(places(one) - before, axis=1).max() < 0.05
