"""People found in a folder of images and in a video, written as MOT15: the same run again, other runs, and bad images."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.person_detector.blob_network import HEIGHT, WIDTH, picture_with, write_blob_network
from tracker.io.mot15 import read_mot15
from tracker.io.video_files import VideoWriters
from tracker.person_detector.detection_run import DetectionRun, write_detections
from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.pictures import PictureFrame, frames_of_pictures, is_pictures, number_of_pictures

PLACES = [(30.0, 50.0), (46.0, 50.0), (62.0, 50.0)]


@pytest.fixture(scope="module")
def how(tmp_path_factory: pytest.TempPathFactory) -> DetectionRun:
    return DetectionRun(PersonDetector(write_blob_network(tmp_path_factory.mktemp("model") / "m.onnx")), pictures=True)


def test_images_and_a_video(tmp_path: Path, how: DetectionRun) -> None:
    images = tmp_path / "street"
    images.mkdir()
    writer = VideoWriters(tmp_path / "videos", 10.0)
    for k, place in enumerate(PLACES):
        image = picture_with((112, 128), [place])
        cv2.imwrite(str(images / f"{k:03d}.png"), image)
        writer.put("C1", image)
    writer.finish()
    for source, camera, off in ((images, "street", 0.01), (tmp_path / "videos" / "C1.mp4", "C1", 4.0)):
        assert is_pictures(source)
        assert number_of_pictures(source) == 3
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
    image = picture_with((112, 128), [PLACES[0]])
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
    with pytest.raises(ValueError, match=r"a\.jpg: is no image that is read \(\.jpg"):
        write_detections(frames_of_pictures(source), None, out, {}, how)
    _, data = cv2.imencode(".png", np.zeros((1, 1), np.uint8))
    huge = bytearray(data.tobytes())
    huge[16:24] = (9_000).to_bytes(4, "big") + (5_000).to_bytes(4, "big")
    huge[29:33] = zlib.crc32(bytes(huge[12:29])).to_bytes(4, "big")
    (source / "a.jpg").write_bytes(huge)
    with pytest.raises(ValueError, match="is 9000 x 5000 px, needs at most 33554432 px"):
        write_detections(frames_of_pictures(source), None, out, {}, how)
    assert not any(out.glob("*.txt"))


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_an_interrupted_search_goes_on(tmp_path: Path, how: DetectionRun) -> None:
    """A resumed search has the same bytes. It takes boxes of the journal, but for an image that has changed."""
    how = DetectionRun(how.detector, pictures=True, video=True)
    image = [picture_with((112, 132), [place]) for place in PLACES]
    frames = [PictureFrame(k, "C1", one, CameraPlace(), 25.0) for k, one in enumerate(image)]
    whole = write_detections(frames, 3, tmp_path / "whole", {}, how)

    def cut() -> Iterator[PictureFrame]:
        yield from frames[:2]
        raise KeyboardInterrupt

    for name in ("out", "other"):
        with pytest.raises(KeyboardInterrupt):
            write_detections(cut(), 3, tmp_path / name, {}, how)
        assert not list((tmp_path / name).glob("*.txt"))
    journal = tmp_path / "out" / ".partial" / ".found.jsonl"
    journal.write_text(journal.read_text() + '{"camera": "C1", "fra')
    assert write_detections(frames, 3, tmp_path / "out", {}, how) == whole
    assert files_in(tmp_path / "out") == files_in(tmp_path / "whole")
    video = cv2.VideoCapture(str(tmp_path / "out" / "videos" / "C1.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert video.get(cv2.CAP_PROP_FPS) == 25
    assert video.read()[1].shape == (112, 132, 3)
    # Boxes that no search finds: those of the second image are kept, and the first image is another one now.
    journal = tmp_path / "other" / ".partial" / ".found.jsonl"
    journal.write_text(re.sub(r'"probability": \[[^]]*\]', '"probability": [0.125]', journal.read_text()))
    write_detections([PictureFrame(0, "C1", image[2], CameraPlace(), 25.0), *frames[1:]], 3, tmp_path / "other", {}, how)
    assert (read_mot15(tmp_path / "other" / "C1.txt").confidence == 0.125).tolist() == [False, True, False]


def test_images_of_two_sizes_are_no_video(tmp_path: Path, how: DetectionRun) -> None:
    frames = [PictureFrame(k, "C1", picture_with((112, 128 + 2 * k), [PLACES[0]]), CameraPlace()) for k in range(2)]
    assert write_detections(frames, 2, tmp_path / "out", {}, how)["found"]["C1"]["frames"] == 2
    with pytest.raises(ValueError, match="C1: has images of 128 x 112 and 130 x 112 px, --video needs one size"):
        write_detections(frames, 2, tmp_path / "video", {}, DetectionRun(how.detector, video=True))
    assert not (tmp_path / "video").exists()


def noise_video(path: Path, size: tuple[int, int], codec: str) -> bytes:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 25.0, size[::-1])
    for _ in range(20):
        writer.write(np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8))
    writer.release()
    return path.read_bytes()


def test_videos_that_end_early_and_whose_frames_change_size(tmp_path: Path) -> None:
    """MPEG-1 streams may follow each other in one file; OpenCV scales the second to the size of the first."""
    cut, mixed = tmp_path / "cut.avi", tmp_path / "mixed.mpg"
    whole = noise_video(cut, (112, 128), "MJPG")
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"cut\.avi: ends after [1-9]\d* of the 20 frames that it names"):
        number_of_pictures(cut)
    mixed.write_bytes(noise_video(tmp_path / "a.mpg", (112, 128), "MPG1") + noise_video(tmp_path / "b.mpg", (48, 64), "MPG1"))
    frames = list(frames_of_pictures(mixed))
    assert len(frames) > 30
    assert {frame.image.shape for frame in frames} == {(112, 128, 3)}
