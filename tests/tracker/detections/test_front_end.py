"""The front end: silhouettes are a view of their own, and images help to track people whom a detector misses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.street import NAME, PERIOD, Street
from tracker.datasets import synthetic_crowd
from tracker.detections.front_end import SILHOUETTES, FrontEnd, ImageParameters
from tracker.geometry import Array
from tracker.metrics.clear_mot import TargetScore, score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, Tracker, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Tick

IMAGES = ImageParameters(silhouettes=True, appearance=True)
WITH_IMAGES = Parameters(images=IMAGES)
EMPTY = 15


def walk(ticks: int) -> Array:
    """(ticks, 2, 2) m: two people who pass each other."""
    t = np.arange(ticks)[:, None] * PERIOD
    return np.stack([np.hstack([0 * t - 2.0, 1.0 * t - 3.5]), np.hstack([0 * t + 1.0, 3.0 - 0.9 * t])], axis=1)


def scene(found: float, ticks: int = 50, where: Street | None = None) -> tuple[Street, Array, list[Tick]]:
    """The street, empty at first, then with two people; found: detection rate of the detector."""
    where, walked, rng = where or Street(), walk(ticks), np.random.default_rng(2)
    empty = [where.tick(k, walked[0, :0], np.zeros(0, dtype=bool)) for k in range(EMPTY)]
    return where, walked, empty + [where.tick(EMPTY + k, people, rng.random(2) < found) for k, people in enumerate(walked)]


def scored(where: Street, walked: Array, ticks: list[Tick], parameters: Parameters) -> TargetScore:
    estimates = list(track(where.setup, ticks, parameters))
    return score([MatchingFrame(np.arange(2), people, e.target_id, e.position) for people, e in zip(walked, estimates[EMPTY:], strict=True)])


def test_silhouettes_are_a_view_of_their_own_from_the_same_place() -> None:
    where, _, ticks = scene(0.0, 20)
    front_end = FrontEnd(where.setup, MhtParameters().fusion, IMAGES)
    assert set(front_end.setup.mounts) == {NAME, NAME + SILHOUETTES}
    placed = {NAME: (front_end.setup.starts[NAME].T_world_robot, np.zeros((6, 6)))}
    for tick in ticks:
        feet, views = front_end.step(tick, placed)
    assert [f.camera for f in feet] == [v.name for v in views] == [NAME, NAME + SILHOUETTES]
    assert len(feet[0]) == 0
    assert len(feet[1]) == 2
    assert np.isfinite(feet[1].appearance).all()
    assert front_end.step(tick, {}) == ([], [])


@pytest.mark.parametrize("appearance", [False, True])
def test_people_are_tracked_whom_the_detector_misses_mostly(appearance: bool) -> None:
    with_images = Parameters(images=replace(IMAGES, appearance=appearance))
    where, walked, ticks = scene(0.3)
    seen = scored(where, walked, ticks, with_images)
    assert seen.mota > 0.85
    assert seen.switches == 0
    if appearance:
        assert seen.mota > scored(where, walked, ticks, replace(with_images, images=ImageParameters())).mota + 0.1


def test_images_may_be_missing() -> None:
    where, walked, ticks = scene(0.9)
    blind = [replace(t, views=(replace(t.views[0], image=None),)) if 20 <= t.index < 35 else t for t in ticks]
    result = scored(where, walked, blind, WITH_IMAGES)
    assert result.mota > 0.85
    assert result.switches == 0


def test_estimates_depend_on_past_images_alone() -> None:
    where, _, ticks = scene(0.5, 25)
    whole = list(track(where.setup, ticks, WITH_IMAGES))
    for a, b in zip(whole, track(where.setup, ticks[:25], WITH_IMAGES), strict=False):
        np.testing.assert_array_equal(a.target_id, b.target_id)
        np.testing.assert_array_equal(a.position, b.position)


def test_a_moving_robot_has_no_silhouettes() -> None:
    where = Street()
    start = replace(where.setup.starts[NAME], covariance=1e-4 * np.eye(6))
    front_end = FrontEnd(replace(where.setup, starts={NAME: start}), MhtParameters().fusion, IMAGES)
    assert set(front_end.setup.mounts) == {NAME}


def test_without_images_nothing_changes() -> None:
    rng = np.random.default_rng(5)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(4, 15, rng)
    tracker, plain = Tracker(setup, WITH_IMAGES), Tracker(setup, replace(WITH_IMAGES, images=ImageParameters()))
    for tick in synthetic_crowd.ticks(setup, walked, rng):
        a, b = tracker.step(tick), plain.step(tick)
        assert a is not None
        assert b is not None
        np.testing.assert_array_equal(a.position, b.position)
