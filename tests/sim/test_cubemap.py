"""Faces and their tables: every pixel's texel is where the camera says, whatever the camera; range is exact on planes."""

import itertools

import numpy as np
import pytest

from sim.cubemap import BORDER, CUBE, FaceTable, inverse_depth
from tests.sim.rays import bearings
from tracker.cameras import Camera, Panorama, Tsai

TSAI = Tsai(768, 576, 5.5549183034, 5.1113043639e-03, 324.22149053, 282.56650051, 1.0937855397, 0.00576, 0.00576)
CAMERAS = {"panorama": Panorama(256, 128), "tsai": TSAI}


def texel_bearings(table: FaceTable) -> np.ndarray:
    """(H, W, 3) directions of the places in the atlas that pixels are sampled from."""
    out = np.full((*table.x.shape, 3), np.nan)
    for face in table.faces:
        inside = (table.y >= face.row - 0.5) & (table.y < face.row + face.height - 0.5)
        right = face.low[0] + (table.x[inside] + 0.5) * (face.high[0] - face.low[0]) / face.width
        up = face.low[1] + (table.y[inside] - face.row + 0.5) * (face.high[1] - face.low[1]) / face.height
        ways = face.axes[0] + right[:, None] * face.axes[1] + up[:, None] * face.axes[2]
        out[inside] = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return out


@pytest.mark.parametrize("name", CAMERAS)
def test_texels_lie_where_pixels_look(name: str) -> None:
    camera: Camera = CAMERAS[name]
    table = FaceTable.make(camera)
    at = texel_bearings(table)
    wanted = bearings(camera).reshape(at.shape)
    # Single precision of a place in the atlas.
    assert np.abs(at - wanted).max() < 1e-5
    planar = np.stack([wanted @ face.axes[0] for face in table.faces]).max(axis=0)
    assert np.abs(table.stretch * planar - 1).max() < 1e-5


@pytest.mark.parametrize("name", CAMERAS)
def test_no_interpolation_reaches_over_the_edge_of_a_face(name: str) -> None:
    table = FaceTable.make(CAMERAS[name])
    for face in table.faces:
        inside = (table.y >= face.row - 0.5) & (table.y < face.row + face.height - 0.5)
        assert inside.any()
        for place, size in ((table.x[inside], face.width), (table.y[inside] - face.row, face.height)):
            assert place.min() >= 0.5
            assert place.max() <= size - 1.5


def test_a_narrow_camera_needs_one_face_and_a_panorama_six() -> None:
    (face,) = FaceTable.make(TSAI).faces
    assert 768 <= face.width < 768 * 1.8
    faces = FaceTable.make(Panorama(1024, 512)).faces
    assert len(faces) == 6
    assert len({(face.width, face.height) for face in faces}) == 1
    assert [face.axes.tolist() for face in faces] == CUBE.tolist()


def test_density_is_texels_a_pixel() -> None:
    for density in (1.0, 2.0):
        face = FaceTable.make(Panorama(1024, 512), density).faces[0]
        # Ahead, a pixel spans 2π/1024.
        assert face.width / (face.high[0] - face.low[0]) * 2 * np.pi / 1024 == pytest.approx(density, rel=0.01)


@pytest.mark.parametrize("density", [0.0, 0.2, 17.0, np.nan])
def test_a_density_out_of_bounds_is_refused(density: float) -> None:
    with pytest.raises(ValueError, match="density is"):
        FaceTable.make(Panorama(64, 32), density)


def test_planes_hold_what_a_face_shows() -> None:
    for face in FaceTable.make(TSAI).faces:
        edges = itertools.product((face.low[0], face.high[0]), (face.low[1], face.high[1]))
        corners = [face.axes[0] + right * face.axes[1] + up * face.axes[2] for right, up in edges]
        assert (np.array(corners) @ face.planes.T > -1e-12).all()
        outside = face.axes[0] + 1.01 * face.high[0] * face.axes[1]
        assert (outside @ face.planes.T).min() < 0


def test_range_is_exact_on_a_plane_and_nearest_between_two_things() -> None:
    table, limits = FaceTable.make(Panorama(128, 64)), (0.02, 100.0)
    slope, offset = inverse_depth(*limits)
    codes, depth = np.ones((table.height, table.width), np.uint32), np.zeros((table.height, table.width), np.float32)
    normal, distance = np.array([0.2, -0.3, 0.9]), 4.0
    for face in table.faces:
        right = face.low[0] + (np.arange(face.width) + 0.5) * (face.high[0] - face.low[0]) / face.width
        up = face.low[1] + (np.arange(face.height) + 0.5) * (face.high[1] - face.low[1]) / face.height
        inverse = (face.axes[0] @ normal + right[None] * (face.axes[1] @ normal) + up[:, None] * (face.axes[2] @ normal)) / distance
        depth[face.row : face.row + face.height, : face.width] = (inverse - offset) / slope
    seen, found = table.geometry(codes, depth, limits)
    truth = distance / (bearings(Panorama(128, 64)) @ normal).reshape(found.shape)
    before = (truth > 0) & (truth < 50)
    assert (np.abs(found[before] / truth[before] - 1) < 1e-4).all()
    assert (seen == 1).all()
    codes[:, ::2] = 2
    seen, found = table.geometry(codes, depth, limits)
    flat = table.nearest[before]
    assert np.allclose(found[before], table.stretch[before] / (slope * depth.ravel()[flat] + offset), rtol=1e-5)
    seen, found = table.geometry(np.zeros_like(codes), depth, limits)
    assert np.isinf(found).all()


def test_the_border_is_there() -> None:
    face = FaceTable.make(Panorama(256, 128)).faces[0]
    assert face.width * (1 - 1 / float(face.high[0])) / 2 == pytest.approx(BORDER, abs=0.6)
