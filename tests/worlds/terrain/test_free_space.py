"""Free space, ways through it and places in it, against brute force."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import csgraph

from worlds.terrain.free_space import FEET, WHEELS, FreeSpace, Limits, distance, free_space, links
from worlds.terrain.heightfield import Heightfield

SPACING = 0.1


def maze(seed: int, shape: tuple[int, int] = (60, 80)) -> FreeSpace:
    """A room with boxes in it, the largest connected part."""
    rng = np.random.default_rng(seed)
    free = np.zeros(shape, dtype=bool)
    free[1:-1, 1:-1] = True
    for _ in range(12):
        i, j = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        free[i : i + rng.integers(3, 12), j : j + rng.integers(3, 12)] = False
    labels, _ = ndimage.label(free)
    free = labels == 1 + np.argmax(np.bincount(labels.ravel())[1:])
    return FreeSpace(free, np.array([-3.0, 2.0]), SPACING)


def open_room(shape: tuple[int, int] = (81, 81)) -> FreeSpace:
    free = np.zeros(shape, dtype=bool)
    free[1:-1, 1:-1] = True
    return FreeSpace(free, np.zeros(2), SPACING)


def nodes(space: FreeSpace) -> np.ndarray:
    rows, columns = space.free.shape
    return space.origin + space.spacing * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)


@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_the_distance_to_the_nearest_of_all_blocked_points_less_half_a_cell(seed: int) -> None:
    space = maze(seed)
    p = nodes(space)
    free, blocked = p[space.free], p[~space.free]
    brute = np.array([np.hypot(*(blocked - q).T).min() for q in free]) - SPACING / 2
    np.testing.assert_allclose(space.clearance_at(free), brute, atol=1e-9)
    assert (space.clearance_at(free) > 0).all()
    assert (space.clearance_at(blocked) < 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_away_leads_to_more_clearance(seed: int) -> None:
    """But on the ridge between two walls, which a step crosses."""
    space = maze(seed)
    p = np.random.default_rng(seed).uniform(space.origin, space.origin + np.array([7.9, 5.9]), (5000, 2))
    p = p[np.abs(space.clearance_at(p)) < 0.3]
    away = space.away_at(p)
    length = np.linalg.norm(away, axis=1)
    assert np.all((np.abs(length - 1) < 1e-9) | (length == 0))
    gain = space.clearance_at(p + 0.02 * away) - space.clearance_at(p)
    assert np.mean(gain > 0.005) > 0.93
    assert np.median(gain) > 0.019


def test_distance_in_the_open_is_the_straight_one_but_for_walls() -> None:
    space = open_room((161, 161))
    goal = np.array([8.0, 8.0])
    field = space.distance_to(goal)
    p = nodes(space)
    middle = space.clearance > 2.0
    straight = np.hypot(*np.moveaxis(p - goal, -1, 0))
    assert np.all(field[middle] >= straight[middle] - 1e-6)
    assert np.all(field[middle] <= 1.04 * straight[middle] + 0.05)
    far = middle & (straight > 1.0)
    direction = space.direction_at(field, p[far])
    cosine = (direction * (goal - p[far])).sum(axis=1) / straight[far]
    assert cosine.min() > np.cos(np.deg2rad(9))
    assert cosine.mean() > np.cos(np.deg2rad(4))


def test_distance_is_infinite_only_where_nobody_can_be() -> None:
    space = maze(2)
    goal = nodes(space)[space.free][0]
    np.testing.assert_array_equal(np.isfinite(space.distance_to(goal)), space.free)


@pytest.mark.parametrize("seed", range(3))
def test_following_the_direction_leads_to_the_goal_through_free_space(seed: int) -> None:
    space = maze(seed)
    rng = np.random.default_rng(seed)
    goal = space.sample(rng, 1, 0.1, 0.0)[0]
    p = space.sample(rng, 30, 0.05, 0.1)
    field = space.distance_to(goal)
    for _ in range(1200):
        p = p + 0.03 * space.direction_at(field, p)
        assert space.clearance_at(p).min() > -0.5 * SPACING
    assert np.hypot(*(p - goal).T).max() < 0.15


def test_direction_out_of_blocked_places_leads_back() -> None:
    space = open_room()
    field = space.distance_to([4.0, 4.0])
    direction = space.direction_at(field, [[-1.0, 4.0], [4.0, 9.5]])
    np.testing.assert_allclose(direction, [[1, 0], [0, -1]], atol=1e-6)
    np.testing.assert_array_equal(space.direction_at(field, [[4.0, 4.0]]), [[0, 0]])


@pytest.mark.parametrize("seed", range(4))
def test_a_route_stays_in_free_space_and_is_no_longer_than_the_field_says(seed: int) -> None:
    space = maze(seed)
    start, goal = space.sample(np.random.default_rng(seed), 2, 0.1, 2.0)
    route = space.route(start, goal)
    np.testing.assert_array_equal(route[[0, -1]], [start, goal])
    line = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(route)])
    assert space.free_at(line).all()
    length = np.hypot(*np.diff(route, axis=0).T).sum()
    field = space.distance_to(goal)
    j, i = np.rint((start - space.origin) / SPACING).astype(int)
    assert np.hypot(*(goal - start)) - 1e-9 <= length <= field[i, j] + 0.3


def test_a_route_in_the_open_is_straight() -> None:
    assert len(open_room().route([2.0, 2.0], [6.0, 5.0])) == 2


def test_no_route_from_or_to_a_wall() -> None:
    space = open_room()
    for start, goal, name in (([0.0, 4.0], [4.0, 4.0], "start"), ([4.0, 4.0], [99.0, 0.0], "goal")):
        with pytest.raises(ValueError, match=name):
            space.route(start, goal)


def test_a_sample_keeps_clear_and_apart() -> None:
    space = maze(0)
    points = space.sample(np.random.default_rng(0), 12, 0.2, 0.6)
    assert points.shape == (12, 2)
    assert space.clearance_at(points).min() >= 0.2
    gaps = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    assert gaps[np.triu_indices(12, 1)].min() >= 0.6
    np.testing.assert_array_equal(points, space.sample(np.random.default_rng(0), 12, 0.2, 0.6))


def test_a_sample_that_does_not_fit_says_how_many_do() -> None:
    with pytest.raises(ValueError, match=r"50 places .* are wanted, \d+ fit"):
        maze(0).sample(np.random.default_rng(0), 50, 0.2, 3.0)


def ground(heights: np.ndarray) -> Heightfield:
    return Heightfield(heights, np.zeros(2), SPACING)


LIMITS = {"feet": FEET, "wheels": WHEELS}


@pytest.mark.parametrize(("step", "who"), [(0.04, ("feet", "wheels")), (0.13, ("feet",)), (0.35, ())])
def test_who_climbs_which_step(step: float, who: tuple[str, ...]) -> None:
    field = Heightfield.flat([[0, 0], [6, 3]], SPACING)
    stepped = field.with_heights(np.where(field.nodes[..., 0] > 4, step, 0.0))
    for walker, limits in LIMITS.items():
        space = free_space(stepped, np.zeros(stepped.heights.shape, dtype=bool), limits)
        assert space.free_at([[1.0, 1.5]])[0]
        assert space.free_at([[5.0, 1.5]])[0] == (walker in who)


@pytest.mark.parametrize(("degrees", "who"), [(10, ("feet", "wheels")), (25, ("feet",)), (55, ())])
def test_who_climbs_which_slope(degrees: float, who: tuple[str, ...]) -> None:
    field = Heightfield.flat([[0, 0], [9, 3]], SPACING)
    rise = np.clip(field.nodes[..., 0] - 4, 0, 2) * np.tan(np.deg2rad(degrees))
    for walker, limits in LIMITS.items():
        space = free_space(field.with_heights(rise), np.zeros(field.heights.shape, dtype=bool), limits)
        assert space.free_at([[8.0, 1.5]])[0] == (walker in who)


def test_obstacles_are_kept_off_by_the_clearance_and_only_the_largest_region_stays() -> None:
    field = Heightfield.flat([[0, 0], [6, 3]], SPACING)
    wall = np.abs(field.nodes[..., 0] - 4) < 0.15
    space = free_space(field, wall, Limits(0.5, 0.1, 0.3))
    x = nodes(space)[space.free][:, 0]
    assert 4 - x.max() >= 0.3 + 0.1
    with pytest.raises(ValueError, match="nothing is free"):
        free_space(field, np.ones_like(wall), Limits(0.5, 0.1, 0.3))
    with pytest.raises(ValueError, match="shape"):
        free_space(field, wall[1:], Limits(0.5, 0.1, 0.3))


def test_free_space_must_be_one_piece_within_a_frame() -> None:
    free = np.zeros((9, 9), dtype=bool)
    with pytest.raises(ValueError, match="0 regions"):
        FreeSpace(free, np.zeros(2), 0.1)
    free[2, 2] = free[6, 6] = True
    with pytest.raises(ValueError, match="2 regions"):
        FreeSpace(free, np.zeros(2), 0.1)
    with pytest.raises(ValueError, match="border"):
        FreeSpace(np.ones((9, 9), dtype=bool), np.zeros(2), 0.1)


def test_links_do_not_cut_corners() -> None:
    free = np.ones((2, 2), dtype=bool)
    assert links(free, np.ones((2, 2))).nnz == 6
    free[0, 0] = False
    graph = links(free, np.ones((2, 2))).toarray()
    assert graph[1, 2] == 0
    assert graph[1, 3] == graph[2, 3] == 1


def test_distance_is_never_above_dijkstra_and_satisfies_the_equation() -> None:
    rng = np.random.default_rng(0)
    free = rng.uniform(size=(40, 50)) > 0.2
    free[0, 0] = True
    cost = rng.uniform(1, 2, free.shape)
    graph = links(free, cost)
    field = distance(graph, cost, 0)
    eight = csgraph.dijkstra(graph, directed=False, indices=0).reshape(free.shape)
    np.testing.assert_array_equal(np.isfinite(field), np.isfinite(eight))
    reached = np.isfinite(field)
    assert np.all(field[reached] <= eight[reached] + 1e-9)
    T = np.pad(field, 1, constant_values=np.inf)
    lower = np.minimum.reduce([T[1:-1, :-2], T[1:-1, 2:], T[:-2, 1:-1], T[2:, 1:-1]])
    others = reached & (field > 0)
    # A neighbour is nearer to the start by the whole cost or, at 45°, by its part of it; never by more.
    fall = field[others] - lower[others]
    assert fall.min() > 0
    assert np.all(fall <= cost[others] + 1e-3)
