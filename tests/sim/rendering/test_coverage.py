"""Unoccluded extents against counts by hand, and boxes across the seam."""

import numpy as np
import pytest

from sim.rendering.coverage import BITS, covered

NEAREST = np.arange(8 * 16, dtype=np.int32).reshape(8, 16)
NEAREST.flags.writeable = False


def bits_of(masks: list[np.ndarray]) -> np.ndarray:
    return np.sum([mask.astype(np.uint32) << k for k, mask in enumerate(masks)], axis=0, dtype=np.uint32)


@pytest.mark.parametrize("seed", range(5))
def test_extents_match_the_masks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    masks = [rng.random((8, 16)) < rng.uniform(0, 0.1) for _ in range(BITS)]
    for mask, body in zip(masks, covered(bits_of(masks), NEAREST, BITS, wraps=False), strict=True):
        assert body.pixels == mask.sum()
        if not mask.any():
            assert np.isnan(body.box).all()
            continue
        v, u = np.nonzero(mask)
        assert body.box.tolist() == [u.min(), v.min(), u.max() + 1, v.max() + 1]


def test_texels_are_looked_up_where_pixels_lie() -> None:
    mask = np.zeros((8, 16), bool)
    mask[2, 3] = True
    (body,) = covered(bits_of([mask]), np.full((4, 4), 2 * 16 + 3, np.int32), 1, wraps=False)
    assert body.pixels == 16


def test_a_box_over_the_seam_starts_left_of_it() -> None:
    mask = np.zeros((8, 16), bool)
    mask[3:5, [14, 15, 0, 1, 2]] = True
    (body,) = covered(bits_of([mask]), NEAREST, 1, wraps=True)
    assert body.box.tolist() == [14, 3, 19, 5]
    (flat,) = covered(bits_of([mask]), NEAREST, 1, wraps=False)
    assert flat.box.tolist() == [0, 3, 16, 5]


def test_a_box_around_the_whole_panorama_is_one_image_wide() -> None:
    (body,) = covered(bits_of([np.ones((8, 16), bool)]), NEAREST, 1, wraps=True)
    assert body.box[2] - body.box[0] == 16
