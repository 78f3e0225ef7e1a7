"""Frames that were not searched, and images that are not those of the boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracker.recordings.test_odd_pictures import video
from tests.tracker.recordings.walked_room import walked_room
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import track
from tracker.recordings import Recording
from tracker.recordings.calibration_check import suspicion
from tracker.recordings.clocks import CameraClock
from tracker.recordings.folder import read_recording, write_recording
from tracker.recordings.image_check import image_findings, silent_frames
from tracker.recordings.images import ImageFiles, VideoFile
from tracker.sequence.results import Results

LOST = {*range(10, 14), *range(30, 34)}


def lost() -> Recording:
    """A room whose recorder lost frames of all cameras."""
    room = walked_room(people=4, frames=50)
    return replace(room, detections={name: {f: b for f, b in boxes.items() if f not in LOST} for name, boxes in room.detections.items()})


def searched(recording: Recording) -> Recording:
    frames = frozenset(range(recording.frames)) - LOST
    return replace(recording, searched=dict.fromkeys(recording.cameras, frames))


def test_frames_without_boxes_in_any_camera_are_asked_for(tmp_path: Path) -> None:
    (finding,) = silent_frames(lost())
    assert "frames 11-14, 31-34 (8 of 50) have no boxes in any camera" in finding.words
    assert "have no boxes in any camera" in suspicion(lost())
    assert silent_frames(searched(lost())) == silent_frames(walked_room(people=4, frames=50)) == []
    write_recording(tmp_path, searched(lost()))
    again = read_recording(tmp_path)
    assert again.searched == searched(lost()).searched
    assert again.cut(5, 20).searched["C1"] == frozenset(range(15)) - {5, 6, 7, 8}
    ticks = list(again.sequence().ticks)
    assert [len(tick.views) for tick in ticks[9:15]] == [4, 0, 0, 0, 0, 4]


def test_people_are_kept_over_frames_that_were_not_searched() -> None:
    found = []
    for recording in (lost(), searched(lost())):
        sequence = recording.sequence()
        found.append(evaluate(sequence, Results.of(track(sequence.setup, sequence.ticks), run={}))["targets"]["idf1"])
    assert found[1] >= found[0] > 0.9


@pytest.mark.parametrize("given", [[[3]], [[0, 4]], [[5, 2]], {"C9": [[1, 2]]}, 7, [["1", 2]]])
def test_wrong_entries_are_one_line(tmp_path: Path, given: object) -> None:
    write_recording(tmp_path, walked_room(people=1, frames=2))
    file = tmp_path / "recording.json"
    file.write_text(file.read_text().replace('"height"', f'"searched": {str(given).replace(chr(39), chr(34))}, "height"', 1))
    with pytest.raises(ValueError, match=r"recording\.json: searched .*needs"):
        read_recording(tmp_path)


def test_images_of_another_size_and_missing_ones(tmp_path: Path) -> None:
    room = walked_room(people=2, frames=4)
    size = room.cameras["C1"].camera
    files = {}
    for frame in range(4):
        files[frame] = tmp_path / f"{frame + 1:06d}.jpg"
        cv2.imwrite(str(files[frame]), np.zeros((size.height, size.width, 3), np.uint8))
    assert image_findings(replace(room, images={"C1": ImageFiles(files)})) == []
    cv2.imwrite(str(files[0]), np.zeros((360, 640, 3), np.uint8))
    del files[2]
    other, missing = image_findings(replace(room, images={"C1": ImageFiles(files)}))
    assert (other.kind, missing.kind) == ("image-size", "images-missing")
    assert "is 640 x 360 px, and the calibration is of 1280 x 720 px" in other.words
    assert "1 of 4 frames with boxes have no image (3)" in missing.words


def test_a_camera_without_images_in_the_part_is_told() -> None:
    found = image_findings(replace(walked_room(people=2, frames=4), images={"C1": ImageFiles({})}))
    assert [one.kind for one in found] == ["images-missing"]
    assert "4 of 4 frames with boxes have no image (1-4)" in found[0].words


def test_a_video_of_the_rate_of_its_camera_is_right(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    room = walked_room(people=2, frames=12)
    source = VideoFile(video(tmp_path / "a.mkv", list(range(12))))
    assert image_findings(replace(room, images={"C1": source}, clocks={"C1": CameraClock(rate=30.0)})) == []
    assert image_findings(replace(room, images={"C1": source}, clocks={"C1": CameraClock(stamps={k: k / 30 for k in range(12)})})) == []
    assert not caplog.text
    image_findings(replace(room, images={"C1": source}, clocks={"C1": CameraClock(rate=15.0)}))
    assert "frames/s by its stamps, and camera C1 has 15; its frames" in caplog.text


def test_boxes_after_the_end_of_an_uneven_video_are_told(tmp_path: Path) -> None:
    write_recording(tmp_path, walked_room(people=2, frames=12))
    (tmp_path / "video").mkdir()
    video(tmp_path / "video" / "C1.mkv", [0, 8, 15, 30, 32, 38, 45, 52])
    recording = read_recording(tmp_path, strict=False)
    assert recording.clocks["C1"].time(11, recording.rate) == pytest.approx((52 + 4 * 7) / 30, abs=0.15)
    assert [one.kind for one in image_findings(recording)] == ["video-short"]


def test_videos_of_another_rate_and_number_of_frames(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    room = walked_room(people=2, frames=12)
    fast = image_findings(replace(room, images={"C1": VideoFile(video(tmp_path / "a.mkv", list(range(8))))}))
    assert [one.kind for one in fast] == ["video-short"]
    assert "has 8 frames, and there are boxes in frame 12" in fast[0].words
    assert "frames/s by its stamps, and the recording has 4" in caplog.text
    same = video(tmp_path / "b.mkv", [round(30 / 4 * k) for k in range(12)])
    caplog.clear()
    assert image_findings(replace(room, images={"C1": VideoFile(same)})) == []
    assert not caplog.text


@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_images_that_are_a_frame_off_are_told(tmp_path: Path, shift: int) -> None:
    room = walked_room(people=4, frames=32).choose(["C1"])
    files = {}
    for frame in range(32):
        image = np.full((720, 1280, 3), 90, np.uint8)
        for left, top, width, height in room.detections["C1"].get(frame + shift, (np.zeros((0, 4)), None))[0].astype(int).tolist():
            cv2.rectangle(image, (left, top), (left + width, top + height), (200, 180, 160), -1)
        files[frame] = tmp_path / f"{frame + 1:06d}.png"
        cv2.imwrite(str(files[frame]), image)
    found = image_findings(replace(room, images={"C1": ImageFiles(files)}))
    assert [one.kind for one in found] == ["images-shifted"] * (shift != 0)
    if shift:
        assert f"numbered 1 too {'low' if shift > 0 else 'high'}: image n fits the boxes of frame n {'+' if shift > 0 else '−'} 1" in found[0].words
