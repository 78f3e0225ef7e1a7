"""Recorded sequences for export: pixel boxes of detections, and checks of images."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker import sequences
from tracker.formats.exported_sequence import RecordedSequence


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
    with pytest.raises(ValueError, match=r"images/robot_1_camera/000009\.jpg: the manifest does not name it, nor a \.png"):
        recording.image(9, "robot_1_camera")
