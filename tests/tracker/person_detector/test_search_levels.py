"""Where people are searched: every body that stands before a panorama is whole in a level that is for its height, and fine levels stay narrow."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.person_detector.blob_network import BLOB, HEIGHT, picture_with, write_blob_network
from tracker.geometry import Pose
from tracker.geometry.cameras import Cylinder, Panorama
from tracker.geometry.ground import Flat, Grid
from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.found_boxes import FoundBoxes
from tracker.person_detector.network import MULTIPLE
from tracker.person_detector.search_levels import TILT, CameraHeight, SearchLevel, search_levels

GRAVEL = Grid(np.random.default_rng(1).uniform(0, 1.2, (40, 40)), np.array([-40.0, -40.0]), 2.0)


def above(height: float, ground: Flat | Grid, moves: bool = True) -> CameraHeight:
    at = float(ground.height_at(np.zeros((1, 2)))[0])
    found = CameraHeight.of(Pose(np.eye(3), np.array([0.0, 0.0, at + height])), ground, moves)
    assert found is not None
    return found


def searched(level: SearchLevel, width: int) -> int:
    """Pixels of the network's input, without the seam."""
    rows = -(-(level.rows[1] - level.rows[0]) // 2**level.halvings)
    return (width >> level.halvings) * -(-rows // MULTIPLE) * MULTIPLE


@pytest.mark.parametrize("width", [512, 1024, 2048, 4096, 5760])
@pytest.mark.parametrize("height", [0.6, 1.5, 4.0])
def test_every_body_is_whole_in_a_level_for_its_height(width: int, height: int) -> None:
    rng, camera, n = np.random.default_rng(0), Panorama(width, width // 2), 4000
    for ground in (Flat(), GRAVEL):
        levels = search_levels((camera.height, width), camera, above(height, ground))
        distance, stature, tilt = np.exp(rng.uniform(np.log(0.8), np.log(60), n)), rng.uniform(1.5, 2.0, n), rng.uniform(-TILT, TILT, n)
        lift = 0.0 if isinstance(ground, Flat) else rng.uniform(-0.9, 0.9, n)
        foot, head = (np.clip(np.arctan2(z - height + lift, distance) + tilt, -1.5, 1.5) for z in (0.0, stature))
        top, bottom = (camera.rows_from_elevations(e) for e in (head, foot))
        found = np.zeros(n, dtype=bool)
        for level in levels:
            of_height = (bottom - top >= level.heights[0]) & (bottom - top < level.heights[1])
            row = np.arange(float(n))
            boxes = FoundBoxes(np.stack([row, top, np.ones(n), bottom - top], axis=1), np.ones(n))
            kept = np.isin(row, level.in_band(boxes, camera.height).box[:, 0])
            found |= of_height & (top >= level.rows[0]) & (bottom <= level.rows[1]) & kept
        assert found[foot > -1.1].mean() > 0.98
        assert found[distance > max(3.0, height)].all()


@pytest.mark.parametrize("width", [1024, 2048, 5760])
def test_people_at_a_table_are_whole_at_the_coarsest_level(width: int) -> None:
    """Feet of people who sit before a camera are half a meter nearer than their heads."""
    camera = Panorama(width, width // 2)
    coarsest = search_levels((camera.height, width), camera, above(1.0, Flat(), moves=False))[-1]
    distance = np.linspace(0.5, 2.0, 50)
    top, bottom = (camera.rows_from_elevations(np.arctan2(z, d)) for z, d in ((0.25, distance), (-1.0, distance - 0.4)))
    boxes = FoundBoxes(np.stack([distance, top, np.ones(50), bottom - top], axis=1), np.ones(50))
    assert len(coarsest.in_band(boxes, camera.height)) == 50


def test_costs_grow_with_the_band_and_not_with_the_sphere() -> None:
    cost = {w: sum(searched(one, w) for one in search_levels((w // 2, w), Panorama(w, w // 2), above(1.5, Flat()))) for w in (1024, 2048, 4096)}
    # With the sphere they would grow by 4 and 16.
    assert cost[2048] < 2.4 * cost[1024]
    assert cost[4096] < 5.3 * cost[1024]
    wide, narrow = (search_levels((1024, 2048), Panorama(2048, 1024), above(1.5, of))[0].rows for of in (GRAVEL, Flat()))
    assert wide[1] - wide[0] > narrow[1] - narrow[0]


def test_images_without_a_panoramic_camera_are_searched_whole() -> None:
    for rows in (1, 100, 576, 1080, 2160):
        levels = search_levels((rows, rows))
        assert {level.rows for level in levels} == {(0, rows)}
        assert levels[0].heights[0] == 0
        assert math.isinf(levels[-1].heights[1])
        assert all(a.heights[1] > b.heights[0] for a, b in pairwise(levels))


def test_odd_cameras_are_searched() -> None:
    assert CameraHeight.of(Pose(np.eye(3), np.array([0.0, 0.0, -1.0])), Flat(), False) is None
    upward = Cylinder(1024, 200, 900.0, 160.0)
    for levels in (search_levels((200, 1024), upward, above(1.5, Flat())), search_levels((16, 32), Panorama(32, 16))):
        assert all(0 <= level.rows[0] < level.rows[1] for level in levels)
    sideways = CameraHeight.of(Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.0, 0, 2])), Flat(), False)
    assert search_levels((1024, 2048), Panorama(2048, 1024), sideways)[-1].rows == (0, 1024)


def test_a_wide_panorama_has_its_people_with_and_without_a_camera(tmp_path: Path) -> None:
    """Bodies about the horizon are found at their own size, and one far above, where nobody can stand, is not searched there."""
    detector, camera = PersonDetector(write_blob_network(tmp_path / "m.onnx")), Panorama(2048, 1024)
    image = picture_with((1024, 2048), [(602.0, 546.0), (2.0, 538.0), (1302.0, 142.0)], BLOB)
    place = CameraPlace(camera, above=above(1.5, Flat()))
    for found in (detector.find(image, place), detector.find(image, wraps=True)):
        own = found.box[np.abs(found.box[:, 3] - HEIGHT) < 1]
        assert sorted(np.round(own[:, 0] + own[:, 2] / 2).astype(int) % 2048) == [2, 602]
