"""Appearance vectors: people in the same clothes are similar, at any size and place of the box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import detections_from_boxes
from tracker.detections.front_end import SIZE, appearances
from tracker.geometry.cameras import Camera, Panorama, pinhole

RED, BLUE, GREEN, GREY = (200, 30, 40), (30, 50, 190), (40, 160, 60), (128, 128, 128)
Box = tuple[float, float, float, float]


def painted(camera: Camera, people: list[tuple[Box, tuple, tuple]], shrink: int = 1) -> NDArray[np.uint8]:
    """People of two colours, trunk and legs, before grey; those that come later are in front. An image that is smaller by `shrink`."""
    rng = np.random.default_rng(0)
    out = np.full((camera.height // shrink, camera.width // shrink, 3), GREY, dtype=np.int64)
    for (left, top, width, height), trunk, legs in people:
        columns = np.arange(round(left / shrink), round((left + width) / shrink)) % out.shape[1]
        waist, low = round((top + 0.5 * height) / shrink), round((top + height) / shrink)
        out[round(top / shrink) : waist, columns], out[waist:low, columns] = trunk, legs
    return np.clip(out + rng.normal(0, 4, out.shape), 0, 255).astype(np.uint8)


def vectors_of(camera: Camera, people: list[tuple[Box, tuple, tuple]], shrink: int = 1, **more: NDArray[np.bool_]) -> NDArray[np.float64]:
    found = detections_from_boxes(camera, np.array([box for box, *_ in people]), np.ones(len(people)))
    return appearances(painted(camera, people, shrink), camera, found, **more)


def test_people_in_the_same_clothes_are_similar() -> None:
    camera = pinhole(640, 480, 0.8)
    people = [((50, 100, 30, 80), RED, BLUE), ((300, 200, 40, 120), RED, BLUE), ((500, 150, 30, 90), BLUE, RED), ((150, 300, 30, 90), GREEN, GREY)]
    for shrink in (1, 2):
        vectors = vectors_of(camera, people, shrink)
        assert vectors.shape == (4, SIZE)
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1)
        similar = vectors @ vectors.T
        assert similar[0, 1] > 0.97
        assert similar[0, 2] < 0.75
        assert similar[0, 3] < 0.75


def test_a_box_over_the_seam_of_a_panorama_is_whole() -> None:
    vectors = vectors_of(Panorama(1024, 512), [((1010, 200, 28, 80), RED, BLUE), ((400, 200, 28, 80), RED, BLUE)])
    assert vectors[0] @ vectors[1] > 0.97


def test_pixels_of_nearer_people_are_left_out() -> None:
    camera = pinhole(640, 480, 0.8)
    alone, half = ((50.0, 100.0, 40.0, 100.0), RED, BLUE), ((300.0, 100.0, 40.0, 100.0), RED, BLUE)
    before, over = ((317.0, 110.0, 40.0, 100.0), GREEN, GREEN), ((300.0, 110.0, 40.0, 100.0), GREEN, GREEN)
    vectors = vectors_of(camera, [alone, half, before])
    assert vectors[0] @ vectors[1] > 0.95
    # The whole body is hidden, so that there is no appearance.
    assert np.isnan(vectors_of(camera, [half, over])[0]).all()


def test_background_pixels_are_left_out() -> None:
    camera = pinhole(640, 480, 0.8)
    people = [((50.0, 100.0, 60.0, 80.0), RED, BLUE)]
    image = painted(camera, people)
    wide = detections_from_boxes(camera, np.array([[50.0, 100.0, 60.0, 80.0], [20.0, 100.0, 120.0, 80.0]]), np.ones(2))
    foreground = np.zeros((120, 160), dtype=bool)
    foreground[25:45, 13:27] = True
    vectors = appearances(image, camera, wide, foreground)
    assert vectors[0] @ vectors[1] > 0.97
    assert np.isnan(appearances(image, camera, wide, np.zeros((120, 160), dtype=bool))).all()


def test_no_box_and_a_box_that_is_too_small() -> None:
    camera = pinhole(640, 480, 0.8)
    assert vectors_of(camera, []).shape == (0, SIZE)
    assert np.isnan(vectors_of(camera, [((50.0, 100.0, 2.0, 5.0), RED, BLUE)])).all()
