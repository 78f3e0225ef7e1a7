"""Paint goes where it is told to, and every picture is a wall, a floor or a surface that can be told from others."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.terrain.heightfield import Heightfield
from worlds.terrain.polygons import rectangle
from worlds.textures.floors import floor, hazards, lane, matting, planks
from worlds.textures.furniture_atlas import ACROSS, TILE, Surface, atlas, crop
from worlds.textures.materials import Canvas
from worlds.textures.wall_fixtures import wall


def test_a_box_is_filled_from_below_in_metres_and_nothing_else_is() -> None:
    canvas = Canvas(2.0, 1.0, 10.0, (0, 0, 0), base=-0.5)
    assert canvas.pixels.shape == (15, 20, 3)
    canvas.fill((0.5, -0.5, 1.0, 0.0), (100, 150, 200))
    expected = np.zeros((15, 20, 3))
    expected[10:, 5:10] = (100, 150, 200)
    np.testing.assert_array_equal(canvas.pixels, expected)


def test_what_is_off_the_canvas_is_not_painted() -> None:
    canvas = Canvas(2.0, 1.0, 10.0, (7, 7, 7))
    rng = np.random.default_rng(0)
    for box in ((-2, 0, -1, 1), (3, 0, 4, 1), (0, 2, 1, 3), (0, -3, 1, -2)):
        canvas.fill(box, (0, 0, 0))
        canvas.mottle(rng, box, 0.5, 1.0)
        canvas.speckle(rng, box, 0.5, 0.1)
        canvas.writing(rng, box, (0, 0, 0), 0.1)
        canvas.picture(rng, box, np.zeros((3, 3)))
        canvas.disc((0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])), 0.3, (0, 0, 0))
    np.testing.assert_array_equal(canvas.pixels, 7)


@pytest.mark.parametrize("width", [0.4, 1.0, 3.3, 9.0])
def test_walls_are_of_their_size_and_differ_from_seed_to_seed(width: float) -> None:
    pictures = [wall(np.random.default_rng(seed), width, 2.8, -0.3).image() for seed in (0, 0, 1)]
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert pictures[0].shape == pictures[2].shape
    assert np.abs(pictures[0].astype(int) - pictures[2]).mean() > 2


def test_the_floor_covers_the_ground_and_steps_are_striped() -> None:
    ground = Heightfield.flat([[-2, -1], [2, 2]], 0.1)
    ground = ground.with_heights(np.where(ground.nodes[..., 0] > 0.95, 0.2, 0.0))
    canvas = floor(np.random.default_rng(0), ground)
    before = canvas.pixels.copy()
    hazards(canvas, ground)
    rows, columns = np.nonzero((canvas.pixels != before).any(axis=2))
    x = columns / canvas.scale - 2.0
    assert 0.8 <= x.min() < 0.95 < x.max() <= 1.1
    assert np.ptp(rows) >= canvas.pixels.shape[0] - 2


def test_planks_mats_and_lanes_stay_in_their_polygons() -> None:
    ground = Heightfield.flat([[-2, -1], [2, 2]], 0.1)
    canvas = Canvas(4.0, 3.0, 96.0, (0, 0, 0))
    rng = np.random.default_rng(0)
    planks(canvas, rng, ground, rectangle((-1, 0.5), (0.8, 0.5), 0.3))
    matting(canvas, rng, ground, rectangle((1, 0.5), (0.8, 0.5), 0.3), (90, 90, 90))
    lane(canvas, rng, ground, [(-2, 1.9), (2, 1.9)], (200, 200, 200))
    painted = canvas.pixels.any(axis=2)
    share = painted.sum() / 96.0**2
    assert 0.7 < share < 0.8 + 4 * 0.08
    middle = canvas.window((0.95, 1.45, 1.05, 1.55))
    assert middle.all()
    assert not canvas.window((1.7, 0.0, 2.3, 2.7)).any()


def test_pieces_of_a_surface_lie_in_its_tile() -> None:
    rng = np.random.default_rng(0)
    canvas = atlas(rng)
    rows = -(-len(Surface) // ACROSS)
    assert canvas.width == ACROSS * TILE
    for surface in Surface:
        for size in ((0.1, 0.2), (5.0, 0.3)):
            (u0, v0), (u1, v1) = crop(rng, surface, size)
            assert surface % ACROSS / ACROSS < u0 < u1 < (surface % ACROSS + 1) / ACROSS
            assert surface // ACROSS / rows < v0 < v1 < (surface // ACROSS + 1) / rows
    assert (u1 - u0) * canvas.width == pytest.approx(TILE - 0.04)
