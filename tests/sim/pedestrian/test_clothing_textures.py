import numpy as np
import pytest

from sim.pedestrian import clothing_textures
from sim.pedestrian.clothing_textures import ACROSS, BAGS, BOTTOMS, HEADS, SHOES, TILE, TOPS, region, texture_atlas


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return texture_atlas(np.random.default_rng(3))


def tile(picture: np.ndarray, k: int) -> np.ndarray:
    row, column = k // ACROSS * TILE, k % ACROSS * TILE
    return picture[row : row + TILE, column : column + TILE].astype(float)


def test_tiles_fill_the_picture_and_none_is_like_another(picture):
    numbers = [*HEADS, *TOPS, *BOTTOMS, *SHOES, *BAGS]
    assert numbers == list(range(ACROSS**2))
    assert picture.shape == (ACROSS * TILE, ACROSS * TILE, 3)
    small = np.array([tile(picture, k)[::16, ::16].ravel() for k in numbers])
    apart = np.abs(small[:, None] - small).mean(axis=2) + 1e3 * np.eye(len(small))
    assert apart.min() > 2.0
    assert min(tile(picture, k).std() for k in numbers) > 1.0


def test_regions_stay_inside_of_their_tile():
    for k in range(ACROSS**2):
        u0, v0, u1, v1 = region(k, (0.0, 0.0, 1.0, 1.0)) * ACROSS
        assert k % ACROSS + 0.01 < u0 < u1 < k % ACROSS + 0.99
        assert k // ACROSS + 0.01 < v0 < v1 < k // ACROSS + 0.99


def test_a_face_has_two_white_eyes_and_a_mouth_below(picture):
    for k in (1, 5, 12):
        head = tile(picture, k)
        pale = head.min(axis=2) > 200
        rows, columns = np.nonzero(pale & (np.arange(TILE)[:, None] > 0.3 * TILE) & (np.arange(TILE)[:, None] < 0.5 * TILE))
        assert (np.abs(columns - 127.5) < 32).mean() > 0.9 or head[200].min() > 200
        assert (columns < 120).any()
        assert (columns > 135).any()
        assert rows.mean() < 0.6 * TILE


def test_the_same_stream_paints_the_same_picture(picture):
    np.testing.assert_array_equal(texture_atlas(np.random.default_rng(3)), picture)
    assert clothing_textures.NAME == "people"
