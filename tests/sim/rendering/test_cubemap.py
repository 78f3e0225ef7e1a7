"""Lookup tables of faces: every pixel maps to the texel of its bearing, for every camera model; range is exact on planes."""

import itertools

import numpy as np
import pytest

from sim.rendering.cubemap import CUBE, Atlas, FaceTable, inverse_depth
from tests.sim.rays import bearings
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai

TSAI = Tsai(768, 576, 5.5549183034, 5.1113043639e-03, 324.22149053, 282.56650051, 1.0937855397, 0.00576, 0.00576)
CAMERAS: dict[str, Camera] = {
    "panorama": Panorama(256, 128),
    "tsai": TSAI,
    "pinhole": Pinhole(384, 256, 220.0, 218.0, 190.0, 130.0, (-0.2, 0.06, 0.001, -0.002, 0.0)),
    "fisheye of 220°": Fisheye(240, 240, 66.0, 66.0, 119.5, 119.5, (0.02, -0.01, 0.002, 0.0)),
    "cylinder": Cylinder(512, 128, 50.0, 512 / (2 * np.pi)),
}


def texel_positions(table: FaceTable) -> np.ndarray:
    """Positions (2, H, W) of the pixels in the atlas, texels to the right and up. Texel centres are at whole numbers."""
    return np.stack([table.first % table.width, table.first // table.width]) + np.moveaxis(table.fraction, -1, 0) / 65536


def texel_bearings(table: FaceTable) -> np.ndarray:
    """Directions (H, W, 3) of the texels that the pixels are sampled from."""
    x, y = texel_positions(table)
    out = np.full((*x.shape, 3), np.nan)
    for face in table.faces:
        inside = (y >= face.row - 0.5) & (y < face.row + face.height - 0.5)
        right = face.low[0] + (x[inside] + 0.5) * (face.high[0] - face.low[0]) / face.width
        up = face.low[1] + (y[inside] - face.row + 0.5) * (face.high[1] - face.low[1]) / face.height
        components = face.axes[0] + right[:, None] * face.axes[1] + up[:, None] * face.axes[2]
        out[inside] = components / np.linalg.norm(components, axis=1, keepdims=True)
    return out


@pytest.mark.parametrize("name", CAMERAS)
def test_texels_lie_where_pixels_look(name: str) -> None:
    camera: Camera = CAMERAS[name]
    table = FaceTable.make(camera)
    at = texel_bearings(table)
    wanted = bearings(camera).reshape(at.shape)
    # A place in the atlas is in 65536ths of a texel, which is wider where the image is smaller.
    assert np.abs(at - wanted).max() < 2e-5
    planar = np.stack([wanted @ face.axes[0] for face in table.faces]).max(axis=0)
    assert np.abs(table.range_per_depth * planar - 1).max() < 1e-5


@pytest.mark.parametrize("name", CAMERAS)
def test_no_interpolation_reaches_over_the_edge_of_a_face(name: str) -> None:
    table = FaceTable.make(CAMERAS[name])
    x, y = texel_positions(table)
    for face in table.faces:
        inside = (y >= face.row - 0.5) & (y < face.row + face.height - 0.5)
        assert inside.any()
        for place, size in ((x[inside], face.width), (y[inside] - face.row, face.height)):
            assert place.min() >= 0.5
            assert place.max() <= size - 1.5


def test_a_narrow_camera_needs_one_face_and_a_panorama_six() -> None:
    (face,) = FaceTable.make(TSAI).faces
    assert 768 <= face.width < 768 * 1.8
    faces = FaceTable.make(Panorama(1024, 512)).faces
    assert len(faces) == 6
    assert len({(face.width, face.height) for face in faces}) == 1
    assert [face.axes.tolist() for face in faces] == CUBE.tolist()


def test_a_pixel_has_one_texel_where_they_are_fewest() -> None:
    face = FaceTable.make(Panorama(1024, 512)).faces[0]
    # Ahead, a pixel spans 2π/1024.
    assert face.width / (face.high[0] - face.low[0]) * 2 * np.pi / 1024 == pytest.approx(1.0, rel=0.01)


def test_planes_hold_what_a_face_shows() -> None:
    for face in FaceTable.make(TSAI).faces:
        edges = itertools.product((face.low[0], face.high[0]), (face.low[1], face.high[1]))
        corners = [face.axes[0] + right * face.axes[1] + up * face.axes[2] for right, up in edges]
        assert (np.array(corners) @ face.planes.T > -1e-12).all()
        outside = face.axes[0] + 1.01 * face.high[0] * face.axes[1]
        assert (outside @ face.planes.T).min() < 0


def geometry(table: FaceTable, codes: np.ndarray, depth: np.ndarray, limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Sampled codes and ranges."""
    known = np.arange(codes.max() + 1, dtype=np.uint16), np.zeros(codes.max() + 1, dtype=np.uint8)
    sampled = table.sample(Atlas(np.zeros((*codes.shape, 4), np.uint8), codes, depth), limits, known)
    return sampled.instances, sampled.range


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
    seen, found = geometry(table, codes, depth, limits)
    truth = distance / (bearings(Panorama(128, 64)) @ normal).reshape(found.shape)
    before = (truth > 0) & (truth < 50)
    assert (np.abs(found[before] / truth[before] - 1) < 1e-4).all()
    assert (seen == 1).all()
    codes[:, ::2] = 2
    seen, found = geometry(table, codes, depth, limits)
    flat = table.nearest[before]
    assert np.allclose(found[before], table.range_per_depth[before] / (slope * depth.ravel()[flat] + offset), rtol=1e-5)
    seen, found = geometry(table, np.zeros_like(codes), depth, limits)
    assert np.isinf(found).all()


# View_007 of PETS 2009: κ1 is so far below 0 that the lens folds before the image's left corners.
FOLDED = Tsai(720, 576, 3.6936729025, -0.061986350417, 436.10005997, 257.92023557, 1.0, 4.65e-3, 4.65e-3)


def test_past_the_fold_of_a_lens_pixels_are_blind() -> None:
    u, v = np.meshgrid(np.arange(720.0), np.arange(576.0))
    blind = FOLDED.folded(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(576, 720)
    assert 0.001 < blind.mean() < 0.2
    table = FaceTable.make(FOLDED)
    empty = np.arange(table.height) >= max(face.row + face.height for face in table.faces)
    assert (empty[table.nearest // table.width] == blind).all()
    atlas = Atlas(*(np.zeros((table.height, table.width, *rest), kind) for rest, kind in (((4,), np.uint8), ((), np.uint32), ((), np.float32))))
    atlas.colour[~empty], atlas.codes[~empty], atlas.depth[~empty] = 200, 1, 0.5
    sampled = table.sample(atlas, (0.02, 100.0), (np.array([0, 7], np.uint16), np.array([0, 3], np.uint8)))
    assert ((sampled.instances == 0) == blind).all()
    assert ((sampled.classes == 0) == blind).all()
    assert (np.isinf(sampled.range) == blind).all()
    assert (sampled.colour[blind] == 0).all()
    assert (sampled.colour[~blind] == 200).all()
    # Everywhere else the table is as any other.
    at, wanted = texel_bearings(table), bearings(FOLDED).reshape(576, 720, 3)
    assert np.abs(at - wanted)[~blind].max() < 1e-5


def test_a_lens_that_leaves_most_pixels_blind_is_refused() -> None:
    with pytest.raises(ValueError, match=r"% of the pixels of Tsai.* lie past the fold of its lens, needs 50% at most"):
        FaceTable.make(Tsai(720, 576, 3.69, -0.5, 436.1, 257.9, 1.0, 4.65e-3, 4.65e-3))
