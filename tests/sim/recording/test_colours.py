"""Exposure and noise have the given sigma, and draw nothing where they are off."""

import numpy as np
import pytest

from sim.recording.shots import TIME_CONSTANT, Exposure

GREY = np.full((32, 64, 3), 100, np.uint8)


def test_without_drift_and_noise_images_pass_unchanged() -> None:
    rng = np.random.default_rng(1)
    assert Exposure(0.0, 0.0, 0.2, rng).apply(GREY) is GREY
    assert rng.random() == np.random.default_rng(1).random()


def test_noise_has_its_sigma_and_saturates() -> None:
    noisy = Exposure(0.0, 4.0, 0.2, np.random.default_rng(2)).apply(GREY)
    assert noisy.std() == pytest.approx(np.hypot(4.0, np.sqrt(1 / 12)), rel=0.03)
    assert noisy.mean() == pytest.approx(100, abs=0.3)
    bright = Exposure(0.0, 50.0, 0.2, np.random.default_rng(4)).apply(np.full((8, 8, 3), 250, np.uint8))
    assert (bright.max(), bright.min() > 20) == (255, True)


def test_exposure_drifts_slowly_and_by_its_sigma() -> None:
    step, rng = 0.2, np.random.default_rng(3)
    camera = Exposure(0.3, 0.0, step, rng)
    stops = np.log2([camera.apply(GREY)[0, 0, 0] / 100 for _ in range(4000)])
    assert stops.std() == pytest.approx(0.3, rel=0.15)
    assert np.corrcoef(stops[:-1], stops[1:])[0, 1] == pytest.approx(np.exp(-step / TIME_CONSTANT), abs=0.02)
