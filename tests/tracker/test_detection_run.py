"""People found in a folder of images and in a video, written as MOT15: the same run again, other runs, and bad images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.person_detector.blob_network import HEIGHT, WIDTH, picture_with, write_blob_network
from tracker.detection_run import DetectionRun, frames_of_pictures, is_pictures, write_detections
from tracker.formats.motchallenge import read_mot15
from tracker.io.video_files import VideoWriters
from tracker.person_detector.detector import PersonDetector

PLACES = [(30.0, 50.0), (46.0, 50.0), (62.0, 50.0)]


@pytest.fixture(scope="module")
def how(tmp_path_factory: pytest.TempPathFactory) -> DetectionRun:
    return DetectionRun(PersonDetector(write_blob_network(tmp_path_factory.mktemp("model") / "m.onnx")), pictures=True)


def test_images_and_a_video(tmp_path: Path, how: DetectionRun) -> None:
    images = tmp_path / "street"
    images.mkdir()
    writer = VideoWriters(tmp_path / "videos", 10.0)
    for k, place in enumerate(PLACES):
        image = picture_with((96, 128), [place])
        cv2.imwrite(str(images / f"{k:03d}.png"), image)
        writer.put("C1", image)
    writer.finish()
    for source, camera, off in ((images, "street", 0.01), (tmp_path / "videos" / "C1.mp4", "C1", 4.0)):
        assert is_pictures(source)
        out = tmp_path / f"out-{camera}"
        statement = write_detections(frames_of_pictures(source), None, out, {"source": camera}, how)
        assert statement["found"] == {camera: {"frames": 3, "boxes": 3}}
        rows = read_mot15(out / f"{camera}.txt")
        assert rows.frame.tolist() == [1, 2, 3]
        np.testing.assert_allclose(rows.box, [[u - WIDTH / 2, v - HEIGHT / 2, WIDTH, HEIGHT] for u, v in PLACES], atol=off)
        assert len(list((out / "pictures" / camera).iterdir())) == 3
        before = (out / f"{camera}.txt").stat().st_mtime_ns
        assert write_detections(frames_of_pictures(source), None, out, {"source": camera}, how) == statement
        assert (out / f"{camera}.txt").stat().st_mtime_ns == before
        with pytest.raises(ValueError, match="holds another run"):
            write_detections(frames_of_pictures(source), None, out, {"source": "other"}, how)


def test_grey_alpha_and_16_bit_files(tmp_path: Path, how: DetectionRun) -> None:
    image = picture_with((96, 128), [PLACES[0]])
    grey = image[:, :, 0]
    kinds = {"grey": grey, "alpha": np.dstack([image, grey]), "deep": image.astype(np.uint16) * 257}
    for name, content in kinds.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), content)
    for frame in frames_of_pictures(tmp_path):
        np.testing.assert_array_equal(frame.image, image)


def test_bad_images_are_one_line_and_leave_no_folder(tmp_path: Path, how: DetectionRun) -> None:
    source, out = tmp_path / "s", tmp_path / "out"
    source.mkdir()
    (source / "a.jpg").write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"a\.jpg: is no PNG or JPEG"):
        write_detections(frames_of_pictures(source), None, out, {}, how)
    _, data = cv2.imencode(".png", np.zeros((1, 1), np.uint8))
    huge = bytearray(data.tobytes())
    huge[16:24] = (30_000).to_bytes(4, "big") + (15_000).to_bytes(4, "big")
    (source / "a.jpg").write_bytes(huge)
    with pytest.raises(ValueError, match="30000 x 15000"):
        write_detections(frames_of_pictures(source), None, out, {}, how)
    assert not any(out.glob("*.txt"))
