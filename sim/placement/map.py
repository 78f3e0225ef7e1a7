"""The map of a placement episode: world, walkable space, roadmap and lines of sight. Episodes share cached maps and never change them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, wraps
from typing import Any, NamedTuple, TypeVar, cast
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from sim.crowd.crowd import Crowd, CrowdState
from sim.crowd.goals import make_plans
from sim.crowd.social_force import GOAL, VISIT
from sim.pedestrian import skeleton
from sim.placement.config import FRAMES_PER_DECISION
from sim.placement.information import LANDMARK_SIGMA
from sim.placement.roadmap import Roadmap
from sim.placement.visibility import ElevationMap, line_of_sight
from sim.robots import driving
from sim.robots.rover import HALF_WIDTH
from sim.scenario import Scenario
from sim.sensors.raycast_camera import MISS_RATE, SIGHTING_NOISE, SIGHTING_REACH
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds import catalogue
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Heightfield
from worlds.world import World

CACHED_MAPS = 16
"""Number of maps that are kept after their last use."""
START_SPACING = 2.0 * HALF_WIDTH + 0.3
"""Least distance between the starts of robots, m."""


CAMERA_HEIGHT, CHEST_HEIGHT = 1.5, 1.2
"""Heights above the floor of a camera and of a person's chest, for planned lines of sight, m."""


LANDMARKS, NEAREST, FARTHEST = 140, 0.6, 20.0
"""Number of landmarks, and the range of distances at which rays find them, m."""
SURFACE_MARGIN = 0.4
"""Last part of the line of sight to a landmark that is not tested, m: the column of the landmark's own surface must not hide it."""


class ViewScene(NamedTuple):
    """The arrays of a map that kernels need for views.

    elevation: ElevationMap.packed. top (rows, columns) m, frame (3,): of the same map. floor (rows, columns) m, origin (2,) m, spacing m: the ground.
    landmarks: nodes (n, 2) m of the roadmap, and the information (n, 3, 3) about x, y, yaw that a decision at each of them gives.
    """

    elevation: tuple[Array, Array, Array]
    top: Array
    frame: Array
    floor: Array
    origin: Array
    spacing: float
    landmarks: tuple[Array, Array]


@dataclass(frozen=True)
class MapKey:
    """The key that determines a map: name, difficulty and seed of its world, and its number of people."""

    world: str
    difficulty: float
    seed: int
    people: int


