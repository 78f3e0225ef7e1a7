"""Registration bias: true biases are estimated, with slopes for fixed cameras, and the first view keeps its prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.datasets import synthetic_crowd
from tracker.geometry import Array
from tracker.tracks.calibration_bias import RegistrationBias, RegistrationBiasParameters
from tracker.types import Setup

SLOPED = RegistrationBiasParameters(first=0.05)
AREA = np.array([[-8.0, -8.0], [12.0, 6.0]])
SHIFT, SLOPE = np.array([0.3, -0.2]), np.array([[0.05, -0.02], [0.03, -0.04]])


def setup(moving: bool = False) -> Setup:
    whole = synthetic_crowd.setup(2)
    if not moving:
        return replace(whole, area=AREA)
    return replace(whole, area=AREA, starts={name: start and replace(start, covariance=1e-4 * np.eye(6)) for name, start in whole.starts.items()})


def taught(bias: RegistrationBias, camera: str, sigma: float = 0.1, ticks: int = 400) -> Array:
    """Learn from people all over the area, with a true bias of SHIFT and SLOPE; the remaining error (4, 2) m in the middle of each quarter."""
    rng = np.random.default_rng(0)
    H, S = np.eye(2), sigma**2 * np.eye(2)
    for _ in range(ticks):
        place = rng.uniform(*AREA, (5, 2))
        off = SHIFT + (place - AREA.mean(axis=0)) @ SLOPE.T - bias.at(camera, place)
        innovations = off + rng.normal(0, sigma, off.shape), np.repeat(H[None], 5, axis=0), np.repeat(S[None], 5, axis=0)
        bias.learn(camera, place, innovations)
    corner = AREA.mean(axis=0) + np.array([[-5, -3], [5, -3], [-5, 3], [5, 3]])
    return np.asarray(SHIFT + (corner - AREA.mean(axis=0)) @ SLOPE.T - bias.at(camera, corner))


def test_a_bias_that_changes_over_the_ground_is_estimated() -> None:
    whole = setup()
    bias = RegistrationBias(whole, SLOPED)
    left = taught(bias, list(whole.mounts)[1])
    assert np.abs(left).max() < 0.05
    np.testing.assert_allclose(bias.of(list(whole.mounts)[1]), [*SHIFT, *SLOPE.ravel()], atol=0.01)
    assert not bias.of(next(iter(whole.mounts))).any()


def test_the_bias_is_constant_for_moving_robots() -> None:
    whole = setup(moving=True)
    bias, camera = RegistrationBias(whole, SLOPED), list(whole.mounts)[1]
    taught(bias, camera)
    assert not bias.of(camera)[2:].any()
    np.testing.assert_allclose(bias.of(camera)[:2], SHIFT, atol=0.06)


def test_the_first_view_keeps_a_tight_prior() -> None:
    whole = setup()
    first = next(iter(whole.mounts))
    sure, open_ = RegistrationBias(whole, SLOPED), RegistrationBias(whole, replace(SLOPED, first=0.3))
    for bias in (sure, open_):
        taught(bias, first, ticks=20)
    assert np.linalg.norm(sure.of(first)[:2]) < 0.5 * np.linalg.norm(open_.of(first)[:2])


def test_nothing_is_learned_where_it_is_switched_off_or_without_innovations() -> None:
    whole = setup()
    camera = list(whole.mounts)[1]
    off, blind = RegistrationBias(whole, replace(SLOPED, sigma=0.0)), RegistrationBias(whole, SLOPED)
    taught(off, camera, ticks=5)
    blind.learn(camera, np.zeros((1, 2)), (np.full((1, 2), np.nan), np.eye(2)[None], np.eye(2)[None]))
    assert not off.of(camera).any()
    assert not blind.of(camera).any()
