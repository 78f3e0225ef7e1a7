"""The background model on a synthetic scene: foreground, unknown pixels, shadows, and what becomes background."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tracker.detections.background import ABSORB_OBJECT, PERSON_MEMORY, STABLE, BackgroundModel
from tracker.geometry import Mask

SHAPE, PERIOD = (60, 80), 1 / 7
RNG = np.random.default_rng(0)
GROUND = RNG.integers(60, 200, (*SHAPE, 3))
RED = np.array([200, 30, 40])
NOBODY = np.zeros(SHAPE, dtype=bool)


def image(rng: np.random.Generator, where: Mask = NOBODY, colour: NDArray[np.int64] = RED, dim: float = 1.0) -> NDArray[np.uint8]:
    """The ground with noise, and something of a colour on it; everything by `dim` darker."""
    scene = np.where(where[..., None], colour, GROUND) * dim + rng.normal(0, 3, (*SHAPE, 3))
    return np.clip(scene, 0, 255).astype(np.uint8)


def block(left: int, top: int = 15, width: int = 10, height: int = 25) -> Mask:
    out = NOBODY.copy()
    out[top : top + height, left : left + width] = True
    return out


def settled(rng: np.random.Generator, ticks: int = 40) -> BackgroundModel:
    model = BackgroundModel(PERIOD)
    for _ in range(ticks):
        model.step(image(rng), NOBODY)
    return model


def test_a_stable_scene_becomes_known_and_has_no_foreground() -> None:
    rng, model = np.random.default_rng(1), BackgroundModel(PERIOD)
    for tick in range(30):
        body, unknown = model.step(image(rng), NOBODY)
        assert unknown.all() or tick * PERIOD > STABLE
        assert body.mean() < 0.005
    assert unknown.mean() < 0.01


def test_walking_people_are_foreground() -> None:
    rng = np.random.default_rng(2)
    model = settled(rng)
    for left in range(5, 65, 6):
        body, _ = model.step(image(rng, block(left)), NOBODY)
        assert body[block(left)].mean() > 0.95
        assert (body & ~block(left - 2, 13, 14, 29)).sum() < 20


def test_shadows_are_no_foreground() -> None:
    rng = np.random.default_rng(3)
    model = settled(rng)
    where = block(30)[..., None]
    body, _ = model.step(np.where(where, image(rng, dim=0.75), image(rng)), NOBODY)
    assert body.mean() < 0.02


def test_people_at_the_start_stay_unknown_while_a_detector_finds_them() -> None:
    rng, model = np.random.default_rng(4), BackgroundModel(PERIOD)
    for _ in range(60):
        _, unknown = model.step(image(rng, block(30)), block(30))
    assert unknown[block(30)].all()
    for _ in range(30):
        body, unknown = model.step(image(rng), NOBODY)
    assert not unknown[block(30)].any()
    assert body.mean() < 0.01


def test_people_who_stop_stay_foreground_and_other_objects_become_background() -> None:
    rng = np.random.default_rng(5)
    person, thing = block(15), block(50)
    model = settled(rng)
    for _ in range(round(ABSORB_OBJECT * 4 / PERIOD)):
        body, _ = model.step(image(rng, person | thing), person)
    assert body[person].mean() > 0.9
    assert body[thing].mean() < 0.1
    # Boxes are missing, but recent ones keep the person in the foreground.
    for _ in range(round(0.8 * PERSON_MEMORY / PERIOD)):
        body, _ = model.step(image(rng, person | thing), NOBODY)
    assert body[person].mean() > 0.9


def test_a_change_of_light_or_size_starts_the_model_anew() -> None:
    rng = np.random.default_rng(6)
    model = settled(rng)
    body, unknown = model.step(255 - image(rng), NOBODY)
    assert not body.any()
    assert unknown.all()
    _, unknown = model.step(np.zeros((20, 30, 3), dtype=np.uint8), np.zeros((20, 30), dtype=bool))
    assert unknown.shape == (20, 30)


@pytest.mark.parametrize("every", [1, 3])
def test_times_of_the_background_are_seconds_at_any_rate_of_images(every: int) -> None:
    """A thing appears, and a scene becomes known, after the same time with every image as with every third."""
    rng, thing = np.random.default_rng(6), block(40)
    model, elapsed = BackgroundModel(PERIOD), every * PERIOD
    known = next(k * elapsed for k in range(100) if model.step(image(rng), NOBODY, elapsed)[1].mean() < 0.01)
    assert known == pytest.approx(STABLE, abs=2 * elapsed)
    absorbed = next(k * elapsed for k in range(500) if model.step(image(rng, thing), NOBODY, elapsed)[0][thing].mean() < 0.1)
    assert 0.3 * ABSORB_OBJECT < absorbed < 3 * ABSORB_OBJECT
