"""Recorded sequences for export: pixel boxes of detections, and checks of images."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker import sequences
from tracker.detections.boxes import boxes_of_detections, detections_from_boxes
from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.geometry import bearing_from_angles
from tracker.geometry.cameras import Panorama, Tsai, pinhole
from tracker.types import Detections

BENT = Tsai(768, 576, 5.5549, 5.1113e-3, 324.22, 282.57, 1.0938, 5.1273e-3, 4.65e-3)
share = st.floats(0.05, 0.95)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([pinhole(640, 480, 1.2), pinhole(320, 240, 2.0)]), share, share, st.floats(0.01, 0.3), st.floats(0.02, 0.6))
def test_pixel_boxes_round_trip(camera: Tsai, u: float, v: float, width: float, height: float) -> None:
    box = np.array([[u * camera.width, v * camera.height, width * camera.width, height * camera.height]])
    box[0, :2] -= box[0, 2:] / 2
    found = detections_from_boxes(camera, box, np.ones(1))
    assert_allclose(boxes_of_detections(camera, found) - [0.5, 0.5, 0, 0], box, atol=1e-6)


def test_distorted_image_keeps_the_middle_of_the_lower_edge() -> None:
    """Distorted columns are no meridians: what comes back has the foot to a tenth of a pixel or two and about the size."""
    box = np.array([[400.0, 250, 30, 80], [60, 300, 25, 70]])
    back = boxes_of_detections(BENT, detections_from_boxes(BENT, box, np.ones(2))) - [0.5, 0.5, 0, 0]
    assert_allclose(back[:, 1] + back[:, 3], box[:, 1] + box[:, 3], atol=0.2)
    assert_allclose(back[:, 0] + back[:, 2] / 2, box[:, 0] + box[:, 2] / 2, atol=0.2)
    assert_allclose(back, box, atol=2)


@settings(max_examples=100, deadline=None)
@given(st.floats(-3.14, 3.14), st.floats(-1, 1), st.floats(0.01, 1), st.floats(0.01, 0.5))
def test_a_panorama_box_begins_in_the_image(azimuth: float, elevation: float, span: float, rise: float) -> None:
    camera = Panorama(512, 256)
    found = Detections(
        bearing_from_angles(np.array([azimuth]), np.array([elevation])),
        np.array([[span, rise]]),
        np.ones(1),
        np.eye(2)[None],
        np.zeros((1, 0)),
    )
    ((left, top, width, height),) = boxes_of_detections(camera, found)
    assert 0 <= left < 512
    middle = camera.bearings_from_pixels(np.array([[left + width / 2, top + height / 2]]))
    assert_allclose(middle, found.bearing, atol=1e-9)
    assert (width / 512 * 2 * np.pi, height / 256 * np.pi) == pytest.approx((span, rise))


def test_no_detections_give_no_boxes() -> None:
    assert boxes_of_detections(pinhole(320, 240, 1.0), Detections.none()).shape == (0, 4)
    assert_array_equal(ltwh_from_edges(np.array([[1.0, 2, 4, 8]])), [[1, 2, 3, 6]])


def test_detections_and_instances_equal_the_sequence(tmp_path: Path) -> None:
    ticks = sequences.write(tmp_path / "s")
    recording = RecordedSequence.open(tmp_path / "s")
    assert recording.rate == 6
    assert recording.fixed == {}
    for tick in ticks:
        for view in tick.views:
            found = recording.detections[tick.index, view.camera]
            for name in ("bearing", "extent", "confidence", "covariance"):
                assert_allclose(getattr(found, name), getattr(view.detections, name), atol=1e-8)


def test_images_are_copied_or_encoded_again(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    recording = RecordedSequence.open(tmp_path / "s")
    data = (tmp_path / "s" / "images" / "robot_1_camera" / "000002.jpg").read_bytes()
    assert recording.image(2, "robot_1_camera") == data
    again = cv2.imdecode(np.frombuffer(recording.image(2, "robot_1_camera", ".png"), np.uint8), cv2.IMREAD_COLOR)
    assert_array_equal(again, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    assert (recording.instances(0, "robot_0_camera") == 4).all()
    with pytest.raises(ValueError, match=r"images/robot_1_camera/000009: the manifest does not name it, neither \.jpg nor \.png"):
        recording.image(9, "robot_1_camera")


def test_changed_instances_are_found(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    recording = RecordedSequence.open(tmp_path / "s")
    path = tmp_path / "s" / "instances" / "robot_0_camera" / "000001.png"
    path.write_bytes(cv2.imencode(".png", np.full((32, 64), 9, np.uint16))[1].tobytes())
    with pytest.raises(ValueError, match=r"000001\.png: its SHA-256"):
        recording.instances(1, "robot_0_camera")
