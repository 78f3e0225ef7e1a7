"""The laboratory: closed, level where it should be, and with room for people and robots."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.worlds import inspection
from worlds.scenes.pilsun import WALL_HEIGHT, draw
from worlds.terrain.polygons import signed_distance
from worlds.world import World

SEEDS = (0, 1)


def pilsun(seed: int) -> World:
    return inspection.built("pilsun", seed, float(seed))


def compiled(seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    return inspection.compiled("pilsun", seed, float(seed))[1:]


@pytest.mark.parametrize("seed", SEEDS)
def test_everybody_gets_from_any_way_in_to_any_other_and_onto_the_platform(seed: int) -> None:
    world = pilsun(seed)
    assert len(world.spawn) >= 2
    middles = world.spawn.mean(axis=1)
    for middle in middles[1:]:
        assert len(world.feet.route(middles[0], middle)) >= 2
    # The ledge is at 0.12 to 0.15 m, the platform at 0.3 to 0.4 m.
    feet, wheels = world.ground.heights[world.feet.free], world.ground.heights[world.wheels.free]
    assert feet.max() > 0.25
    assert wheels.max() > 0.25


@pytest.mark.parametrize("seed", SEEDS)
def test_feet_go_where_wheels_go_and_onto_the_ledge_where_they_do_not(seed: int) -> None:
    world = pilsun(seed)
    only_wheels = world.wheels.free & ~world.feet.free
    assert only_wheels.sum() < 0.01 * world.wheels.free.sum()
    only_feet = world.feet.free & ~world.wheels.free
    assert only_feet.sum() * world.feet.spacing**2 > 3


@pytest.mark.parametrize("seed", SEEDS)
def test_nobody_stands_in_anything(seed: int) -> None:
    """Over free places nothing is between the ground and 2 m above it."""
    world = pilsun(seed)
    model, data = compiled(seed)
    rng = np.random.default_rng(seed)
    found = np.zeros(1, dtype=np.int32)
    for space in (world.feet, world.wheels):
        for p in space.sample(rng, 60, 0.0, 0.5):
            z = float(world.ground.height_at(p[None])[0])
            d = mujoco.mj_ray(model, data, np.array([*p, z + 2.0]), np.array([0, 0, -1.0]), None, 1, -1, found)
            assert found[0] == model.geom("ground").id
            assert d == pytest.approx(2.0, abs=1e-6)
            for yaw in np.linspace(0, 2 * np.pi, 8, endpoint=False):
                for height in (0.35, 1.0):
                    d = mujoco.mj_ray(model, data, np.array([*p, z + height]), np.array([np.cos(yaw), np.sin(yaw), 0]), None, 1, -1, found)
                    assert d > 0.2 or found[0] == model.geom("ground").id


@pytest.mark.parametrize("seed", SEEDS)
def test_the_walls_have_no_gaps(seed: int) -> None:
    """A look in any direction, level or a bit down, ends on something within the room."""
    world = pilsun(seed)
    model, data = compiled(seed)
    rng = np.random.default_rng(seed)
    eye = np.array([*world.wheels.sample(rng, 1, 0.3, 0.0)[0], 1.2])
    az, el = np.linspace(-np.pi, np.pi, 4000), rng.uniform(-0.5, 0.02, 4000)
    rays = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)
    geom, distance = np.zeros(4000, dtype=np.int32), np.zeros(4000)
    mujoco.mj_multiRay(model, data, eye, rays.ravel(), None, 1, -1, geom, distance, None, 4000, 100.0)
    assert geom.min() >= 0
    hits = eye + distance[:, None] * rays
    corner, opposite = world.ground.extent
    assert np.all((hits[:, :2] > corner) & (hits[:, :2] < opposite))
    assert hits[:, 2].max() < WALL_HEIGHT


def test_textures_are_modest_and_everything_has_a_name_and_a_group() -> None:
    model, _ = compiled(1)
    assert model.tex_data.nbytes < 40e6
    names = [model.geom(k).name for k in range(model.ngeom)]
    assert all(names)
    assert len(set(names)) == len(names)
    assert set(model.geom_group.tolist()) == {0, 1}
    assert (model.geom_contype == 1).all()
    assert (model.geom_conaffinity == 1).all()
    assert model.vis.map.znear * model.stat.extent == pytest.approx(0.03)


@pytest.mark.parametrize("seed", range(4))
def test_a_mirrored_plan_is_a_plan(seed: int) -> None:
    plan = draw(np.random.default_rng(seed), 0.5)
    for flip in ([1, 1], [-1, 1], [1, -1], [-1, -1]):
        other = plan.mirrored(flip)
        x, y = other.outline.T
        assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0
        assert np.all(signed_distance(other.spawn.reshape(-1, 2), other.outline) < 0)
        assert np.all(other.spawn[:, 0] < other.spawn[:, 1])
        for door, opening in zip(sorted(other.doors), other.openings, strict=True):
            assert len(opening) == 2
            ends = np.array([other.outline[door], other.outline[(door + 1) % len(other.outline)]])
            gaps = np.abs(other.openings.mean(axis=1) - ends.mean(axis=0)).sum(axis=1)
            assert gaps.min() == pytest.approx(1.5)
