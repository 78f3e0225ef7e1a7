"""Shapes are closed and face outwards; furniture stands on the ground within its footprint and closes no way."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from scipy import ndimage

from worlds.props import furniture
from worlds.props.furniture import GAP, Furnishing, Piece
from worlds.props.shapes import Shape, box, column, prism
from worlds.terrain.heightfield import Heightfield
from worlds.terrain.polygons import rectangle, signed_distance
from worlds.textures.furniture_atlas import Surface
from worlds.textures.materials import Canvas, add_material

MAKERS: list[Callable[[np.random.Generator], Piece]] = [
    furniture.table,
    furniture.chair,
    furniture.shelf,
    furniture.cabinet,
    furniture.crates,
    furniture.barrel,
    lambda rng: furniture.pillar(rng, 2.8),
]


def volume(shape: Shape) -> float:
    """By the divergence theorem: right only where the faces close it and look outwards."""
    a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6)


def test_volumes_of_shapes() -> None:
    rng = np.random.default_rng(0)
    cube = box(rng, Surface.OAK, (1, 2, 3), (2, 4, 3.5))
    assert volume(cube) == pytest.approx(1.0)
    assert volume(cube + cube) == pytest.approx(2.0)
    assert volume(prism([(0, 0), (3, 0), (3.1, 0.2), (-0.1, 0.2)], -0.5, 2.5)) == pytest.approx(0.62 * 3)
    # A column has no underside, on which it stands at z = 0.
    assert volume(column(rng, Surface.CONCRETE, 0.2, 2.0)) == pytest.approx(np.pi * 0.04 * 2, rel=0.03)


@pytest.mark.parametrize("make", MAKERS)
def test_a_piece_lies_within_its_size_and_is_textured(make: Callable[[np.random.Generator], Piece]) -> None:
    for seed in range(20):
        piece = make(np.random.default_rng(seed))
        assert np.all(np.abs(piece.shape.vertices[:, :2]) <= np.array(piece.size) / 2 + 1e-9)
        assert piece.shape.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert np.all((piece.shape.texcoord >= 0) & (piece.shape.texcoord <= 1))
        assert volume(piece.shape) > 0


@pytest.mark.parametrize("make", MAKERS)
def test_rays_from_above_hit_a_piece_within_its_footprint_only(make: Callable[[np.random.Generator], Piece]) -> None:
    rng = np.random.default_rng(5)
    spec = mujoco.MjSpec()
    ground = Heightfield.flat([[-3, -3], [3, 3]], 0.25)
    ground.add_to(spec, "ground")
    add_material(spec, "furniture", Canvas(1, 1, 8, (90, 90, 90)))
    piece = make(rng)
    geom = piece.stand(spec, ground, "piece", (0.7, -0.4), 0.9)
    assert geom.group == 1
    assert geom.contype == geom.conaffinity == 1
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = np.zeros(1, dtype=np.int32)
    hits = []
    for p in rng.uniform(-2, 2, (600, 2)):
        mujoco.mj_ray(model, data, np.array([*p, 5.0]), np.array([0, 0, -1.0]), None, 1, -1, found)
        if found[0] == model.geom("piece").id:
            hits.append(p)
    assert hits
    assert signed_distance(hits, piece.footprint((0.7, -0.4), 0.9)).max() <= 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_furniture_leaves_the_floor_connected_and_what_is_kept_clear(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = Heightfield.flat([[-0.5, -0.5], [8.5, 7.5]], 0.1)
    outline = rectangle((4, 3.5), (8, 7))
    furnishing = Furnishing(ground, outline)
    furnishing.keep_clear(rectangle((4, 3.5), (1.0, 1.0)), 0.3)
    edges = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    placed = 0
    for k in range(24):
        piece = MAKERS[k % len(MAKERS)](rng)
        place = furnishing.at_wall(rng, piece, edges) if k < 12 else furnishing.standing_free(rng, piece)
        if place is not None:
            before = furnishing.blocked
            footprint = signed_distance(ground.nodes, piece.footprint(*place)) < 0.05
            assert not (before & footprint & ~furnishing.walls).any()
            if k >= 12:
                gap = ndimage.distance_transform_edt(~before)[footprint].min() * 0.1
                assert gap > GAP
            furnishing.take(piece.footprint(*place))
            placed += 1
    assert placed > 8
    assert not (furnishing.furniture & furnishing.clear).any()
    room = ndimage.distance_transform_edt(~furnishing.blocked) * 0.1
    labels, _ = ndimage.label(room > 0.35)
    sizes = np.sort(np.bincount(labels.ravel())[1:])
    # Nothing but pockets between a thing at a wall and the next corner is cut off.
    assert sizes[-1] > 0.97 * sizes.sum()


def test_a_full_room_has_no_place() -> None:
    rng = np.random.default_rng(0)
    ground = Heightfield.flat([[-0.5, -0.5], [2.5, 2.5]], 0.1)
    furnishing = Furnishing(ground, rectangle((1, 1), (2, 2)))
    furnishing.take(rectangle((1, 1), (1.6, 1.6)))
    piece = furniture.cabinet(rng)
    assert furnishing.standing_free(rng, piece) is None
    assert furnishing.at_wall(rng, piece, [[(0, 0), (2, 0)]]) is None
