from __future__ import annotations

import numpy as np
import pytest

from tracker.geometry import Array, rotation_z, wrap
from tracker.slam.resection import Resection, Search, resect

NONE = np.zeros(40)


def scene(rng: np.random.Generator, right: int, noise: float = 0.01) -> tuple[Array, Array, Array, float]:
    """Directions and places (40, 3), of which the pairs from `right` on are wrong, in a random order; where from, and the yaw."""
    origin, yaw = rng.uniform([-5, -5, 0], [5, 5, 1]), float(rng.uniform(-np.pi, np.pi))
    around = rng.uniform(-np.pi, np.pi, 40)
    reach = rng.uniform(2, 12, 40)
    place = origin + np.stack([reach * np.cos(around), reach * np.sin(around), rng.uniform(-1, 3, 40)], axis=1)
    direction = (place - origin) @ rotation_z(yaw)
    direction += noise * np.linalg.norm(direction, axis=1, keepdims=True) * rng.normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    place[right:] = rng.permutation(place[right:])
    order = rng.permutation(40)
    return direction[order], place[order], origin, yaw


@pytest.mark.parametrize("right", [16, 26, 40])
def test_place_and_yaw_are_found_among_wrong_pairs(right: int) -> None:
    rng = np.random.default_rng(right)
    for _ in range(10):
        direction, place, origin, yaw = scene(rng, right)
        found = resect(direction, place, NONE, Search())
        assert isinstance(found, Resection)
        assert right - 3 <= len(found.agreed) <= right + 4
        error = np.append(found.origin - origin, wrap(found.yaw - yaw))
        # The bearings are twice as good as the search believes.
        assert error @ np.linalg.solve(found.covariance, error) < 18
        assert np.linalg.norm(error[:3]) < 0.15


def test_without_noise_it_is_exact() -> None:
    direction, place, origin, yaw = scene(np.random.default_rng(1), 40, noise=0.0)
    found = resect(direction, place, NONE, Search())
    assert isinstance(found, Resection)
    np.testing.assert_allclose(found.origin, origin, atol=1e-9)
    assert wrap(found.yaw - yaw) == pytest.approx(0, abs=1e-9)


def test_pairs_at_random_are_no_place() -> None:
    rng = np.random.default_rng(3)
    found = [resect(*scene(rng, 0)[:2], NONE, Search()) for _ in range(100)]
    assert found.count("places disagree") + found.count("place not sharp") == 100


def test_few_pairs_are_refused() -> None:
    direction, place, *_ = scene(np.random.default_rng(2), 40)
    assert resect(direction[:6], place[:6], NONE, Search()) == "too little alike"
    with pytest.raises(ValueError, match="pairs is 3"):
        Search(pairs=3)


def test_landmarks_above_each_other_do_not_tell_the_yaw() -> None:
    """All in one vertical line: any turn about it fits."""
    place = np.stack([np.full(10, 4.0), np.zeros(10), np.linspace(-1, 3, 10)], axis=1)
    direction = place / np.linalg.norm(place, axis=1, keepdims=True)
    assert isinstance(resect(direction, place, NONE, Search()), str)
