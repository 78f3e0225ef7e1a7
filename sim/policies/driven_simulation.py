"""A simulation whose robots go where a policy of placement sends them, on the same wheels and among the same people as in any other run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.placement import beliefs, visibility
from sim.placement.beliefs import Beliefs
from sim.placement.config import DECISIONS, PlacementConfig
from sim.placement.map import MapKey, map_of
from sim.policies.policy import Briefing
from sim.policies.rollouts import policy_of
from sim.robots.driving import ACCELERATION, ARRIVED, YAW_ACCELERATION, DriveState, Driver, Motion, Traffic
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Array
from worlds.terrain.free_space import FreeSpace

LEAD = 20.0
"""s before the first frame in which the team takes up its places; a run of ten seconds would else show the way there and nothing more."""


@dataclass
class GoToDriver:
    """A rover's driver that goes to one place, giving way as every driver does, and stays there until it is sent elsewhere."""

    wheels: FreeSpace
    goal: Array

    def start(self, position: Array) -> DriveState:
        return Driver(self.wheels, self.goal[None]).start(position)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        if math.dist(self.goal, motion.position) < ARRIVED:
            dv, dw = 2 * ACCELERATION * dt, 2 * YAW_ACCELERATION * dt
            return replace(drive, speed=_nearer_rest(drive.speed, dv), yaw_rate=_nearer_rest(drive.yaw_rate, dw), stuck=0.0, requested_velocity=(0.0, 0.0))
        return Driver(self.wheels, self.goal[None]).step(drive, motion, traffic, dt)

    def sent(self, drive: DriveState, goal: Array, position: Array) -> DriveState:
        """The plan of a rover at position (2,) m once it is sent to goal (2,) m; it keeps its pace."""
        if math.dist(goal, self.goal) < 1e-6:
            return drive
        self.goal = goal
        return replace(self.start(position), speed=drive.speed, yaw_rate=drive.yaw_rate, direction=drive.direction)


def _nearer_rest(value: float, step: float) -> float:
    return math.copysign(max(abs(value) - step, 0.0), value)


class PolicySimulation(Simulation):
    """A Simulation at its first frame, LEAD s after its robots set out, as `policy` (a name of placement_trial.PLAIN) sends them DECISIONS times a
    second; with "" they tour goals of their own, as in any other run, for as long.

    The policy knows the map, where its robots are, and people as far as the environment's beliefs do: seen by straight lines, measured with noise.
    Its draws are of the streams "policy" and "policy/sight". Raises ValueError for an unknown policy, and as Simulation does.
    """

    def __init__(self, scenario: Scenario, policy: str) -> None:
        self._policy = policy_of(policy) if policy else None
        self._place = map_of(MapKey(scenario.world, scenario.difficulty, scenario.seed, scenario.people))
        super().__init__(scenario, self._place.world)
        self._every = max(1, round(1.0 / (DECISIONS * scenario.period)))
        self._config = PlacementConfig(world=scenario.world, robots=scenario.robots, people=scenario.people, difficulty=scenario.difficulty)
        self._beliefs, self._sight = Beliefs.none(scenario.people), scenario.stream("policy/sight")
        if self._policy is not None:
            self._take_over()
        for _ in range(round(LEAD / scenario.period)):
            self.step()
        self.frame = 0

    def step(self) -> None:
        if self._policy is not None and self.frame % self._every == 0:
            self._look()
            self._send()
        super().step()

    def _take_over(self) -> None:
        assert self._policy is not None
        places = self.motions()[:, :2]
        self._errands = [GoToDriver(self._place.room, place.copy()) for place in places]
        self.set_drivers(self._errands, [errand.start(place) for errand, place in zip(self._errands, places, strict=True)])
        self._policy.begin(self._briefing(), self.scenario.stream("policy"))

    def _look(self) -> None:
        """Believe of people what the cameras see of them now."""
        position = self.crowd_state.position
        people = np.column_stack([position, self.world.terrain.height_at(position), self.stature])
        eyes = np.array([(self.T_world_robot(name) @ self.T_body_camera).translation for name in self.robots])
        seen = visibility.seen(self._place.heights, eyes, people, self._config.eyesight)
        mast = eyes.copy()
        mast[:, 2] = np.maximum(eyes[:, 2] - self._place.floor_at(eyes[:, :2]), 0.2)
        measured = beliefs.measure(np.ascontiguousarray(position), mast, self._sight)
        self._beliefs, _ = self._beliefs.predicted(self._every * self.scenario.period).updated(measured, mast, seen)

    def _send(self) -> None:
        assert self._policy is not None
        places = self.motions()[:, :2]
        wanted = self._place.metres(self._policy.act(self._briefing()))
        goals = self._place.roads.places[self._place.roads.nearest(wanted)]
        self.set_drivers(self._errands, [e.sent(d, g, p) for e, d, g, p in zip(self._errands, self.drives, goals, places, strict=True)])

    def _briefing(self) -> Briefing:
        known, b = self._beliefs.known > 0, self._beliefs
        return Briefing(self._place, self._config, self.motions()[:, :3], b.mean[known, :2], b.mean[known, 2:], b.covariance[known, :2, :2], {})
