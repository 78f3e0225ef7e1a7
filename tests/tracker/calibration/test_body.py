"""Boxes of bodies and their places are inverse of each other, for all camera models."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.calibration.body import HEIGHT, PITCH, ROLL, YAW, X, Y, angles_of, boxes_of, ground_places, pose_of
from tracker.geometry.cameras import Camera, Panorama, Pinhole
from tracker.geometry.image_boxes import body_outlines

BODY = np.array([0.25, 0.25])


def row_of(pitch: float, roll: float, yaw: float) -> np.ndarray:
    row = np.zeros(11)
    row[[PITCH, ROLL, YAW, X, Y, HEIGHT]] = pitch, roll, yaw, 1.0, -2.0, np.log(3.0)
    return row


@pytest.mark.parametrize("camera", [Pinhole(1280, 720, 800.0, 800.0, 639.5, 359.5), Panorama(1024, 512)])
def test_places_of_boxes_are_those_of_the_people(camera: Camera) -> None:
    row = row_of(*((0.0, 0.0, 0.4) if camera.wraps else (0.35, 0.03, 0.4)))
    rng = np.random.default_rng(0)
    turn, away = 0.4 + rng.uniform(-0.4, 0.4, 50), rng.uniform(4.0, 15.0, 50)
    place = np.array([1.0, -2.0]) + away[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    box = boxes_of(camera, row, place, np.full(50, 1.7), BODY)
    assert np.abs(ground_places(camera, row, box, float(BODY[0])) - place).max() < 0.12


def test_boxes_are_those_of_cylinders() -> None:
    camera = Pinhole(1280, 720, 800.0, 800.0, 639.5, 359.5)
    row = row_of(0.35, 0.0, 0.0)
    place = np.array([[6.0, -2.0], [9.0, 0.0], [7.0, -4.0]])
    box = boxes_of(camera, row, place, np.full(3, 1.75), BODY)
    _, low, high = body_outlines(camera, pose_of(row), np.column_stack([place, np.zeros(3)]), (1.75, 0.5))
    assert np.abs(box - np.column_stack([(low[:, 0] + high[:, 0]) / 2, low[:, 1], high[:, 1]])).max() < 1.0


def test_angles_are_those_of_the_rotation() -> None:
    row = row_of(0.3, -0.1, 2.5)
    assert np.allclose(angles_of(pose_of(row).rotation), [0.3, -0.1, 2.5])
