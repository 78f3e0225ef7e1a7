"""Adaptive measurement noise: true variances are estimated, and a view that is worse than assumed does less harm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.geometry import Array, tangent_basis
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, track
from tracker.tracks.measurement_noise import MAX_RATIO, MeasurementNoise, MeasurementNoiseParameters
from tracker.tracks.parameters import MhtParameters
from tracker.types import Setup, Tick

BOX, PERSON = np.diag([1e-4, 4e-4]), np.diag([2e-4, 1e-4])
"""rad², assumed covariance of boxes, and covariance of predictions."""


def taught(times: tuple[float, float], excess: float = 1.0, count: int = 2000) -> Array:
    """Estimated ratios after so many innovations of boxes whose variances are `times` the assumed ones."""
    noise, rng = MeasurementNoise(MeasurementNoiseParameters(excess=excess)), np.random.default_rng(0)
    true = PERSON + BOX * np.array(times)
    for _ in range(count // 4):
        k = np.sqrt(noise.of("view"))
        box = BOX * np.outer(k, k)
        residual = rng.multivariate_normal(np.zeros(2), true, 4)
        noise.learn("view", residual, np.repeat((PERSON + box)[None], 4, axis=0), np.repeat(box[None], 4, axis=0))
    return noise.of("view")


def test_noise_is_estimated_in_each_direction() -> None:
    np.testing.assert_allclose(taught((1.0, 4.0)), [1.0, 4.0], rtol=0.2)


def test_the_excess_factor_scales_the_estimate() -> None:
    np.testing.assert_allclose(taught((1.0, 3.0), excess=2.0), [1.0, 5.0], rtol=0.25)
    np.testing.assert_array_equal(taught((1.0, 3.0), excess=0.0), 1.0)


def test_ratios_stay_within_bounds() -> None:
    np.testing.assert_array_equal(taught((0.2, 0.2)), 1.0)
    np.testing.assert_array_equal(taught((50.0, 50.0)), MAX_RATIO)


def test_missing_innovations_change_nothing() -> None:
    noise = MeasurementNoise(MeasurementNoiseParameters())
    noise.learn("view", np.full((50, 2), np.nan), np.repeat(BOX[None], 50, axis=0), np.repeat(BOX[None], 50, axis=0))
    noise.learn("view", np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2, 2)))
    np.testing.assert_array_equal(noise.of("view"), 1.0)


def with_noise(ticks: list[Tick], camera: str, sigma: float) -> list[Tick]:
    """Ticks in which the boxes of a camera have additional errors of so many rad in elevation."""
    rng, out = np.random.default_rng(1), []
    for tick in ticks:
        views = []
        for view in tick.views:
            up = tangent_basis(view.detections.bearing)[:, 1]
            moved = view.detections.bearing + (view.camera == camera) * rng.normal(0, sigma, (len(view.detections), 1)) * up
            bearing = moved / np.linalg.norm(moved, axis=1)[:, None]
            views.append(replace(view, detections=replace(view.detections, bearing=bearing)))
        out.append(replace(tick, views=tuple(views)))
    return out


def mean_error(setup: Setup, walked: Array, ticks: list[Tick], noise: MeasurementNoiseParameters) -> float:
    """Mean distance, m, of people from their reported places."""
    reported = track(setup, ticks, Parameters(targets=MhtParameters(noise=noise)))
    frames = [MatchingFrame(np.arange(walked.shape[1]), places, e.target_id, e.position) for places, e in zip(walked, reported, strict=True)]
    return score(frames).motp_m


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_a_noisy_view_does_less_harm_with_adaptive_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    setup, walked = synthetic_crowd.setup(3), synthetic_crowd.paths(6, 80, rng)
    ticks = with_noise(synthetic_crowd.ticks(setup, walked, rng), list(setup.mounts)[1], 0.02)
    assert mean_error(setup, walked, ticks, MeasurementNoiseParameters()) < 0.9 * mean_error(
        setup, walked, ticks, MeasurementNoiseParameters(excess=0.0)
    )
