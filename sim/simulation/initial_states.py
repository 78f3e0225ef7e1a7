"""Initial states of a scenario: poses of robots, states of people, and the models that move them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.crowd.crowd import Crowd, CrowdState, PedestrianModel
from sim.crowd.goals import Schedule, drawn_postures, make_plans, order_by_group
from sim.robots import rover
from sim.robots.driving import Pilot
from sim.scenario import Scenario
from tracker.geometry import Array, quaternion_from_rotation, rotation_z
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.walk_surface import Terrain
from worlds.world import World

ROVER_DISTANCE = 1.5
"""m: smallest distance between rovers at the start."""
PERSON_ROVER_DISTANCE = 1.0
"""m: smallest distance of people from rovers at the start."""


@dataclass(frozen=True, eq=False)
class InitialStates:
    """robots: (r, 3) x, y m and yaw rad, with one driver each. people: their state. pedestrians: the model that moves them."""

    robots: Array
    drivers: tuple[Pilot, ...]
    people: CrowdState
    pedestrians: PedestrianModel

    def check(self, scenario: Scenario) -> None:
        """Raises ValueError if the numbers of robots, drivers or people are not those of the scenario."""
        wanted, people = (scenario.robots, 3), len(self.people.position)
        if self.robots.shape != wanted or len(self.drivers) != scenario.robots:
            raise ValueError(f"start has robots of shape {self.robots.shape} and {len(self.drivers)} drivers, needs {wanted} and {scenario.robots}")
        if people != scenario.people:
            raise ValueError(f"start has {people} people, needs {scenario.people}")


def draw_robots(scenario: Scenario, free_space: FreeSpace) -> Array:
    """Random x, y m and yaw rad (robots, 3), at least ROVER_DISTANCE apart.

    Raises ValueError if they do not fit in.
    """
    rng = scenario.stream("robots/start")
    try:
        places = free_space.sample(rng, scenario.robots, 0.1, ROVER_DISTANCE)
    except ValueError as error:
        raise ValueError(f"robots is {scenario.robots}, more than {scenario.world} holds: {error}") from None
    return np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places))])


def draw_places(scenario: Scenario, free_space: FreeSpace) -> Array:
    """Random positions (k, 2) m for the people who are present at first, and three spare ones for each rover.

    Spare positions replace those that are too near to rovers. If not all people fit in, those who sit get no position.
    Raises ValueError if the others do not fit in either.
    """
    wanted = min(scenario.at_once or scenario.people, scenario.people)
    for standing in sorted({wanted, wanted - scenario.sitters}, reverse=True):
        try:
            return free_space.sample(scenario.stream("people/places"), standing + 3 * scenario.robots if wanted else 0, 0.1, 0.8)
        except ValueError as error:
            reason = error
    message = f"people is {wanted}, more than {scenario.world} holds at once beside {scenario.robots} robots"
    raise ValueError(f"{message}: {reason}") from None


def make_crowd(
    scenario: Scenario, world: World, people: list[np.random.Generator], free: Array, robots: Array | None = None
) -> tuple[Crowd, CrowdState]:
    """A crowd with random plans, and its state at the first of the positions `free` (k, 2) m. people: the random stream of each.

    robots: (r, 2) m; talking groups are placed clear of them.

    Raises ValueError if there are too few positions or seats.
    """
    rng, free_space = scenario.stream("people/start"), world.feet
    schedule = Schedule(world.spawn, scenario.at_once, scenario.frames * scenario.period)
    plans = make_plans(free_space, people, scenario.stream("people/goals"), schedule)
    first = plans.at_once or len(people)
    if len(free) < first - scenario.sitters:
        raise ValueError(f"people is {first}, needs at most {len(free)}: more do not fit beside {scenario.robots} robots")
    places = np.zeros((len(people), 2))
    if len(free) >= first:
        places[:first] = order_by_group(free[:first], plans.group[:first])
    postures = None
    if scenario.sitting or scenario.groups:
        plans, postures = drawn_postures(plans, world.seats, (scenario.sitting, scenario.groups), scenario.stream("people/postures"))
        if len(free) < first:
            standing = np.setdiff1d(np.arange(first), postures.sitters)
            places[standing] = free[: len(standing)]
    crowd = Crowd(free_space, world.terrain, plans, postures)
    return crowd, crowd.start(places, rng.uniform(-np.pi, np.pi, len(people)), robots)


def clear_of_robots(robots: Array, places: Array) -> Array:
    """The places, of (k, 2) m, that are more than PERSON_ROVER_DISTANCE from all robots (r, 2) m."""
    return places[np.linalg.norm(places[:, None] - robots, axis=2).min(axis=1, initial=np.inf) > PERSON_ROVER_DISTANCE]


def resting_pose(terrain: Terrain, place: Array, yaw: float) -> Array:
    """Position m and quaternion wxyz (7,) of a rover at place (2,) m, parallel to the ground, with its wheels just above it."""
    wheels = rover.wheel_positions()[:, :2] @ rotation_z(yaw)[:2, :2].T
    height = terrain.height_at(place + wheels)
    A = np.column_stack([wheels, np.ones(4)])
    east, north, middle = np.linalg.lstsq(A, height, rcond=None)[0]
    up = np.array([-east, -north, 1.0]) / np.sqrt(1 + east**2 + north**2)
    highest = middle + float((height - A @ [east, north, middle]).max())
    return np.concatenate([[*place, highest + (rover.WHEEL_RADIUS + 0.01) / up[2]], quaternion_from_rotation(rotation_on_slope(up, yaw))])


def rotation_on_slope(up: Array, yaw: float) -> Array:
    """Rotation (3, 3) with the z axis up (3,), a unit vector, and the x axis above that of rotation_z(yaw)."""
    x = rotation_z(yaw)[:, 0]
    x = x - (x @ up) * up
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up], axis=1)
