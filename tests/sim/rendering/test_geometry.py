"""Shapes: closed, turned outwards, as large as they should be; forms of meshes by their names."""

import mujoco
import numpy as np
import pytest

from sim.rendering.geometry import SLICES, Solid, Solids, box, capsule, cylinder, mesh, plane, sphere


def volume(solid: Solid, scale: tuple[float, float, float] = (1, 1, 1), apart: float = 0.0) -> float:
    """By the divergence theorem: right only where the surface is closed and turned outwards."""
    corners = (solid.vertices[:, :3] * scale + solid.vertices[:, 3:4] * [0, 0, apart])[solid.triangles].astype(float)
    return float(np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


@pytest.mark.parametrize("fineness", SLICES)
def test_round_shapes_fill_what_they_should(fineness: tuple[int, int]) -> None:
    # An inscribed shape of n slices lacks a share of some 7/n² of its section and its height.
    lacking = 20 / fineness[1] ** 2
    ball, rod = 4 / 3 * np.pi * 0.3**3, 2 * np.pi * 0.3**2 * 0.7
    assert (1 - lacking) * ball < volume(sphere(*fineness), (0.3, 0.3, 0.3)) < ball
    assert (1 - lacking) * (ball + rod) < volume(capsule(*fineness), (0.3, 0.3, 0.3), 0.7) < ball + rod
    assert (1 - lacking) * rod < volume(cylinder(*fineness), (0.3, 0.3, 0.7)) < rod


def test_a_box_is_a_box_and_a_plane_looks_up() -> None:
    assert volume(box(), (1, 2, 3)) == pytest.approx(48)
    corners = plane().vertices[:, :3][plane().triangles]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


@pytest.mark.parametrize("solid", [sphere(20, 12), capsule(14, 8), cylinder(10, 6), box(), plane()])
def test_normals_are_unit_and_on_the_side_of_their_triangles(solid: Solid) -> None:
    assert np.linalg.norm(solid.vertices[:, 4:7], axis=1) == pytest.approx(1, abs=1e-6)
    corners = (solid.vertices[:, :3] + solid.vertices[:, 3:4] * [0, 0, 0.5])[solid.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ni,nki->nk", facing, solid.vertices[:, 4:7][solid.triangles]) > 0).all()


def pyramid_model() -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    corners = np.array([[1, 0, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 1.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    for name in ("rock", "rock@1", "rock@2", "other"):
        spec.add_mesh(name=name, uservert=corners.ravel(), userface=faces.ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="rock")
    return spec.compile()


def test_a_mesh_keeps_its_volume_and_knows_its_forms() -> None:
    model = pyramid_model()
    solid = mesh(model, 0)
    # Base area 2, height 1.5.
    assert volume(solid) == pytest.approx(1.0, rel=1e-5)
    solids = Solids.of(model)
    numbers = [int(solids.mesh[model.mesh(name).id]) for name in ("rock", "rock@1", "rock@2", "other")]
    assert list(dict.fromkeys(solids.family[numbers[0]])) == numbers[:3]
    assert set(solids.family[numbers[3]]) == {numbers[3]}


def test_shapes_lie_one_after_the_other() -> None:
    solids = Solids.of(pyramid_model())
    assert solids.first[0] == solids.base[0] == 0
    assert (np.diff(solids.first) == solids.count[:-1]).all()
    for k in range(len(solids.first)):
        own = solids.indices[solids.first[k] : solids.first[k] + solids.count[k]]
        assert solids.base[k] + own.max() < (solids.base[k + 1] if k + 1 < len(solids.base) else len(solids.vertices))
