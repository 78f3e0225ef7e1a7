"""Shapes are closed, face outwards and have the right size; levels of detail of meshes follow from their names."""

import mujoco
import numpy as np
import pytest

from sim.rendering.geometry import CELLS, SLICES, Shape, ShapeBuffers, box, capsule, cylinder, mesh, plane, sphere, tiles_of
from tests.sim.scenes import HALF, court


def volume(shape: Shape, scale: tuple[float, float, float] = (1, 1, 1), apart: float = 0.0) -> float:
    """Volume by the divergence theorem, which holds only for a closed surface that faces outwards."""
    corners = (shape.vertices[:, :3] * scale + shape.vertices[:, 3:4] * [0, 0, apart])[shape.triangles].astype(float)
    return float(np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


@pytest.mark.parametrize("resolution", SLICES)
def test_round_shapes_fill_what_they_should(resolution: tuple[int, int]) -> None:
    # An inscribed shape of n slices lacks a share of some 7/n² of its section and its height.
    lacking = 20 / resolution[1] ** 2
    ball, rod = 4 / 3 * np.pi * 0.3**3, 2 * np.pi * 0.3**2 * 0.7
    assert (1 - lacking) * ball < volume(sphere(*resolution), (0.3, 0.3, 0.3)) < ball
    assert (1 - lacking) * (ball + rod) < volume(capsule(*resolution), (0.3, 0.3, 0.3), 0.7) < ball + rod
    assert (1 - lacking) * rod < volume(cylinder(*resolution), (0.3, 0.3, 0.7)) < rod


@pytest.mark.parametrize("shape", [sphere(20, 12), capsule(14, 8), cylinder(10, 6), box(), plane()])
def test_normals_are_unit_and_on_the_side_of_their_triangles(shape: Shape) -> None:
    assert np.linalg.norm(shape.vertices[:, 4:7], axis=1) == pytest.approx(1, abs=1e-6)
    corners = (shape.vertices[:, :3] + shape.vertices[:, 3:4] * [0, 0, 0.5])[shape.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ni,nki->nk", facing, shape.vertices[:, 4:7][shape.triangles]) > 0).all()


def pyramid_model() -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    corners = np.array([[1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 1.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    for name in ("rock", "rock@1", "rock@2", "other"):
        spec.add_mesh(name=name, uservert=corners.ravel(), userface=faces.ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="rock")
    return spec.compile()


def test_a_mesh_keeps_its_volume_and_has_its_levels_of_detail() -> None:
    model = pyramid_model()
    shape = mesh(model, 0)
    # Base area 2, height 1.5.
    assert volume(shape) == pytest.approx(1.0, rel=1e-5)
    shapes = ShapeBuffers.of(model)
    numbers = [int(shapes.mesh[model.mesh(name).id]) for name in ("rock", "rock@1", "rock@2", "other")]
    assert list(dict.fromkeys(shapes.levels[numbers[0]])) == numbers[:3]
    assert set(shapes.levels[numbers[3]]) == {numbers[3]}


def test_tiles_of_a_height_field_are_its_whole_surface_once() -> None:
    tiles = tiles_of(court().model, 0)
    assert len(tiles) == int(np.ceil(60 / CELLS)) ** 2
    corners = np.concatenate([tile.vertices[tile.triangles, :3] for tile, _ in tiles])
    # Of a triangle that is lit flat, the last corner's counts.
    normals = np.concatenate([tile.vertices[tile.triangles[:, 2], 4:7] for tile, _ in tiles])
    assert len(corners) == 60 * 60 * 2 + 4 * 60 * 2
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, facing / np.linalg.norm(facing, axis=1, keepdims=True), atol=1e-5)
    above = normals[:, 2] > 1e-3
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[above, 2].sum() / 2
    assert area == pytest.approx((2 * HALF) ** 2, rel=1e-5)
    # The sides of the solid look outwards.
    outwards = corners[~above].mean(axis=1)
    assert ((outwards * normals[~above])[:, :2].sum(axis=1) > 0).all()
    for tile, extent in tiles:
        assert (np.abs(tile.vertices[:, :3] - extent[:3]) <= extent[3:] + 1e-6).all()
        # Most corners serve several triangles.
        assert len(np.unique(tile.triangles[:, 2])) == len(tile.triangles)
        assert len(tile.vertices) < 1.6 * len(tile.triangles)
