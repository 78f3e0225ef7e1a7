from __future__ import annotations

import numpy as np
import pytest

from tracker.geometry import Array, rotation_z, wrap
from tracker.slam.resection import RelocalizationParameters, Resection, resect

NONE = np.zeros(40)


def scene(rng: np.random.Generator, right: int, noise: float = 0.01) -> tuple[Array, Array, Array, float]:
    """Directions and points (40, 3) in a random order, of which those from `right` on are wrong pairs; the origin and the yaw."""
    origin, yaw = rng.uniform([-5, -5, 0], [5, 5, 1]), float(rng.uniform(-np.pi, np.pi))
    around = rng.uniform(-np.pi, np.pi, 40)
    reach = rng.uniform(2, 12, 40)
    point = origin + np.stack([reach * np.cos(around), reach * np.sin(around), rng.uniform(-1, 3, 40)], axis=1)
    direction = (point - origin) @ rotation_z(yaw)
    direction += noise * np.linalg.norm(direction, axis=1, keepdims=True) * rng.normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    point[right:] = rng.permutation(point[right:])
    order = rng.permutation(40)
    return direction[order], point[order], origin, yaw


@pytest.mark.parametrize("right", [16, 26, 40])
def test_position_and_yaw_are_found_among_wrong_pairs(right: int) -> None:
    rng = np.random.default_rng(right)
    for _ in range(10):
        direction, point, origin, yaw = scene(rng, right)
        found = resect(direction, point, NONE, RelocalizationParameters())
        assert isinstance(found, Resection)
        assert right - 3 <= len(found.inliers) <= right + 4
        error = np.append(found.origin - origin, wrap(found.yaw - yaw))
        # The noise of the bearings is half of the tolerance.
        assert error @ np.linalg.solve(found.covariance, error) < 18
        assert np.linalg.norm(error[:3]) < 0.15


def test_random_pairs_have_no_consensus() -> None:
    rng = np.random.default_rng(3)
    found = [resect(*scene(rng, 0)[:2], NONE, RelocalizationParameters()) for _ in range(100)]
    assert found.count("places disagree") + found.count("place not sharp") == 100


def test_landmarks_on_a_vertical_line_leave_yaw_unobservable() -> None:
    """Any rotation about that line fits."""
    point = np.stack([np.full(10, 4.0), np.zeros(10), np.linspace(-1, 3, 10)], axis=1)
    direction = point / np.linalg.norm(point, axis=1, keepdims=True)
    assert isinstance(resect(direction, point, NONE, RelocalizationParameters()), str)
