"""Exposure and noise have the given sigma, and the same seed gives the same bytes."""

import numpy as np
import pytest

from sim.sensors.exposure import TIME_CONSTANT, Exposure

GREY = np.full((32, 64, 3), 100, np.uint8)


def test_without_drift_and_noise_images_pass_unchanged() -> None:
    rng = np.random.default_rng(1)
    assert Exposure(0.0, 0.0, 0.2, rng).apply(GREY) is GREY
    assert rng.random() == np.random.default_rng(1).random()


def test_noise_has_its_sigma() -> None:
    noisy = Exposure(0.0, 4.0, 0.2, np.random.default_rng(2)).apply(GREY)
    assert noisy.std() == pytest.approx(np.hypot(4.0, np.sqrt(1 / 12)), rel=0.03)
    assert noisy.mean() == pytest.approx(100, abs=0.3)


def test_exposure_drifts_slowly_and_by_its_sigma() -> None:
    step, rng = 0.2, np.random.default_rng(3)
    camera = Exposure(0.3, 0.0, step, rng)
    stops = np.log2([camera.apply(GREY)[0, 0, 0] / 100 for _ in range(4000)])
    assert stops.std() == pytest.approx(0.3, rel=0.15)
    later = np.corrcoef(stops[:-1], stops[1:])[0, 1]
    assert later == pytest.approx(np.exp(-step / TIME_CONSTANT), abs=0.02)


def test_overexposed_pixels_saturate() -> None:
    bright = Exposure(0.0, 50.0, 0.2, np.random.default_rng(4)).apply(np.full((8, 8, 3), 250, np.uint8))
    assert bright.max() == 255
    assert bright.min() > 20


def test_the_same_seed_gives_the_same_bytes() -> None:
    first, second = (Exposure(0.5, 3.0, 0.2, np.random.default_rng(9)) for _ in range(2))
    for _ in range(3):
        assert (first.apply(GREY) == second.apply(GREY)).all()


@pytest.mark.parametrize(("stops", "noise", "name"), [(-0.1, 0, "exposure"), (0, -1, "image_noise"), (float("nan"), 0, "exposure")])
def test_an_invalid_sigma_is_refused(stops: float, noise: float, name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is"):
        Exposure(stops, noise, 0.2, np.random.default_rng(0))
