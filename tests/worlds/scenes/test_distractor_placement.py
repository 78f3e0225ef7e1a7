"""Distractors stand on free ground, close no way, and have a class that is not a person's."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from worlds import catalogue
from worlds.props.distractors import MAKERS
from worlds.props.furniture import Piece
from worlds.scenes.distractor_placement import with_distractors, with_seats
from worlds.semantics import CLASSES, class_of
from worlds.textures.person_pictures import COUNT, WIDTH, picture_box, silhouette, texture_of


def test_distractors_shrink_free_space_and_repeat() -> None:
    world = catalogue.build("pilsun", np.random.default_rng(1), 0.25)
    assert with_distractors(world, np.random.default_rng(2), 0) is world
    one, two = (with_distractors(world, np.random.default_rng(2), 8) for _ in range(2))
    before, after = world.spec.copy().compile(), one.spec.copy().compile()
    added = [after.geom(k).name for k in range(before.ngeom, after.ngeom)]
    assert len([name for name in added if not name.endswith("-picture")]) == 8
    assert all(class_of(name) not in (CLASSES.index("person"), CLASSES.index("robot")) for name in added)
    assert not (one.feet.free & ~world.feet.free).any()
    assert one.feet.area < world.feet.area
    again = two.spec.copy().compile()
    np.testing.assert_array_equal(after.geom_pos, again.geom_pos)
    data = mujoco.MjData(after)
    mujoco.mj_forward(after, data)
    assert not one.feet.free_at(data.geom_xpos[before.ngeom :, :2]).any()


def test_too_many_distractors_are_refused() -> None:
    world = catalogue.build("hall", np.random.default_rng(1), 0.0)
    with pytest.raises(ValueError, match="distractors is 400"):
        with_distractors(world, np.random.default_rng(2), 400)


@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
def test_distractors_stand_on_the_ground_within_their_footprint(make: Callable[[np.random.Generator], Piece]) -> None:
    for seed in range(20):
        piece = make(np.random.default_rng(seed))
        vertices = np.concatenate([shape.vertices for shape in (piece.shape, piece.picture) if shape is not None])
        assert (np.abs(vertices[:, :2]) <= np.array(piece.size) / 2 + 0.02).all()
        assert 0 <= vertices[:, 2].min() < 0.02
        assert 0.2 < vertices[:, 2].max() < 2.6
        assert ((piece.shape.texcoord >= 0) & (piece.shape.texcoord <= 1)).all()


def test_people_on_posters_are_inside_of_their_cells() -> None:
    for cell in range(COUNT):
        corners = np.concatenate([part for _, part in silhouette(cell)])
        assert (np.abs(corners[:, 0]) < WIDTH / 2).all()
        assert (corners[:, 1] >= 0).all()
        assert corners[:, 1].max() == pytest.approx(1.7, abs=0.03)
        low, high = picture_box(cell)
        texture = texture_of(cell, corners)
        assert (texture >= low).all()
        assert (texture <= high).all()


def test_seats_are_on_level_free_ground_and_cut_it() -> None:
    world = catalogue.build("hall", np.random.default_rng(1), 0.0)
    assert with_seats(world, np.random.default_rng(2), 0) is world
    one = with_seats(world, np.random.default_rng(2), 5)
    assert 5 <= len(one.seats) <= 7
    assert world.feet.free_at(one.seats[:, :2]).all()
    assert not one.feet.free_at(one.seats[:, :2]).any()
    assert (np.abs(one.seats[:, 2] - one.terrain.height_at(one.seats[:, :2]) - 0.46) < 0.15).all()
    np.testing.assert_array_equal(one.seats, with_seats(world, np.random.default_rng(2), 5).seats)
    with pytest.raises(ValueError, match="400 people shall sit"):
        with_seats(world, np.random.default_rng(2), 400)
