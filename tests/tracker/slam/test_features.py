from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

from tracker.geometry import bearing_from_angles, exp_so3, rotation_z, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.slam.features import FeatureParameters, Features, extract, inside_boxes, leveling_rotation
from tracker.types import Detections

CAMERA = Panorama(1024, 512)
UP = np.array([0.0, 0.0, 1.0])


@cache
def sphere() -> np.ndarray:
    """A texture at every scale on the sphere, 2048 × 4096, RGB; smooth over the seam."""
    rng = np.random.default_rng(5)
    total = np.zeros((2048, 4096), dtype=np.float32)
    for cell in (8, 16, 32, 64, 128):
        noise = rng.normal(size=(2048 // cell, 4096 // cell)).astype(np.float32)
        noise = np.concatenate([noise, noise[:, :1]], axis=1)
        total += cell**0.5 * cv2.resize(noise, (4096 + cell, 2048), interpolation=cv2.INTER_CUBIC)[:, :4096]
    grey = np.clip(128 + 45 * total / total.std(), 0, 255).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def panorama(rotation: np.ndarray, seed: int = 0) -> np.ndarray:
    """The sphere seen by a camera with R_world_camera, 512 × 1024, drawn at double size and averaged, with noise of two grey levels."""
    v, u = np.mgrid[0:1024, 0:2048]
    b = Panorama(2048, 1024).bearings_from_pixels(np.stack([u.ravel() + 0.5, v.ravel() + 0.5], axis=1)) @ rotation.T
    p, _ = Panorama(4096, 2048).pixels_from_bearings(b)
    p = (p - 0.5).astype(np.float32).reshape(1024, 2048, 2)
    large = cv2.remap(sphere(), p[..., 0], p[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    small = cv2.resize(large, (1024, 512), interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.clip(small + 2 * np.random.default_rng(seed).normal(size=small.shape), 0, 255).astype(np.uint8)


@cache
def seen(axis: tuple[float, float, float], seed: int = 0) -> Features:
    R = exp_so3(axis)
    return extract(panorama(R, seed), CAMERA, R[2], Detections.none(), FeatureParameters())


def match(a: np.ndarray, b: np.ndarray, ratio: float = 0.85, max_distance: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of rows of unit descriptors a (n, d), b (m, d) that are mutual nearest neighbours.

    Their distance is below `max_distance` and below `ratio` of the second (Lowe 2004).
    """
    if len(a) == 0 or len(b) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    # No two patches are alike to the last digit: a floor keeps the ratio of two that nearly are away from 0 / 0.
    distance = np.sqrt(np.maximum(2 - 2 * a @ b.T, 1e-4))
    best = distance.argmin(axis=1)
    rows = np.arange(len(a))
    value = distance[rows, best]
    mutual = distance.argmin(axis=0)[best] == rows
    distance[rows, best] = np.inf
    good = np.flatnonzero(mutual & (value < max_distance) & (value <= ratio * distance.min(axis=1)))
    return good, best[good]


def agreement(axis: tuple[float, float, float]) -> tuple[float, float]:
    """The share of correct matches (1° off at most) between a level and a tilted view, and their error in degrees an axis."""
    a, b, R = seen((0, 0, 0)), seen(axis, 1), exp_so3(axis)
    i, j = match(a.descriptor, b.descriptor)
    assert len(i) > 60
    error = ((b.bearing[j] @ R.T)[:, None] @ tangent_basis(a.bearing[i]).transpose(0, 2, 1))[:, 0]
    right = np.linalg.norm(error, axis=1) < np.radians(1)
    return float(right.mean()), float(np.degrees(np.sqrt((error[right] ** 2).mean())))


@pytest.mark.parametrize("axis", [(0, 0, 0.3), (0, 0, np.pi / 2), (0, 0, np.pi - 0.01), (0.17, 0, 0), (0, -0.17, 0), (0.2, 0.2, 1.0)])
def test_correct_matches_are_accurate_to_an_eighth_of_a_degree(axis: tuple[float, float, float]) -> None:
    right, error = agreement(axis)
    assert right > 0.95
    assert error < 0.12


def test_features_are_everywhere_but_at_the_poles() -> None:
    f, rule = seen((0, 0, 0)), FeatureParameters()
    assert len(f) == rule.limit
    elevation = np.arcsin(f.bearing[:, 2])
    assert np.abs(elevation).max() <= rule.elevation + 0.01
    azimuth = np.arctan2(f.bearing[:, 1], f.bearing[:, 0])
    assert np.histogram(azimuth, 16, (-np.pi, np.pi))[0].min() >= 0.4 * rule.limit / 16
    np.testing.assert_allclose(np.linalg.norm(f.bearing, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(f.descriptor, axis=1), 1, atol=1e-5)


def test_features_at_the_seam_are_found_again() -> None:
    """Features within 10° of the seam behind are matched after a rotation that brings them ahead."""
    a, b = seen((0, 0, 0)), seen((0, 0, np.pi - 0.01), 1)
    behind = a.bearing[:, 0] < -np.cos(np.radians(10)) * np.hypot(a.bearing[:, 0], a.bearing[:, 1])
    assert behind.sum() >= 8
    i, j = match(a.descriptor[behind], b.descriptor)
    error = np.linalg.norm(b.bearing[j] @ rotation_z(np.pi - 0.01).T - a.bearing[behind][i], axis=1)
    assert (error < np.radians(0.5)).sum() >= 0.35 * behind.sum()


def test_a_turned_camera_gives_bearings_in_its_own_frame() -> None:
    """R b is the same direction on the sphere for every attitude R of the camera."""
    axis = (0.25, -0.15, 0.4)
    right, error = agreement(axis)
    assert right > 0.95
    assert error < 0.15


def test_features_on_people_are_excluded() -> None:
    b = bearing_from_angles([np.pi - 0.05, 0.5], [0.0, -0.2])
    people = Detections(b, np.array([[0.5, 0.6], [0.4, 0.5]]), np.ones(2), np.tile(np.eye(2) * 1e-4, (2, 1, 1)), np.zeros((2, 0)))
    image = panorama(np.eye(3))
    with_people = extract(image, CAMERA, UP, people, FeatureParameters())
    assert not inside_boxes(with_people.bearing, people, 1.0).any()
    assert inside_boxes(seen((0, 0, 0)).bearing, people, 1.0).any()


def test_the_stated_deviation_of_a_bearing_is_in_proportion_to_its_patch() -> None:
    f, rule = seen((0, 0, 0)), FeatureParameters()
    np.testing.assert_allclose(rule.bearing_sigma(np.array([0.001, 0.02, 0.025, 0.05, 0.1, 0.2])), [0.0016, 0.0016, 0.002, 0.004, 0.008, 0.008])
    between = (f.size > 0.02) & (f.size < 0.1)
    assert between.sum() > 0.8 * len(f)
    np.testing.assert_allclose(f.sigma[between], 0.08 * f.size[between])
    np.testing.assert_allclose(f.sightings().covariance, f.sigma[:, None, None] ** 2 * np.eye(2))
    assert f.size.max() > 2 * f.size.min(), "patches of several sizes"


def test_a_plain_image_has_no_features() -> None:
    f = extract(np.full((512, 1024, 3), 90, dtype=np.uint8), CAMERA, UP, Detections.none(), FeatureParameters())
    assert len(f) == 0
    assert f.descriptor.shape == (0, 128)
    assert len(f.sightings()) == 0


@pytest.mark.parametrize("tilt", [0.0, 1e-7, 0.0169, 0.0171, 0.5, 2.0])
def test_leveling_brings_up_to_z(tilt: float) -> None:
    up = exp_so3([0, 0, 0.7]) @ exp_so3([tilt, 0, 0]) @ UP
    R = leveling_rotation(up, 0.0)
    np.testing.assert_allclose(R.T @ up, UP, atol=1e-9)
    if tilt < 0.017:
        np.testing.assert_array_equal(leveling_rotation(up, 0.017), np.eye(3))
