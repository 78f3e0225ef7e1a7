"""The hall: as large as its plan, flat and empty at difficulty 0, and free where the plan is kept clear."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from worlds import catalogue
from worlds.scenes import hall
from worlds.scenes.hall import HallPlan, parse_plan
from worlds.terrain.heightfield import Array
from worlds.world import World

ROOM = np.array([[1.0, -2.0], [8.7, 1.4]])
DOWN = np.array([0.0, 0.0, -1.0])


def depths(world: World, places: Array, height: float) -> Array:
    """(n,) m from the height down to whatever is first under each place (n, 2) m."""
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, dtype=np.int32)
    return np.array([mujoco.mj_ray(model, data, np.array([x, y, height]), DOWN, None, 1, -1, geom, None) for x, y in places])


@pytest.mark.parametrize("walled", [True, False])
def test_without_difficulty_it_is_flat_and_empty(walled: bool) -> None:
    world = hall.build(np.random.default_rng(5), 0.0, HallPlan(ROOM, walled, level=0.25))
    inside = np.random.default_rng(0).uniform(ROOM[0] + 0.02, ROOM[1] - 0.02, (400, 2))
    np.testing.assert_array_equal(world.terrain.height_at(inside), 0.25)
    # Nothing stands anywhere, up to the walls.
    np.testing.assert_allclose(depths(world, inside, 2.5), 2.25, atol=1e-9)
    # A person may be wherever the body fits: half its width and a cell are kept from the border.
    near = np.minimum(inside - ROOM[0], ROOM[1] - inside).min(axis=1)
    spacing = world.feet.spacing
    assert world.feet.free_at(inside[near > 0.25 + 2 * spacing]).all()
    assert not world.feet.free_at(inside[near < 0.2]).any()
    beyond = np.array([[0.9, 0.0], [8.8, 0.0], [4.0, -2.1], [4.0, 1.5]])
    tops = depths(world, beyond, 10.0)
    if walled:
        np.testing.assert_allclose(tops, 10.0 - 0.25 - 2.8, atol=1e-6)
    else:
        assert (tops > 9.7).all()


def test_walls_are_as_high_as_cameras_need_and_given_pillars_stand() -> None:
    plan = HallPlan(ROOM, wall_height=3.3, pillars=np.array([[4.0, 0.0, 0.2, 0.0, 2.0]]))
    world = hall.build(np.random.default_rng(0), 0.0, plan)
    np.testing.assert_allclose(depths(world, np.array([[0.9, 0.0], [4.1, 0.0]]), 5.0), [1.7, 3.0], atol=1e-6)
    assert not world.feet.free_at([[4.3, 0.0]])[0]
    assert world.feet.free_at([[5.0, 0.0]])[0]


@pytest.mark.parametrize("walled", [False, True])
def test_with_difficulty_it_is_furnished_but_for_places_that_are_kept_clear(walled: bool) -> None:
    extent = np.array([[-8.5, -5.0], [8.5, 5.0]])
    path = np.column_stack([np.linspace(-8, 8, 60), 3 * np.sin(np.linspace(0, 6, 60))])
    world = hall.build(np.random.default_rng(2), 1.0, HallPlan(extent, walled, kept_clear=path))
    kinds = {geom.name.rstrip("0123456789") for geom in world.spec.geoms}
    assert {"pillar", "crates"} < kinds
    assert ("shelf" in kinds) == walled
    assert np.ptp(world.ground.heights) > 0.1
    assert (world.feet.clearance_at(path) > 0).all()
    around = (path[:, None] + 0.3 * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])).reshape(-1, 2)
    np.testing.assert_allclose(depths(world, around, 2.5), 2.5 - world.ground.height_at(around), atol=1e-6)


def test_a_plan_is_read_from_a_text_and_back() -> None:
    plan = parse_plan("room=7.7x3.4")
    np.testing.assert_allclose(plan.extent, [[-3.85, -1.7], [3.85, 1.7]])
    assert plan.walled
    corners = parse_plan("square=-3:-9:9:27")
    np.testing.assert_allclose(corners.extent, [[-3, -9], [9, 27]])
    assert not corners.walled
    assert corners.text == "square=-3:-9:9:27"
    np.testing.assert_allclose(parse_plan(plan.text).extent, plan.extent)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hall:", "hall has the plan '', needs room=LENGTHxWIDTH"),
        ("hall:cellar=3x4", "has the plan 'cellar=3x4'"),
        ("hall:room=3x", "has the plan 'room=3x'"),
        ("hall:room=7x2", "sides of 7 and 2 m, needs 3 to 40 m each"),
        ("hall:room=50x5", "needs 3 to 40 m each"),
        ("hall:square=1:2:3", "has the plan 'square=1:2:3'"),
        ("hall:square=5:5:0:0", "square of hall has sides of -5 and -5 m"),
        ("hall:room=infx4", "has the plan 'room=infx4'"),
        ("campus:room=9x9", "world is 'campus:room=9x9', but only hall takes a plan"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        catalogue.build(name, np.random.default_rng(0))
