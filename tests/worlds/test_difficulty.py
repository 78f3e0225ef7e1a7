"""Measures of worlds whose irregularity is known by construction."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from worlds.difficulty import measure
from worlds.terrain.free_space import FEET, WHEELS, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.world import World

FLAT = Heightfield.flat([[0, 0], [10, 10]], 0.1)


def world_of(ground: Heightfield, boxes: list[tuple[float, float, float]] | None = None) -> World:
    """The ground with boxes of 1 m x 1 m standing on it at x, y, up to a height m."""
    spec = mujoco.MjSpec()
    ground.add_to(spec, "ground")
    blocked = np.zeros(ground.heights.shape, dtype=bool)
    for k, (x, y, height) in enumerate(boxes or []):
        spec.worldbody.add_geom(name=f"crates{k}", type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.5, 0.5, height / 2), pos=(x, y, height / 2), group=1)
        blocked |= (np.abs(ground.nodes - [x, y]) <= 0.5).all(axis=2)
    feet, wheels = (free_space(ground, blocked, limits) for limits in (FEET, WHEELS))
    return World("test", spec, ground, feet, wheels, np.array([[[1.0, 1.0], [1.5, 1.5]]]))


def test_flat_ground_has_nothing() -> None:
    m = measure(world_of(FLAT))
    assert (m.relief, m.roughness, m.steep_share, m.highest_step, m.occluders, m.irregular_share) == (0, 0, 0, 0, 0, 0)
    assert m.extent_x == pytest.approx(10)
    # A person's half width from the rim is not free.
    assert m.feet_share == pytest.approx(0.95**2, abs=0.02)


@pytest.mark.parametrize(("degrees", "irregular", "steep"), [(4, 0, 0), (6, 1, 0), (12, 1, 1)])
def test_a_plane_is_as_steep_as_it_is(degrees: float, irregular: float, steep: float) -> None:
    m = measure(world_of(FLAT.with_heights(FLAT.nodes[..., 0] * np.tan(np.deg2rad(degrees)))))
    assert m.irregular_share == pytest.approx(irregular, abs=0.02)
    assert m.steep_share == pytest.approx(steep, abs=0.02)
    assert m.relief == pytest.approx(9.3 * np.tan(np.deg2rad(degrees)), rel=0.03)


@pytest.mark.parametrize(("rise", "share"), [(0.04, 0.0), (0.08, 0.11)])
def test_ground_is_irregular_near_a_step_of_five_centimetres(rise: float, share: float) -> None:
    """A step across the place: 0.5 m on each side of it, of some 9.4 m that can be walked."""
    m = measure(world_of(FLAT.with_heights(np.where(FLAT.nodes[..., 0] > 5, rise, 0.0))))
    assert m.highest_step == pytest.approx(rise, abs=0.02)
    assert m.irregular_share == pytest.approx(share, abs=0.06)


def test_what_is_tall_is_an_occluder_and_a_table_is_none() -> None:
    m = measure(world_of(FLAT, [(3, 3, 2.0), (7, 7, 1.5), (3, 7, 0.8)]))
    assert m.occluders == pytest.approx(2.0)


def test_tops_are_what_stands_on_the_ground_and_not_what_hangs_over_it() -> None:
    world = world_of(FLAT, [(3, 3, 2.0)])
    for z, x in ((2.6, 6.0), (1.4, 8.0)):
        world.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.3, 0.3, 0.1), pos=(x, 6.0, z))
    field = world.tops()
    np.testing.assert_allclose(field.height_at([[3.0, 3.0], [6.0, 6.0], [8.0, 6.0], [1.0, 8.0]]), [2.0, 0.0, 1.5, 0.0], atol=1e-6)
