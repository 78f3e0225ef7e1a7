"""A Simulation whose robots follow a placement policy, on simulated wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.placement import visibility
from sim.placement.config import DECISION_RATE, PlacementConfig
from sim.placement.episode import detector_row
from sim.placement.information import Beliefs, Views, started_robots
from sim.placement.map import MapKey, map_of
from sim.policies.policy import TeamKnowledge
from sim.policies.rollouts import policy_of
from sim.robots.driving import ACCELERATION, ARRIVED, YAW_ACCELERATION, Driver, DriveState, Motion, Traffic
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation, furnished
from tracker.geometry import Array

LEAD_TIME = 20.0
"""Time before the first frame in which the team drives to its first goals, s. A run of ten seconds would otherwise show little else."""


@dataclass
class GoToDriver:
    """A rover's driver that goes to the one goal of `driver`, gives way as every Driver does, and stays there until the goal changes."""

    driver: Driver

    def start(self, position: Array) -> DriveState:
        return self.driver.start(position)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        if math.dist(self.driver.goals[0], motion.position) < ARRIVED:
            dv, dw = 2 * ACCELERATION * dt, 2 * YAW_ACCELERATION * dt
            return replace(drive, speed=_slowed(drive.speed, dv), yaw_rate=_slowed(drive.yaw_rate, dw), stuck=0.0, requested_velocity=(0.0, 0.0))
        return self.driver.step(drive, motion, traffic, dt)

    def with_goal(self, drive: DriveState, goal: Array, position: Array) -> DriveState:
        """The drive state of a rover at position (2,) m with a new goal (2,) m. Speed and yaw rate stay the same."""
        if math.dist(goal, self.driver.goals[0]) < 1e-6:
            return drive
        self.driver = replace(self.driver, goals=goal[None])
        return replace(self.start(position), speed=drive.speed, yaw_rate=drive.yaw_rate, direction=drive.direction)


def _slowed(value: float, step: float) -> float:
    return math.copysign(max(abs(value) - step, 0.0), value)


class PolicySimulation(Simulation):
    """A Simulation whose robots get goals from `policy`, a name of rollouts.BUILT_IN_POLICIES.

    Its first frame is LEAD_TIME s after the start. The policy acts DECISION_RATE times per second. With policy "" the robots drive
    to random goals, as in Simulation.

    The policy knows the map, the poses of its robots and beliefs of people, from simulated visibility and noisy measurements.
    Random numbers come from the streams "policy" and "policy/sight". Raises ValueError for an unknown policy, and as Simulation does.
    """

    def __init__(self, scenario: Scenario, policy: str) -> None:
        self._policy = policy_of(policy) if policy else None
        self._place = map_of(MapKey(scenario.world, scenario.difficulty, scenario.seed, scenario.people))
        super().__init__(scenario, furnished(self._place.world, scenario))
        self._decision_ticks = max(1, round(1.0 / (DECISION_RATE * scenario.period)))
        self._config = PlacementConfig(world=scenario.world, robots=scenario.robots, people=scenario.people, difficulty=scenario.difficulty)
        self._beliefs, self._measurement_rng = Beliefs.none(scenario.people), scenario.stream("policy/sight")
        if self._policy is not None:
            self._install_drivers()
        for _ in range(round(LEAD_TIME / scenario.period)):
            self.step()
        self.frame = 0

    def step(self) -> None:
        if self._policy is not None and self.frame % self._decision_ticks == 0:
            self._update_beliefs()
            self._set_goals()
        super().step()

    def _install_drivers(self) -> None:
        assert self._policy is not None
        places = self.motions()[:, :2]
        own = [driver for driver in self._drivers if isinstance(driver, Driver)]
        self._goal_drivers = [GoToDriver(replace(driver, goals=place[None].copy())) for driver, place in zip(own, places, strict=True)]
        self.set_drivers(self._goal_drivers, [driver.start(place) for driver, place in zip(self._goal_drivers, places, strict=True)])
        self._policy.begin(self._knowledge(), self.scenario.stream("policy"))

    def _update_beliefs(self) -> None:
        """Update the beliefs with what the cameras see."""
        position = self.crowd_state.position
        people = np.column_stack([position, self.world.terrain.height_at(position), self.stature])
        cameras = np.array([(self.T_world_robot(name) @ self.mount(name)).translation for name in self.robots])
        seen = visibility.seen_share(self._place.elevation, cameras, people, self._config.visibility_limits)
        mast = cameras.copy()
        mast[:, 2] = np.maximum(cameras[:, 2] - self._place.floor_at(cameras[:, :2]), 0.2)
        views = Views(detector_row(self._config), started_robots(len(cameras)), seen, mast, people)
        self._beliefs = self._beliefs.predicted(self._decision_ticks * self.scenario.period).observed(views, self._measurement_rng)

    def _set_goals(self) -> None:
        assert self._policy is not None
        places = self.motions()[:, :2]
        points = self._place.metres(self._policy.act(self._knowledge()))
        goals = self._place.roadmap.nodes[self._place.roadmap.nearest(points)]
        rows = zip(self._goal_drivers, self.drives, goals, places, strict=True)
        self.set_drivers(self._goal_drivers, [driver.with_goal(drive, goal, place) for driver, drive, goal, place in rows])

    def _knowledge(self) -> TeamKnowledge:
        known, b = self._beliefs.known > 0, self._beliefs
        return TeamKnowledge(self._place, self._config, self.motions()[:, :3], b.mean[known, :2], b.mean[known, 2:], b.covariance[known, :2, :2], {})
