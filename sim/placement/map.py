"""The place in which robots are to be placed: built once, kept for the next episodes, and never changed by them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.crowd.crowd import Crowd, CrowdState
from sim.crowd.goals import make_plans
from sim.crowd.social_force import GOAL, VISIT
from sim.pedestrian import skeleton
from sim.placement.roadmap import Roads
from sim.placement.visibility import Heights, clear
from sim.robots import driving
from sim.robots.rover import HALF_WIDTH
from sim.scenario import Scenario
from tracker.geometry import Array
from worlds import catalogue
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Heightfield
from worlds.world import World

KEPT = 16
"""Maps that are kept."""
APART = 2.0 * HALF_WIDTH + 0.3
"""m between the starts of robots."""


CAMERA, CHEST = 1.5, 1.2
"""m over the floor of a camera and of a person's chest, where lines of sight are planned."""


@dataclass(frozen=True)
class MapKey:
    """What decides a map: the world of this name, difficulty and seed, and how many people live there."""

    world: str
    difficulty: float
    seed: int
    people: int


@dataclass(frozen=True, eq=False)
class PlacementMap:
    """A world with its people's plans, lines of sight and roads.

    stature (p,) m of the people; heights: what one cannot look through; floor: what one stands on, on the same grid; roads: where rovers can
    stand; room: where their middle may be. A pickle or a copy of a map is the key to it.
    """

    key: MapKey
    world: World
    crowd: Crowd
    stature: Array
    floor: Heightfield
    heights: Heights
    room: FreeSpace
    roads: Roads

    def __reduce__(self) -> tuple[object, tuple[MapKey]]:
        return map_of, (self.key,)

    def __deepcopy__(self, memo: dict[int, object]) -> PlacementMap:
        return self

    @cached_property
    def extent(self) -> Array:
        """(2, 2) m [[xmin, ymin], [xmax, ymax]]."""
        return self.world.ground.extent

    @cached_property
    def where_people_may_be(self) -> Array:
        """(k, 3) m: points of the floor spread evenly over where people walk, at most about 400."""
        i, j = np.nonzero(self.world.feet.free)
        every = max(1, round(float(np.sqrt(len(i) / 400))))
        chosen = (i % every == 0) & (j % every == 0)
        points = self.world.feet.origin + self.world.feet.spacing * np.stack([j, i], axis=1)[chosen]
        return np.column_stack([points, self.world.terrain.height_at(points)])

    @cached_property
    def lookouts(self) -> Array:
        """(n, 3) m: the cameras of robots that stand at the places of the roads."""
        return np.column_stack([self.roads.places, self.floor_at(self.roads.places) + CAMERA])

    def sees(self, reach: float) -> NDArray[np.bool_]:
        """(n, k): whether a robot at each place of the roads sees somebody's chest at each of `where_people_may_be`, if nobody is between."""
        return _sees(self, reach)

    @cached_property
    def _clear(self) -> NDArray[np.bool_]:
        chest = self.where_people_may_be + np.array([0.0, 0.0, CHEST])
        return np.stack([clear(self.heights, eye, chest) > 0 for eye in self.lookouts])

    @cached_property
    def traffic(self) -> Array:
        """(k,) how much people are at each of `where_people_may_be`, 1 on average: half of it anywhere, half on shortest ways between any two."""
        where = self.roads.nearest(self.where_people_may_be[:, :2])
        passes = np.zeros(len(self.roads.places))
        # Not a draw: the same pairs of places every time, spread over all of them.
        step = max(1, round(0.618 * len(where)))
        for k in range(len(where)):
            node, goal = int(where[k]), int(where[(k + step) % len(where)])
            while node != goal:
                passes[node] += 1
                node = int(self.roads.onward[node, goal])
        shared = passes[where] / np.bincount(where, minlength=len(passes))[where]
        return 0.5 + 0.5 * shared / max(float(shared.mean()), 1e-9)

    def floor_at(self, points: Array) -> Array:
        """(n, 2) m → (n,) m."""
        return height_on(self.floor, points)

    def people_at(self, state: CrowdState) -> Array:
        """(p, 4): feet x, y, z m and stature m."""
        out = np.empty((len(self.stature), 4))
        out[:, :2], out[:, 3] = state.position, self.stature
        out[:, 2] = height_on(self.floor, out[:, :2])
        return out

    def draw_starts(self, rng: np.random.Generator, robots: int) -> Array:
        """(robots, 3) x, y m and yaw rad, apart from each other. Raises ValueError where so many do not fit in."""
        places, chosen = rng.permutation(self.roads.places), np.zeros((0, 2))
        for place in places:
            if len(chosen) < robots and (np.hypot(*(chosen - place).T) >= APART).all():
                chosen = np.vstack([chosen, place])
        if len(chosen) < robots:
            raise ValueError(f"robots is {robots}, more than the {len(chosen)} that {self.key.world} holds {APART:.1f} m apart")
        return np.column_stack([chosen, rng.uniform(-np.pi, np.pi, robots)])

    def checked_starts(self, starts: Array, robots: int) -> Array:
        """starts as (robots, 3) x, y m and yaw rad. Raises ValueError for another shape, or where one is not free or too near to another."""
        rows = np.asarray(starts, dtype=np.float64)
        if rows.shape != (robots, 3) or not np.isfinite(rows).all():
            raise ValueError(f"starts have shape {rows.shape}, need ({robots}, 3) finite numbers: x, y m and yaw rad of every robot")
        for k, row in enumerate(rows):
            if not self.room.free_at(row[None, :2])[0]:
                raise ValueError(f"start {k} ({row[0]:.2f}, {row[1]:.2f}) m is not free for a robot of {self.key.world} of seed {self.key.seed}")
            gap = np.hypot(*(rows[:k, :2] - row[:2]).T).min(initial=np.inf)
            if gap < 2 * HALF_WIDTH:
                raise ValueError(f"start {k} is {gap:.2f} m from another, needs at least {2 * HALF_WIDTH:.2f} m")
        return rows

    def metres(self, normalised: Array) -> Array:
        """(n, 2) in [−1, 1] over the extent → (n, 2) m."""
        low, high = self.extent
        return low + (normalised + 1.0) / 2.0 * (high - low)

    def normalised(self, metres: Array) -> Array:
        """(n, 2) m → (n, 2) in [−1, 1] over the extent, if within."""
        low, high = self.extent
        return 2.0 * (metres - low) / (high - low) - 1.0

    def start_people(self, rng: np.random.Generator, robots: Array) -> CrowdState:
        """People anywhere, at whatever point of their plans, but not beside robots (r, 2) m. Raises ValueError where they do not fit in."""
        count = self.key.people
        try:
            places = self.world.feet.sample(rng, count + 3 * len(robots) if count else 0, 0.1, 0.8)
        except ValueError as error:
            raise ValueError(f"people is {count}, more than {self.key.world} holds beside {len(robots)} robots: {error}") from None
        places = places[np.linalg.norm(places[:, None] - robots, axis=2).min(axis=1, initial=np.inf) > 1.0][:count]
        if len(places) < count:
            raise ValueError(f"people is {count}, more than the {len(places)} that {self.key.world} holds beside {len(robots)} robots")
        state = self.crowd.start(places, rng.uniform(-np.pi, np.pi, count))
        body, plans = state.body.copy(), self.crowd.plans
        if count:
            visit = rng.integers(plans.itinerary.shape[1], size=count)[plans.group]
            body[:, VISIT], body[:, GOAL] = visit, plans.itinerary[np.arange(count), visit]
        return CrowdState(body, 0.0, state.entered)


