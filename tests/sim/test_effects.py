"""Each effect on an image against what its number says."""

import numpy as np
import pytest

from sim.effects import (
    FULL_WELL,
    READ_NOISE,
    ImageEffects,
    OpticalField,
    averaged,
    chromatic_shift,
    counts_of,
    defocus,
    gain_noise,
    halos,
    linear_light,
    parse_effects,
    vignette,
)
from tracker.geometry.cameras import Fisheye, Panorama, Pinhole

LENS = Pinhole(160, 120, 80.0, 80.0, 79.5, 59.5)
ROUND = Fisheye(100, 100, 28.0, 28.0, 49.5, 49.5, field_of_view=np.radians(200))


def picture(camera: Pinhole | Panorama | Fisheye) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (camera.height, camera.width, 3), dtype=np.uint8)


def test_counts_and_light_are_inverse() -> None:
    counts = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    np.testing.assert_array_equal(counts_of(linear_light(counts)), counts)


def test_a_vignette_takes_its_stops_at_the_border_of_the_field() -> None:
    field = OpticalField(LENS)
    out = vignette(np.ones((120, 160, 3), np.float32), field, 2.0)
    assert out[0, 0] == pytest.approx(0.25, abs=1e-3)
    assert out[60, 80] == pytest.approx(1.0, abs=1e-3)


def test_chromatic_shift_moves_red_outward_and_blue_inward() -> None:
    light = np.zeros((120, 160, 3), np.float32)
    light[:, 120:] = 1.0
    out = chromatic_shift(light, OpticalField(LENS), 3.0)
    red, green, blue = (int(np.argmax(out[60, :, k] > 0.5)) for k in range(3))
    radius = float(OpticalField(LENS).radius[60, 120])
    assert green == 120
    assert red - green == pytest.approx(3 * radius, abs=1.0)
    assert red > green > blue


@pytest.mark.parametrize("radius", [2.0, 7.3])
def test_defocus_spreads_a_point_over_its_disc(radius: float) -> None:
    light = np.zeros((120, 160, 3), np.float32)
    light[60, 80] = 1.0
    out = defocus(light, radius, wraps=False)
    assert out.sum() == pytest.approx(3.0, rel=1e-4)
    v, u = np.nonzero(out[..., 0] > 1e-6)
    assert np.hypot(v - 60, u - 80).max() <= radius + 0.75
    # Second moment of a disc: half its squared radius, and that of the pixels themselves.
    moment = (out[..., 0] * np.hypot(*(np.mgrid[:120, :160] - np.array([60, 80])[:, None, None])) ** 2).sum()
    assert moment == pytest.approx(radius**2 / 2 + 1 / 6, rel=0.05)


def test_blur_of_a_panorama_goes_over_the_seam() -> None:
    light = np.zeros((64, 128, 3), np.float32)
    light[32, 0] = 1.0
    out = defocus(light, 3.0, wraps=True)
    assert out[32, -2, 0] == pytest.approx(out[32, 2, 0])
    assert out.sum() == pytest.approx(3.0, rel=1e-4)


@pytest.mark.parametrize("gain", [0.0, 24.0])
def test_noise_grows_with_light_and_gain_as_emva_1288_says(gain: float) -> None:
    factor = 10 ** (gain / 20)
    for level in (0.05, 0.6):
        noisy = gain_noise(np.full((200, 200, 3), level, np.float32), gain, np.random.default_rng(0))
        electrons = level * FULL_WELL / factor
        assert noisy.std() == pytest.approx(np.sqrt(electrons + READ_NOISE**2) * factor / FULL_WELL, rel=0.02)
        assert noisy.mean() == pytest.approx(level, rel=0.01)


def test_halos_overshoot_at_an_edge_alone() -> None:
    counts = np.full((60, 80, 3), 100, np.uint8)
    counts[:, 40:] = 150
    out = halos(counts, 1.0, wraps=False)
    assert out[30, 39, 0] < 90
    assert out[30, 40, 0] > 160
    assert (out[:, :20] == 100).all()


def applied(text: str, camera: Pinhole | Panorama | Fisheye, image: np.ndarray) -> np.ndarray:
    effects = ImageEffects(parse_effects(text), camera, np.random.default_rng(5))
    return effects.processed(effects.captured(image))


@pytest.mark.parametrize("text", ["vignette=1", "defocus=1.5", "chromatic=1", "halos=1", "gain=20", "jpeg=30", "dust=5", "drops=3"])
@pytest.mark.parametrize("camera", [LENS, Panorama(128, 64), ROUND])
def test_effects_are_seeded_and_change_the_image(text: str, camera: Pinhole) -> None:
    image = picture(camera) // 2 + 60
    first, again = (applied(text, camera, image) for _ in range(2))
    assert (first == again).all()
    assert first.dtype == np.uint8
    assert (first != image).any()
    assert (applied("", camera, image) == image).all()


def test_spots_lie_in_the_round_image_and_are_told() -> None:
    made = ImageEffects(parse_effects("dust=40,drops=5"), ROUND, np.random.default_rng(2))
    assert [spot.effect for spot in made.spots] == ["drops"] * 5 + ["dust"] * 40
    assert not ROUND.blind([[spot.u - 0.5, spot.v - 0.5] for spot in made.spots]).any()
    white = np.full((100, 100, 3), 200, np.uint8)
    dusty = ImageEffects(parse_effects("dust=40"), ROUND, np.random.default_rng(2))
    out = dusty.captured(white)
    for spot in dusty.spots:
        assert (out[int(spot.v), int(spot.u)] < 200).all()


def test_an_exposure_of_a_moving_scene_is_a_mean_of_light() -> None:
    black, white = np.zeros((2, 2, 3), np.uint8), np.full((2, 2, 3), 255, np.uint8)
    # Half of the light is 188 counts by the sRGB curve.
    assert (averaged([black, white]) == 188).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("vignet=1", r"\(vignette\?\)"),
        ("shutter=0", "effect shutter is 0, needs 0.0001 to 1 s"),
        ("jpeg=0", "needs 1 to 100"),
        ("jpeg=30.5", "whole number"),
        ("chromatic=0", "but not 0"),
        ("gain=nan", "finite"),
        ("gain=a", "needs a number"),
        ("gain=3,gain=4", "twice"),
        ("subframes=5", "needs the effect shutter"),
        ("shutter=0.01,subframes=4", "odd number"),
        ("vignette", "NAME=VALUE"),
    ],
)
def test_texts_that_are_no_effects(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_effects(text)
