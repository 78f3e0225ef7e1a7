"""Ground, decks and roofs in numbers are the surfaces that MuJoCo has."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.worlds.inspection import built
from tests.worlds.terrain.test_heightfield import check_against_rays, rays_down
from worlds.props.meshes import hull, tilted
from worlds.terrain.free_space import FEET, WHEELS, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.terrain.relief import swell
from worlds.terrain.walk_surface import Decks, Terrain

FLAT = Heightfield.flat([[0, 0], [12, 10]], 0.25)


def scene(seed: int, count: int = 25) -> tuple[mujoco.MjSpec, Terrain]:
    """Bumpy ground with tilted stones on it and over it: half of them decks (group 0), half roofs (group 1)."""
    rng = np.random.default_rng(seed)
    ground = FLAT.with_heights(swell(rng, FLAT.nodes, 2.0, 0.4))
    spec = mujoco.MjSpec()
    ground.add_to(spec, "ground")
    names: tuple[list[str], list[str]] = [], []
    for k in range(count):
        roof = k % 2
        shape = tilted(hull(rng.uniform(-1, 1, (12, 3)) * rng.uniform(0.2, 1.2, 3)), *rng.uniform(-1, 1, 2))
        place = rng.uniform([-0.5, -0.5, 0], [12.5, 10.5, 1]) + np.array([0, 0, 2 * roof])
        geom = shape.add_to(spec, f"stone{k}", "", place, rng.uniform(-3, 3))
        geom.group = roof
        names[roof].append(geom.name)
    return spec, Terrain(ground, Decks.of(spec, *names))


@pytest.mark.parametrize("seed", range(4))
def test_rays_from_above_meet_ground_and_decks_where_the_terrain_says(seed: int) -> None:
    spec, terrain = scene(seed)
    check_against_rays(terrain, spec, np.random.default_rng(seed).uniform(*FLAT.extent, (2500, 2)))


def check_below(terrain: Terrain, spec: mujoco.MjSpec, points: np.ndarray, surfaces: list[str]) -> None:
    """Rays down from points (n, 3) m; where the first of the surfaces that one meets is left, not entered, its point is inside of a solid."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    model.geom_group[:] = 5
    model.geom_group[[model.geom(name).id for name in surfaces]] = 0
    group, geom, normal = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32), np.zeros(3)
    heights, normals = terrain.height_at(points), terrain.normal_at(points)
    checked = 0
    for point, height, up in zip(points, heights, normals, strict=True):
        d = mujoco.mj_ray(model, data, point, np.array([0, 0, -1.0]), group, 1, -1, geom, normal)
        if d >= 0 and normal[2] > 1e-6:
            checked += 1
            assert point[2] - d == pytest.approx(height, abs=1e-6)
            assert normal == pytest.approx(up, abs=1e-4)
    assert checked > 0.5 * len(points)


@pytest.mark.parametrize("seed", range(3))
def test_rays_from_between_surfaces_meet_the_next_one_below(seed: int) -> None:
    spec, terrain = scene(seed)
    points = np.random.default_rng(seed).uniform([0, 0, 0.4], [12, 10, 4], (2500, 3))
    check_below(terrain, spec, points, ["ground", *(f"stone{k}" for k in range(25))])


def test_over_and_under_a_bridge() -> None:
    """A slab 0.1 m over a ditch 0.5 m deep: from above one stands on the slab, from under it on the bottom; on the grid is the slab."""
    ground = FLAT.with_heights(np.where(np.abs(FLAT.nodes[..., 0] - 6) < 1.1, -0.5, 0.0))
    spec = mujoco.MjSpec()
    ground.add_to(spec, "ground")
    corners = [(x, y, z) for x in (-2, 2) for y in (-1, 1) for z in (-0.05, 0.1)]
    hull(corners).add_to(spec, "deck0", "", (6, 5, 0))
    terrain = Terrain(ground, Decks.of(spec, ["deck0"]))
    assert terrain.height_at([[6, 5], [6, 8], [1, 5]]) == pytest.approx([0.1, -0.5, 0])
    assert terrain.height_at([[6, 5, 1.0], [6, 5, 0.1], [6, 5, 0.05], [6, 5, -0.2]]) == pytest.approx([0.1, 0.1, -0.5, -0.5])
    assert terrain.on_grid.height_at([[6, 5], [6, 8]]) == pytest.approx([0.1, -0.5])
    blocked = np.zeros(ground.heights.shape, dtype=bool)
    steps = [free_space(field, blocked, WHEELS) for field in (ground, terrain.on_grid)]
    assert not steps[0].free_at([[6, 5]])[0]
    feet = free_space(terrain.on_grid, blocked, FEET)
    assert feet.free_at([[6, 5], [2, 5], [10, 5]]).all()
    assert not feet.free_at([[6, 6], [6, 8]]).any()


def test_a_deck_that_is_no_mesh_is_an_error() -> None:
    spec = mujoco.MjSpec()
    FLAT.add_to(spec, "ground")
    for name in ("ground", "deck7"):
        with pytest.raises(ValueError, match=f"deck is '{name}', needs the name of a mesh geom"):
            Decks.of(spec, [name])


@pytest.mark.parametrize("name", ["tunnel", "ruins", "campus"])
def test_worlds_with_decks_agree_with_rays(name: str) -> None:
    world, rng = built(name), np.random.default_rng(1)
    assert len(world.decks.decks)
    points = rng.uniform(*world.ground.extent, (10000, 2))
    check_against_rays(world.terrain, world.spec.copy(), points)
    # Decks are a small part of the place: more points on and under them.
    middles = np.concatenate([world.decks.decks, world.decks.roofs]).mean(axis=1)
    near = middles[rng.integers(len(middles), size=1500)] + rng.uniform(-0.4, 0.4, (1500, 3))
    heights, _ = rays_down(world.spec.copy(), near[:, :2])
    np.testing.assert_allclose(world.terrain.height_at(near[:, :2]), heights, atol=1e-6)
    names = [g.name for g in world.spec.geoms if g.name == "ground" or g.name.startswith(("deck", "ledge"))]
    near[:, 2] = np.maximum(near[:, 2], world.ground.height_at(near) + 0.01)
    check_below(world.terrain, world.spec.copy(), near, names)