@lru_cache(maxsize=KEPT)
def map_of(key: MapKey) -> PlacementMap:
    """The map of that key, as it was built the last time. Raises ValueError for an unknown world or a number out of bounds."""
    scenario = Scenario(world=key.world, difficulty=key.difficulty, seed=key.seed, people=key.people)
    world = catalogue.build(key.world, scenario.stream("world"), key.difficulty)
    people = [scenario.stream(f"person_{i}") for i in range(1, key.people + 1)]
    stature = np.array([skeleton.statures(rng, 1, 0.0)[0] for rng in people])
    plans = make_plans(world.feet, people, scenario.stream("people/goals"))
    floor, top = world.terrain.on_grid, world.tops()
    heights = Heights(top.heights, np.array([*top.origin, top.spacing]))
    room = driving.turning_space(world.wheels)
    return PlacementMap(key, world, Crowd(world.feet, world.terrain, plans), stature, floor, heights, room, Roads.of(room))


@lru_cache(maxsize=KEPT)
def _sees(place: PlacementMap, reach: float) -> NDArray[np.bool_]:
    """As `PlacementMap.sees`, kept: policies ask for it in every decision."""
    away = np.linalg.norm(place.lookouts[:, None, :2] - place.where_people_may_be[:, :2], axis=2)
    out = np.asarray(place._clear & (away <= reach), dtype=np.bool_)
    out.flags.writeable = False
    return out


def height_on(field: Heightfield, points: Array) -> Array:
    """(n, 2) m → (n,) m of a height field at its nearest grid points, bilinear."""
    return _bilinear(field.heights, field.origin, field.spacing, np.ascontiguousarray(points, dtype=np.float64))


@njit(cache=True)
def _bilinear(z, origin, spacing, points):  # type: ignore[no-untyped-def]
    rows, columns = z.shape
    out = np.empty(len(points))
    for n in range(len(points)):
        u = min(max((points[n, 0] - origin[0]) / spacing, 0.0), columns - 1.0)
        v = min(max((points[n, 1] - origin[1]) / spacing, 0.0), rows - 1.0)
        j, i = min(int(u), columns - 2), min(int(v), rows - 2)
        u, v = u - j, v - i
        out[n] = (1 - v) * ((1 - u) * z[i, j] + u * z[i, j + 1]) + v * ((1 - u) * z[i + 1, j] + u * z[i + 1, j + 1])
    return out
