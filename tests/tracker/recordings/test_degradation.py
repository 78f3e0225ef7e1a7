"""Degraded detections: amount, reproducibility, and plausible false boxes."""

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.geometry.cameras import pinhole
from tracker.geometry.ground import Flat
from tracker.recordings.degradation import HEIGHTS, Boxes, Degradation

FRAMES = 400
AREA = np.array([[3.0, -2.0], [9.0, 2.0]])
VIEW = (pinhole(640, 480, np.radians(90)), Pose.planar(0.0, 0.0, 0.0, 1.5))


def boxes() -> Boxes:
    rng = np.random.default_rng(0)
    return {k: (rng.uniform(20, 200, (5, 4)), rng.uniform(0.6, 1, 5)) for k in range(FRAMES)}


def worse(degradation: Degradation, seed: int = 1) -> Boxes:
    return degradation.apply(boxes(), FRAMES, VIEW, (AREA, Flat()), np.random.default_rng(seed))


def test_default_changes_nothing() -> None:
    for (a, c), (b, d) in zip(boxes().values(), worse(Degradation()).values(), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(c, d)


def test_boxes_are_dropped_and_moved() -> None:
    kept = sum(len(b) for b, _ in worse(Degradation(drop=0.3)).values())
    assert abs(kept / (5 * FRAMES) - 0.7) < 4 * np.sqrt(0.21 / (5 * FRAMES))
    moved = np.concatenate([b - a for (a, _), (b, _) in zip(boxes().values(), worse(Degradation(noise=3.0)).values(), strict=True)])
    assert np.all(moved[:, 2:] == 0)
    np.testing.assert_allclose(moved[:, :2].std(axis=0), 3.0, rtol=0.08)


def test_false_boxes_have_feet_in_the_area() -> None:
    camera, pose = VIEW
    for box, confidence in worse(Degradation(drop=1.0, clutter=2)).values():
        assert len(box) == len(confidence) == 2
        foot = np.stack([box[:, 0] + box[:, 2] / 2, box[:, 1] + box[:, 3]], axis=1)
        sight = camera.bearings_from_pixels(foot) @ pose.rotation.T
        point, hit = Flat().intersect(np.tile(pose.translation, (2, 1)), sight, 50.0)
        assert hit.all()
        assert np.all((point[:, :2] > AREA[0] - 1e-6) & (point[:, :2] < AREA[1] + 1e-6))
        head = camera.bearings_from_pixels(np.stack([foot[:, 0], box[:, 1]], axis=1)) @ pose.rotation.T
        height = pose.translation[2] + np.hypot(*point[:, :2].T) * head[:, 2] / np.hypot(head[:, 0], head[:, 1])
        assert np.all((height > HEIGHTS[0] - 1e-6) & (height < HEIGHTS[1] + 1e-6))
        assert np.all(confidence >= 0.6)


def test_same_seed_gives_same_boxes() -> None:
    asked = Degradation(0.2, 1, 1.0)
    same = zip(worse(asked).values(), worse(asked).values(), strict=True)
    assert all(np.array_equal(a, b) for (a, _), (b, _) in same)
    assert not all(np.array_equal(a, b) for (a, _), (b, _) in zip(worse(asked).values(), worse(asked, 2).values(), strict=True))


def test_round_trip() -> None:
    assert Degradation.parse("drop=0.3, clutter=2") == Degradation(0.3, 2)
    assert Degradation.parse("") == Degradation()
    for text, message in (("drop=x", "needs a number"), ("clutter=1.5", "whole number"), ("fog=1", "needs drop=…"), ("drop=2", "drop is 2.0")):
        with pytest.raises(ValueError, match=message):
            Degradation.parse(text)
