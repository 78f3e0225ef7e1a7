"""The cube's tables against the geometry that they stand for."""

import numpy as np
import pytest

from sim.cubemap import FACES, CubeTable, frustum_planes, half_tangent, inverse_depth
from tests.sim.scenes import bearings
from tracker.cameras import Panorama

CAMERA = Panorama(256, 128)


@pytest.fixture(scope="module")
def table() -> CubeTable:
    return CubeTable.make(CAMERA, 96)


def test_faces_are_rotations() -> None:
    for forward, right, up in FACES:
        np.testing.assert_array_equal(np.cross(forward, up), right)
    assert len(np.unique(FACES[:, 0], axis=0)) == 6


def test_places_in_the_atlas_look_along_the_pixels(table: CubeTable) -> None:
    face = (table.y // 96).astype(int).ravel()
    scale = 2 * half_tangent(96) / 96
    right, up = (table.x.ravel() - 47.5) * scale, (table.y.ravel() - 96 * face - 47.5) * scale
    along = FACES[face, 0] + right[:, None] * FACES[face, 1] + up[:, None] * FACES[face, 2]
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), table.stretch.ravel(), rtol=1e-5)
    np.testing.assert_allclose(along / np.linalg.norm(along, axis=1, keepdims=True), bearings(CAMERA), atol=1e-5)


def test_interpolation_never_leaves_a_face(table: CubeTable) -> None:
    row = table.y % 96
    for place in (table.x, row):
        assert place.min() > 1
        assert place.max() < 94
    np.testing.assert_array_equal(table.nearest // 96, np.round(table.y))
    np.testing.assert_array_equal(table.nearest % 96, np.round(table.x))


def test_inverse_depth_has_its_ends() -> None:
    slope, offset = inverse_depth(0.02, 500.0)
    assert 1 / (slope + offset) == pytest.approx(0.02, rel=1e-6)
    assert 1 / offset == pytest.approx(500.0, rel=2e-3)


def test_range_is_interpolated_within_a_geom_and_taken_nearest_elsewhere(table: CubeTable) -> None:
    codes, depth = np.zeros((576, 96, 3), np.uint8), np.zeros((576, 96), np.float32)
    slope, offset = inverse_depth(0.1, 100.0)
    # Everywhere the plane z = −2 m in the face that looks down; the upper half of that face is another geom.
    codes[480:, :, 0], codes[528:, :, 1] = 1, 1
    depth[480:] = (1 / 2.0 - offset) / slope
    instances, distance = table.geometry(codes, depth, np.arange(300, dtype=np.uint16), 0.1, 100.0)
    down = table.y >= 479.5
    assert set(np.unique(instances)) == {0, 1, 257}
    assert np.isinf(distance[~down]).all()
    np.testing.assert_allclose(distance[down], 2.0 * table.stretch[down], rtol=1e-6)


def test_planes_hold_what_a_face_sees(table: CubeTable) -> None:
    along, face = bearings(CAMERA), (table.y // 96).astype(int).ravel()
    inside = (np.einsum("fpi,ni->nfp", frustum_planes(96), along) >= 0).all(axis=2)
    assert inside[np.arange(len(face)), face].all()
    assert inside.sum() < 1.2 * len(face)
