"""Windows of a panorama against sets of pixels."""

import numpy as np
import pytest

from sim.windows import apart, around, columns, layers, tight
from tests.sim.scenes import bearings
from tracker.cameras import Panorama

CAMERA = Panorama(128, 64)


def pixels(window: np.ndarray) -> set[tuple[int, int]]:
    return {(int(u), v) for u in columns(window, CAMERA.width) for v in range(window[1], window[3])}


@pytest.mark.parametrize("seed", range(40))
def test_a_window_holds_the_balls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    centres, radii = rng.normal(size=3) * 2 + rng.normal(size=(n, 3)) * 0.3, rng.uniform(0.05, 0.8, n)
    window = around(centres, radii, CAMERA)
    along = bearings(CAMERA)
    ahead = along @ centres.T
    hit = (np.linalg.norm(centres, axis=1) <= radii) | ((ahead > 0) & (np.linalg.norm(centres, axis=1) ** 2 - ahead**2 <= radii**2))
    v, u = np.divmod(np.flatnonzero(hit.any(axis=1)), CAMERA.width)
    assert set(zip(u.tolist(), v.tolist(), strict=True)) <= pixels(window)
    assert 0 <= window[0] < CAMERA.width
    assert window[2] - window[0] <= CAMERA.width


def test_a_window_is_not_much_larger_than_a_ball() -> None:
    u0, v0, u1, v1 = around(np.array([[-5.0, 0.0, 0.0]]), np.array([0.5]), CAMERA)
    assert u0 < CAMERA.width < u1
    assert u1 - u0 <= 9
    assert v1 - v0 <= 9


def test_nobody_has_no_window() -> None:
    assert not pixels(around(np.zeros((0, 3)), np.zeros(0), CAMERA))


def random_windows(seed: int, n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    u0, v0 = rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height - 1, n)
    u1, v1 = u0 + rng.integers(1, CAMERA.width // 2, n), np.minimum(v0 + rng.integers(1, 30, n), CAMERA.height)
    return list(np.stack([u0, v0, u1, v1], axis=1))


def test_apart_is_to_share_no_pixel() -> None:
    for a, b in zip(random_windows(0, 300), random_windows(1, 300), strict=True):
        assert apart(a, b, CAMERA.width) == (not pixels(a) & pixels(b))
    everything = np.array([0, 0, CAMERA.width, CAMERA.height])
    assert not apart(everything, np.array([100, 10, 140, 20]), CAMERA.width)


def test_layers_hold_every_window_once_and_none_overlaps() -> None:
    windows = random_windows(2, 30)
    dealt = layers(windows, CAMERA.width)
    assert sorted(k for layer in dealt for k in layer) == list(range(30))
    for layer in dealt:
        counted = [pixels(windows[k]) for k in layer]
        assert len(set().union(*counted)) == sum(len(each) for each in counted)


def test_tight() -> None:
    window = np.array([120, 10, 140, 20])
    mask = np.zeros((10, 20), bool)
    assert np.isnan(tight(mask, window, CAMERA.width)).all()
    mask[2:5, 3:9] = True
    np.testing.assert_array_equal(tight(mask, window, CAMERA.width), [123, 12, 129, 15])
    mask[2:5, :9] = False
    mask[6, 10:12] = True
    np.testing.assert_array_equal(tight(mask, window, CAMERA.width), [2, 16, 4, 17])


def test_tight_all_around_starts_after_the_widest_gap() -> None:
    whole = np.array([0, 0, CAMERA.width, CAMERA.height])
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[3, [125, 126, 1, 4]] = True
    np.testing.assert_array_equal(tight(mask, whole, CAMERA.width), [125, 3, 133, 4])
    mask[:, :] = True
    np.testing.assert_array_equal(tight(mask, whole, CAMERA.width), [0, 0, CAMERA.width, CAMERA.height])
