"""Occluded shares of bodies: against rays through many points of a body, and by hand where that is simple."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.detections.occlusion import BODY_HALF_WIDTH, BODY_HEIGHT, BOX_HALF_WIDTH, DEPTH_MARGIN, Bodies, Viewpoint, occluded_share
from tracker.geometry import Array, Pose, wrap
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Grid
from tracker.types import Setup

EYE = np.array([0.0, 0.0, 4.0])
NOBODY = np.zeros(0, dtype=np.int64)


def by_rays(place: Array, things: Array, count: int = 80) -> float:
    """Share of a body's box that upright rectangles (x, y, half the width, low, high), turned to the eye, lie over."""
    far = np.hypot(*(place[:2] - EYE[:2]))
    azimuth = np.arctan2(place[1] - EYE[1], place[0] - EYE[0])
    half = np.arctan2(BOX_HALF_WIDTH, far)
    across, up = np.meshgrid(np.linspace(-half, half, count), np.linspace(place[2], place[2] + BODY_HEIGHT, count))
    slope = (up - EYE[2]) / far
    hidden = np.zeros(across.shape, dtype=bool)
    for x, y, wide, low, high in things:
        near = np.hypot(x - EYE[0], y - EYE[1])
        if near > far - DEPTH_MARGIN:
            continue
        beside = np.abs(wrap(azimuth + across - np.arctan2(y - EYE[1], x - EYE[0])))
        z = EYE[2] + slope * near
        hidden |= (beside < np.arctan2(wide, near)) & (z > low) & (z < high)
    return float(hidden.mean())


@pytest.mark.parametrize("way", [0.0, np.pi])
def test_a_post_covers_as_much_as_it_is_wide(way: float) -> None:
    """Also where azimuths go round."""
    at = np.array([np.cos(way), np.sin(way)])
    place, post = np.append(10 * at, 0.0)[None], np.array([[*(5 * at), 0.075, 0.0, 4.0]])
    share = occluded_share(EYE, place, np.ones(1, np.int64), NOBODY, post)
    assert share[0, 0] == pytest.approx(0.15 / BOX_HALF_WIDTH, abs=1 / 9)
    assert share[0, 1] == 0


def test_shares_of_objects_and_people_match_rays() -> None:
    rng = np.random.default_rng(0)
    for _ in range(60):
        place = np.column_stack([rng.uniform(6, 12, 4), rng.uniform(-1, 1, 4), np.zeros(4)])
        wide, low, high = rng.uniform(0.05, 0.4, 2), rng.uniform(0, 1, 2), rng.uniform(1.2, 4, 2)
        pillars = np.column_stack([rng.uniform(3, 11, 2), rng.uniform(-1, 1, 2), wide, low, high])
        share = occluded_share(EYE, place, np.arange(4), np.arange(4), pillars)
        for i in range(4):
            others = np.array([[*place[j, :2], BODY_HALF_WIDTH, 0.0, BODY_HEIGHT] for j in range(4) if j != i])
            assert share[i, 0] == pytest.approx(by_rays(place[i], pillars), abs=0.13)
            assert share[i, 1] == pytest.approx(by_rays(place[i], others), abs=0.13)


def test_nobody_occludes_themselves_or_nearer_people() -> None:
    place, same = np.array([[8.0, 0.0, 0.0], [6.0, 0.0, 0.0]]), np.ones(2, np.int64)
    assert not occluded_share(EYE, place, same, np.arange(2), np.zeros((0, 5))).any()
    share = occluded_share(EYE, place, np.arange(2), np.arange(2), np.zeros((0, 5)))
    assert share[0, 1] > 0.3
    assert not share[1].any()


@pytest.mark.parametrize("known", [False, True])
def test_nobody_is_expected_beyond_the_reach(known: bool) -> None:
    flat = Grid(np.zeros((9, 9)), np.array([-20.0, -20.0]), 5.0)
    setup = Setup({}, flat, {}, 0.2, occluders=flat if known else None)
    bodies = Bodies(np.array([[5.0, 0.0], [0.0, 14.0]]), np.arange(2), np.arange(2), setup, lambda camera, cover: np.ones(len(cover)))
    view = Viewpoint("robot", Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, 1.5])))
    near, far = bodies.expected_detection(view, 12.0)
    assert near > 0.5
    assert far == 0.0
    assert bodies.expected_detection(view, 60.0).min() > 0.5
