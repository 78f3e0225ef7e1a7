"""Sampling of an atlas, texel by texel."""

import numpy as np

from sim.rendering.cubemap import Atlas, inverse_depth, values_and_ranges

LIMITS = (0.02, 100.0)


def test_depth_is_1_near_and_0_far() -> None:
    slope, offset = inverse_depth(*LIMITS)
    np.testing.assert_allclose([1 / (slope + offset), 1 / offset], LIMITS)


def test_codes_are_the_nearest_and_range_is_between_texels_of_one_thing_only() -> None:
    rng = np.random.default_rng(4)
    height, width, shape = 20, 30, (40, 50)
    codes = rng.integers(0, 3, (height // 2, width // 2)).repeat(2, axis=0).repeat(2, axis=1).astype(np.uint32)
    depth = rng.uniform(1e-3, 1, (height, width)).astype(np.float32)
    first = (rng.integers(0, height - 1, shape) * width + rng.integers(0, width - 1, shape)).astype(np.uint32)
    fraction, range_per_depth = rng.integers(0, 1 << 16, (*shape, 2)).astype(np.uint16), rng.uniform(1, 1.7, shape).astype(np.float32)
    atlas = Atlas(np.zeros((height, width, 4), np.uint8), codes, depth)
    lookups = np.array([0, 1, 2], np.uint16), np.array([0, 20, 10], np.uint8)
    seen, other, found = values_and_ranges(atlas, (first, fraction, range_per_depth), LIMITS, lookups)
    assert (other == lookups[1][seen]).all()
    slope, offset = inverse_depth(*LIMITS)
    smooth = 0
    for place in np.ndindex(shape):
        (row, column), (a, b) = divmod(int(first[place]), width), fraction[place] / 65536
        square = codes[row : row + 2, column : column + 2]
        near = row + int(b >= 0.5), column + int(a >= 0.5)
        assert seen[place] == codes[near]
        if codes[near] == 0:
            assert np.isinf(found[place])
            continue
        deep = float(depth[near])
        if (square == codes[near]).all():
            smooth += 1
            deep = float(np.array([1 - b, b]) @ depth[row : row + 2, column : column + 2].astype(float) @ np.array([1 - a, a]))
        assert abs(found[place] * (slope * deep + offset) / range_per_depth[place] - 1) < 1e-4
    assert 100 < smooth < 1200
