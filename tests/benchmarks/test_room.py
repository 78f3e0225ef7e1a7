"""The synthetic room: people keep within its walls and apart, boxes are those of the truth, and the seed decides all."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.room import CAMERA_HEIGHT, FALSE_BOXES, NOISE, RADIUS, RATE, SIZE, SPACING, hidden_share, room
from tracker.geometry.image_boxes import body_boxes
from tracker.recordings import Recording

FRAMES = 60


@pytest.fixture(scope="module")
def recording() -> Recording:
    return room(0, frames=FRAMES)


def places(recording: Recording) -> np.ndarray:
    assert recording.truth is not None
    return np.array([recording.truth[k][1] for k in range(recording.frames)])


def test_people_keep_inside_and_apart(recording: Recording) -> None:
    feet = places(recording)
    assert feet.shape == (FRAMES, 15, 3)
    assert (feet[:, :, :2] >= RADIUS).all()
    assert (feet[:, :, :2] <= np.array(SIZE) - RADIUS).all()
    distance = np.linalg.norm(feet[:, :, None] - feet[:, None], axis=3) + 10 * np.eye(15)
    assert distance.min() >= SPACING - 1e-3
    # Groups: some people stand nearer to one another than bodies that are set at random.
    assert distance.min(axis=(1, 2)).mean() < 2 * RADIUS + 0.1


def test_people_walk_and_stand(recording: Recording) -> None:
    speed = RATE * np.linalg.norm(np.diff(places(recording), axis=0), axis=2)
    assert speed.max() < 2.0
    assert 0.1 < (speed < 0.1).mean() < 0.7
    assert (speed.max(axis=0) > 0.3).all()


def test_the_seed_decides_every_byte(recording: Recording) -> None:
    again, other = room(0, frames=FRAMES), room(1, frames=FRAMES)
    assert places(again).tobytes() == places(recording).tobytes() != places(other).tobytes()
    for name, boxes in recording.detections.items():
        assert [[a.tobytes() for a in boxes[k]] for k in range(FRAMES)] == [[a.tobytes() for a in again.detections[name][k]] for k in range(FRAMES)]


def test_as_many_boxes_as_expected(recording: Recording) -> None:
    """Those of bodies in the image, but for the share of misses and for those that others hide, and a few false ones."""
    feet = places(recording)
    for name, camera in recording.cameras.items():
        shown = sum(len(body_boxes(camera.camera, camera.pose, now, (1.7, 2 * RADIUS))) for now in feet)
        boxes = sum(len(box) for box, _ in recording.detections[name].values())
        assert 0.35 * shown < boxes < 0.8 * (1 - NOISE.misses) * shown + 3 * FALSE_BOXES * FRAMES


def test_cameras_look_down_into_the_room(recording: Recording) -> None:
    middle = np.array([*(np.array(SIZE) / 2), 0.0])
    for camera in recording.cameras.values():
        assert camera.pose.translation[2] == CAMERA_HEIGHT
        ray = camera.pose.inverse().apply(middle[None])
        pixel, inside = camera.camera.pixels_from_bearings(ray / np.linalg.norm(ray))
        assert inside.all()
        assert abs(pixel[0, 0] - 959.5) < 1e-6


def test_hidden_share() -> None:
    box = np.array([0.0, 0.0, 8.0, 16.0])
    assert hidden_share(box, np.zeros((0, 4))) == 0
    assert hidden_share(box, np.array([[0.0, 0.0, 4.0, 16.0], [2.0, 0.0, 2.0, 8.0]])) == 0.5
    assert hidden_share(box, np.array([[-1.0, -1.0, 10.0, 18.0]])) == 1


def test_confidences_are_those_of_a_detector(recording: Recording) -> None:
    confidence = np.concatenate([c for boxes in recording.detections.values() for _, c in boxes.values()])
    assert 0.3 <= confidence.min() < 0.7
    assert confidence.max() <= 0.99
    assert 0.8 < np.median(confidence) < 0.92