@dataclass(frozen=True, eq=False)
class PlacementMap:
    """A world with its crowd, roadmap and lines of sight.

    stature (p,) m: of the people. elevation: tops of everything that hides people. floor: the ground, on the same grid.
    free_space: free positions of the centre of a rover. roadmap: paths of rovers through it.
    A pickle of a map holds its key alone; a deep copy of a map is the map itself.
    """

    key: MapKey
    world: World
    crowd: Crowd
    stature: Array
    floor: Heightfield
    elevation: ElevationMap
    free_space: FreeSpace
    roadmap: Roadmap

    def __reduce__(self) -> tuple[object, tuple[MapKey]]:
        return map_of, (self.key,)

    def __deepcopy__(self, memo: dict[int, object]) -> PlacementMap:
        return self

    @cached_property
    def extent(self) -> Array:
        """Extent of the world (2, 2) m: [[xmin, ymin], [xmax, ymax]]."""
        return self.world.ground.extent

    @cached_property
    def walkable_points(self) -> Array:
        """(k, 3) m: points of the floor, spread evenly over the walkable area; at most about 400."""
        i, j = np.nonzero(self.world.feet.free)
        every = max(1, round(float(np.sqrt(len(i) / 400))))
        chosen = (i % every == 0) & (j % every == 0)
        points = self.world.feet.origin + self.world.feet.spacing * np.stack([j, i], axis=1)[chosen]
        return np.column_stack([points, self.world.terrain.height_at(points)])

    @cached_property
    def node_cameras(self) -> Array:
        """(n, 3) m: camera positions of robots at the nodes of the roadmap."""
        return np.column_stack([self.roadmap.nodes, self.floor_at(self.roadmap.nodes) + CAMERA_HEIGHT])

    def visible_from_nodes(self, reach: float) -> NDArray[np.bool_]:
        """(n, k): whether a robot at each node of the roadmap sees a chest at each of `walkable_points`, without occlusion by people."""
        return _visible_from_nodes(self, reach)

    @cached_property
    def scene(self) -> ViewScene:
        """The arrays of this map that kernels need for views."""
        floor = self.floor
        landmarks = self.roadmap.nodes, landmark_information(self)
        return ViewScene(self.elevation.packed, self.elevation.top, self.elevation.frame, floor.heights, floor.origin, floor.spacing, landmarks)

    def surface_points(self, count: int, rng: np.random.Generator) -> Array:
        """Up to `count` random surface points (n, 3) m: first hits of rays from camera positions with the ground or objects."""
        along = np.arange(NEAREST, FARTHEST, 0.1)
        cameras = self.node_cameras[rng.integers(len(self.node_cameras), size=4 * count)]
        azimuth, elevation = rng.uniform(-np.pi, np.pi, len(cameras)), np.radians(rng.uniform(-40.0, 20.0, len(cameras)))
        direction = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
        points = cameras[:, None] + along[:, None] * direction[:, None]
        top, frame = self.elevation.top, self.elevation.frame
        j, i = (np.floor((points[..., axis] - frame[axis]) / frame[2] + 0.5).astype(int) for axis in (0, 1))
        inside = (i >= 0) & (j >= 0) & (i < top.shape[0]) & (j < top.shape[1])
        hits = inside & (points[..., 2] < top[np.clip(i, 0, top.shape[0] - 1), np.clip(j, 0, top.shape[1] - 1)])
        first = hits.argmax(axis=1)
        found = np.flatnonzero(hits.any(axis=1) & (first > 0))[:count]
        return points[found, first[found]]

    @cached_property
    def traffic(self) -> Array:
        """(k,) expected density of people at each of `walkable_points`, with mean 1.

        Half of it is uniform, half lies on shortest paths between pairs of points.
        """
        where = self.roadmap.nearest(self.walkable_points[:, :2])
        passes = np.zeros(len(self.roadmap.nodes))
        # The pairs of points are fixed and spread over all points, without random draws.
        step = max(1, round(0.618 * len(where)))
        for k in range(len(where)):
            node, goal = int(where[k]), int(where[(k + step) % len(where)])
            while node != goal:
                passes[node] += 1
                node = int(self.roadmap.next_node[node, goal])
        passes_per_point = passes[where] / np.bincount(where, minlength=len(passes))[where]
        return 0.5 + 0.5 * passes_per_point / max(float(passes_per_point.mean()), 1e-9)

    def floor_at(self, points: Array) -> Array:
        """Heights (n,) m of the floor at points (n, 2) m."""
        return height_on(self.floor, points)

    def people_at(self, state: CrowdState) -> Array:
        """People of a crowd (p, 4): feet x, y, z m and stature m."""
        out = np.empty((len(self.stature), 4))
        out[:, :2], out[:, 3] = state.position, self.stature
        out[:, 2] = height_on(self.floor, out[:, :2])
        return out

    def draw_starts(self, rng: np.random.Generator, robots: int) -> Array:
        """Random starts (robots, 3): x, y m and yaw rad. Raises ValueError where they do not fit into the world START_SPACING apart."""
        places, chosen = rng.permutation(self.roadmap.nodes), np.zeros((0, 2))
        for place in places:
            if len(chosen) < robots and (np.hypot(*(chosen - place).T) >= START_SPACING).all():
                chosen = np.vstack([chosen, place])
        if len(chosen) < robots:
            raise ValueError(f"robots is {robots}, more than the {len(chosen)} that {self.key.world} holds {START_SPACING:.1f} m apart")
        return np.column_stack([chosen, rng.uniform(-np.pi, np.pi, robots)])

    def checked_starts(self, starts: Array, robots: int) -> Array:
        """starts as an array (robots, 3): x, y m and yaw rad. Raises ValueError for another shape, and for starts that are occupied or too close."""
        rows = np.asarray(starts, dtype=np.float64)
        if rows.shape != (robots, 3) or not np.isfinite(rows).all():
            raise ValueError(f"starts have shape {rows.shape}, need ({robots}, 3) finite numbers: x, y m and yaw rad of every robot")
        for k, row in enumerate(rows):
            if not self.free_space.free_at(row[None, :2])[0]:
                raise ValueError(f"start {k} ({row[0]:.2f}, {row[1]:.2f}) m is not free for a robot of {self.key.world} of seed {self.key.seed}")
            gap = np.hypot(*(rows[:k, :2] - row[:2]).T).min(initial=np.inf)
            if gap < 2 * HALF_WIDTH:
                raise ValueError(f"start {k} is {gap:.2f} m from another, needs at least {2 * HALF_WIDTH:.2f} m")
        return rows

    def metres(self, normalised: Array) -> Array:
        """Points (n, 2) m of coordinates (n, 2) in [−1, 1] over the extent."""
        low, high = self.extent
        return low + (normalised + 1.0) / 2.0 * (high - low)

    def normalised(self, metres: Array) -> Array:
        """Coordinates (n, 2) of points (n, 2) m: in [−1, 1] within the extent."""
        low, high = self.extent
        return 2.0 * (metres - low) / (high - low) - 1.0

    def start_people(self, rng: np.random.Generator, robots: Array) -> CrowdState:
        """People at random positions and stages of their plans, at least 1 m from robots (r, 2) m. Raises ValueError where they do not fit."""
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


Kept = TypeVar("Kept", bound=Callable[..., Any])


