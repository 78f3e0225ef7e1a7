"""Where the robots and the people of a scenario are at first, and who moves them from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.crowd.crowd import Crowd, CrowdState, PedestrianModel
from sim.crowd.goals import Schedule, make_plans, order_by_group
from sim.robots import rover
from sim.robots.driving import Pilot
from sim.scenario import Scenario
from tracker.geometry import Array, quaternion_from_rotation, rotation_z
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.walk_surface import Terrain
from worlds.world import World

ROVER_DISTANCE = 1.5
"""m between the starts of rovers."""
PERSON_ROVER_DISTANCE = 1.0
"""m that people keep from rovers at first."""


@dataclass(frozen=True, eq=False)
class InitialStates:
    """robots (r, 3) x, y m and yaw rad, with a driver each; people: their state, and walkers, who move them."""

    robots: Array
    drivers: tuple[Pilot, ...]
    people: CrowdState
    pedestrians: PedestrianModel

    def check(self, scenario: Scenario) -> None:
        """Raises ValueError where this is the start of more or fewer robots, drivers or people than the scenario has."""
        wanted, people = (scenario.robots, 3), len(self.people.position)
        if self.robots.shape != wanted or len(self.drivers) != scenario.robots:
            raise ValueError(f"start has robots of shape {self.robots.shape} and {len(self.drivers)} drivers, needs {wanted} and {scenario.robots}")
        if people != scenario.people:
            raise ValueError(f"start has {people} people, needs {scenario.people}")


def draw_robots(scenario: Scenario, free_space: FreeSpace) -> Array:
    """(robots, 3) x, y m and yaw rad: apart from each other where there is room to turn, heading anywhere.

    Raises ValueError where they do not fit in.
    """
    rng = scenario.stream("robots/start")
    try:
        places = free_space.sample(rng, scenario.robots, 0.1, ROVER_DISTANCE)
    except ValueError as error:
        raise ValueError(f"robots is {scenario.robots}, more than {scenario.world} holds: {error}") from None
    return np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places))])


def draw_places(scenario: Scenario, free_space: FreeSpace) -> Array:
    """(k, 2) m apart from each other, for the people who are there at first and some more: about three may be too near to each rover.

    Raises ValueError where they do not fit in.
    """
    wanted = min(scenario.at_once or scenario.people, scenario.people)
    try:
        return free_space.sample(scenario.stream("people/places"), wanted + 3 * scenario.robots if wanted else 0, 0.1, 0.8)
    except ValueError as error:
        message = f"people is {wanted}, more than {scenario.world} holds at once beside {scenario.robots} robots"
        raise ValueError(f"{message}: {error}") from None


def make_crowd(scenario: Scenario, world: World, people: list[np.random.Generator], free: Array) -> tuple[Crowd, CrowdState]:
    """People on their own plans, at the first of the places `free` (k, 2) m; people: the stream of each.

    Raises ValueError where there are too few places.
    """
    rng, free_space = scenario.stream("people/start"), world.feet
    schedule = Schedule(world.spawn, scenario.at_once, scenario.frames * scenario.period)
    plans = make_plans(free_space, people, scenario.stream("people/goals"), schedule)
    first = plans.at_once or len(people)
    if len(free) < first:
        raise ValueError(f"people is {first}, needs at most {len(free)}: more do not fit beside {scenario.robots} robots")
    places = np.zeros((len(people), 2))
    places[:first] = order_by_group(free[:first], plans.group[:first])
    crowd = Crowd(free_space, world.terrain, plans)
    return crowd, crowd.start(places, rng.uniform(-np.pi, np.pi, len(people)))


def clear_of_robots(robots: Array, places: Array) -> Array:
    """Of places (k, 2) m those that are not beside robots (r, 2) m."""
    return places[np.linalg.norm(places[:, None] - robots, axis=2).min(axis=1, initial=np.inf) > PERSON_ROVER_DISTANCE]


def resting_pose(terrain: Terrain, place: Array, yaw: float) -> Array:
    """(7,) position and quaternion of a rover with its wheels a little above the ground, as it slopes, at place (2,) m."""
    wheels = rover.wheel_positions()[:, :2] @ rotation_z(yaw)[:2, :2].T
    height = terrain.height_at(place + wheels)
    A = np.column_stack([wheels, np.ones(4)])
    east, north, middle = np.linalg.lstsq(A, height, rcond=None)[0]
    up = np.array([-east, -north, 1.0]) / np.sqrt(1 + east**2 + north**2)
    x = rotation_z(yaw)[:, 0] - (rotation_z(yaw)[:, 0] @ up) * up
    x = x / np.linalg.norm(x)
    highest = middle + float((height - A @ [east, north, middle]).max())
    R = np.stack([x, np.cross(up, x), up], axis=1)
    return np.concatenate([[*place, highest + (rover.WHEEL_RADIUS + 0.01) / up[2]], quaternion_from_rotation(R)])