def kept_with_map(function: Kept) -> Kept:
    """Cache a function of a map, and of other positional arguments, for as long as the map exists. Results must not refer to the map."""
    found: WeakKeyDictionary[PlacementMap, dict[Any, Any]] = WeakKeyDictionary()

    @wraps(function)
    def cached(place: PlacementMap, *more: Any) -> Any:
        of = found.setdefault(place, {})
        if more not in of:
            of[more] = function(place, *more)
        return of[more]

    return cast(Kept, cached)


_in_use: WeakValueDictionary[MapKey, PlacementMap] = WeakValueDictionary()
"""The maps of all episodes, also where they are more than the cache holds."""


def map_of(key: MapKey) -> PlacementMap:
    """The map of a key: the one in use, a cached one, or a new one. Raises ValueError for an unknown world or a number out of bounds."""
    found = _in_use.get(key)
    if found is None:
        found = _in_use[key] = _built(key)
    return found


@lru_cache(maxsize=CACHED_MAPS)
def _built(key: MapKey) -> PlacementMap:
    scenario = Scenario(world=key.world, difficulty=key.difficulty, seed=key.seed, people=key.people)
    world = catalogue.build(key.world, scenario.stream("world"), key.difficulty)
    people = [scenario.stream(f"person_{i}") for i in range(1, key.people + 1)]
    stature = np.array([skeleton.statures(rng, 1, 0.0)[0] for rng in people])
    plans = make_plans(world.feet, people, scenario.stream("people/goals"))
    floor, top = world.terrain.on_grid, world.tops()
    elevation = ElevationMap(top.heights, np.array([*top.origin, top.spacing]))
    free_space = driving.turning_space(world.wheels)
    return PlacementMap(key, world, Crowd(world.feet, world.terrain, plans), stature, floor, elevation, free_space, Roadmap.of(free_space))


def landmark_information(place: PlacementMap) -> Array:
    """Information (n, 3, 3) about x, y, yaw of a robot at each node of the roadmap, from the azimuths of landmarks in a decision.

    The seed of the map draws the landmarks. Their positions have errors of LANDMARK_SIGMA, and sightings have SIGHTING_NOISE.
    """
    points = place.surface_points(LANDMARKS, np.random.default_rng(place.key.seed))
    out = np.zeros((len(place.node_cameras), 3, 3))
    for k, camera in enumerate(place.node_cameras):
        dx, dy = (points[:, :2] - camera[:2]).T
        square = np.maximum(dx**2 + dy**2, 0.01)
        visible = line_of_sight(place.elevation, camera, points, SURFACE_MARGIN) * (square < SIGHTING_REACH**2)
        H = np.stack([dy / square, -dx / square, -np.ones(len(points))], axis=1)
        variance = SIGHTING_NOISE**2 / FRAMES_PER_DECISION + LANDMARK_SIGMA**2 / square
        out[k] = (H * ((1.0 - MISS_RATE) * visible / variance)[:, None]).T @ H
    return out


@kept_with_map
def _visible_from_nodes(place: PlacementMap, reach: float) -> NDArray[np.bool_]:
    """As `PlacementMap.visible_from_nodes`, cached: policies need it in every decision."""
    away = np.linalg.norm(place.node_cameras[:, None, :2] - place.walkable_points[:, :2], axis=2)
    chest = place.walkable_points + np.array([0.0, 0.0, CHEST_HEIGHT])
    visible = np.stack([line_of_sight(place.elevation, camera, chest) > 0 for camera in place.node_cameras])
    out = np.asarray(visible & (away <= reach), dtype=np.bool_)
    out.flags.writeable = False
    return out


def height_on(field: Heightfield, points: Array) -> Array:
    """Heights (n,) m of a height field at points (n, 2) m, by bilinear interpolation. Points outside take the value of the border."""
    return _bilinear(field.heights, field.origin, field.spacing, np.ascontiguousarray(points, dtype=np.float64))


@njit(cache=True)
def _bilinear(z, origin, spacing, points):  # type: ignore[no-untyped-def]
    out = np.empty(len(points))
    for n in range(len(points)):
        out[n] = bilinear_at(z, origin, spacing, points[n, 0], points[n, 1])
    return out


@njit(cache=True)
def bilinear_at(z, origin, spacing, x, y):  # type: ignore[no-untyped-def]
    """The height at one point (x, y) m, as `height_on` gives it."""
    rows, columns = z.shape
    u, v = min(max((x - origin[0]) / spacing, 0.0), columns - 1.0), min(max((y - origin[1]) / spacing, 0.0), rows - 1.0)
    j, i = min(int(u), columns - 2), min(int(v), rows - 2)
    u, v = u - j, v - i
    return (1 - v) * ((1 - u) * z[i, j] + u * z[i, j + 1]) + v * ((1 - u) * z[i + 1, j] + u * z[i + 1, j + 1])
