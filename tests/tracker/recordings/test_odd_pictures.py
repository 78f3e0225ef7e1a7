"""Images and videos as others have them: order, numbers, orientation, bytes behind the end, depths, kinds of files, and videos of any rate."""

from __future__ import annotations

import logging
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from tests.tracker.recordings.test_folder import small
from tracker.geometry import Image
from tracker.io import time_order
from tracker.io.image_files import PICTURES, decode_picture
from tracker.io.picture_folders import content_checksum, natural_key, numbered_files
from tracker.io.video_files import frame_times, number_of_frames
from tracker.person_detector.pictures import frames_of_pictures, number_of_pictures, pictures_checksum
from tracker.recordings.folder import read_recording, write_recording
from tracker.recordings.images import ImageFiles, VideoFile, image_sources

SIZE = (48, 80)


@pytest.fixture(autouse=True)
def nothing_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_order, "_SAID", set())


def grey(level: int) -> Image:
    """An image whose left upper corner is white, so that it has an upright."""
    image = np.full((*SIZE, 3), level, np.uint8)
    image[:16, :24] = 255
    return image


def write(folder: Path, names: list[str]) -> Path:
    """Image files of growing brightness, 10 and more."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        cv2.imwrite(str(folder / name), grey(10 + 10 * k))
    return folder


def levels(folder: Path) -> list[int]:
    return [round(float(one.image[-1, -1].mean()) / 10) for one in frames_of_pictures(folder)]


def test_names_are_in_natural_order_which_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "shot", [f"frame{k}.png" for k in range(1, 12)])
    (folder / ".frame0.png").write_bytes(b"of a file system")
    (folder / "notes.txt").write_text("x")
    with caplog.at_level(logging.WARNING):
        assert levels(folder) == list(range(1, 12))
        assert number_of_pictures(folder) == 11
    said = [record.getMessage() for record in caplog.records]
    assert sum("11 images in the order of their numbers, frame1.png to frame11.png" in line for line in said) == 1
    assert sum("notes.txt left out" in line for line in said) == 1
    assert sorted(["b2", "b10", "b1", "a3"], key=natural_key) == ["a3", "b1", "b2", "b10"]
    (folder / "frame4.png").unlink()
    levels(folder)
    assert "1 number between them missing" in caplog.text


@pytest.mark.parametrize(
    ("names", "frames", "word"),
    [
        (["000001.png", "000002.png", "000003.png"], [0, 1, 2], ""),
        (["000000.png", "000001.png", "000002.png"], [0, 1, 2], "numbered from 0, so 000000.png is frame 1"),
        (["000005.png", "000007.png"], [4, 6], ""),
        ([f"frame_{k:06d}.png" for k in (1, 2)], [0, 1], ""),
        ([f"{k}.png" for k in (1, 9, 10)], [0, 8, 9], "1.png to 10.png"),
        (["7.png", "cover.png"], [6], "cover.png left out"),
        (["1695132345.10.png", "1695132345.35.png", "1695132346.60.png"], [0, 1, 2], "names are times, taken as frames 1 to 3"),
        ([f"{k}.png" for k in (1695132345000, 1695132345100)], [0, 1], "names are times"),
        (["1700000000.png"], [0], "names are times"),
        (["20240101_120000.png"], [0], "names are times"),
        (["20240101_120000.png", "20240101_120005.png"], [0, 1], "names are times"),
        (["20240101_000007.png", "20240101_000060.png"], [6, 59], ""),
    ],
)
def test_numbers_of_a_recording(tmp_path: Path, caplog: pytest.LogCaptureFixture, names: list[str], frames: list[int], word: str) -> None:
    write(tmp_path / "images" / "C1", names)
    with caplog.at_level(logging.WARNING):
        source = image_sources(tmp_path, ["C1", "C2"])["C1"]
    assert isinstance(source, ImageFiles)
    assert list(source.files) == frames
    assert [source.files[frame].name for frame in frames] == [name for name in names if name != "cover.png"]
    assert (word in caplog.text) if word else not caplog.text


def test_the_first_file_of_any_camera_tells_from_where_all_count(tmp_path: Path) -> None:
    write(tmp_path / "images" / "C1", ["000000.png", "000001.png"])
    write(tmp_path / "images" / "C2", ["000001.png", "000002.png"])
    found = image_sources(tmp_path, ["C1", "C2"])
    assert [list(source.files) for source in found.values() if isinstance(source, ImageFiles)] == [[0, 1], [1, 2]]


def test_two_files_of_one_number_are_refused(tmp_path: Path) -> None:
    for names in (["3.png", "000003.png"], ["000003.jpg", "000003.png"]):
        with pytest.raises(ValueError, match="have one number, needs one image for each frame"):
            numbered_files(write(tmp_path / names[0][:2], names))
    write(tmp_path / "video", [])
    for name in ("C1.mp4", "C1.AVI"):
        (tmp_path / "video" / name).write_bytes(b"x")
    with pytest.raises(ValueError, match=r"C1\.\w+: is a second video of C1, needs one"):
        image_sources(tmp_path, ["C1"])
    (tmp_path / "videos").mkdir()
    for name in ("a.mp4", "a.avi"):
        (tmp_path / "videos" / name).write_bytes(b"x")
    with pytest.raises(ValueError, match=r"a\.mp4: would be camera a, as a\.avi is"):
        number_of_pictures(tmp_path / "videos")


def test_what_belongs_to_no_camera_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_recording(tmp_path, small())
    write(tmp_path / "images" / "C9", ["000001.png"])
    write(tmp_path / "video", ["._C1.mp4.png"])
    (tmp_path / "video" / "lobby.mp4").write_bytes(b"x")
    (tmp_path / "detections" / "._C1.txt").write_bytes(b"\x00\x05\x16\x07")
    (tmp_path / "detections" / "boxes.csv").write_text("x")
    with caplog.at_level(logging.WARNING):
        assert read_recording(tmp_path).images == {}
    for word in ("C9 left out, belong to no camera of C1", "lobby.mp4 left out", "boxes.csv left out"):
        assert word in caplog.text
    assert "._C1" not in caplog.text


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_exif_orientation_is_applied_in_folders_and_recordings(tmp_path: Path, kind: str, orientation: int, caplog: pytest.LogCaptureFixture) -> None:
    """The image as it is stored is what the inverse of the orientation makes of the upright one."""
    back = {1: 0, 2: 1, 3: 3, 4: 5, 5: 6, 6: 2, 7: 7, 8: 4}
    ways = {1: Pillow.Transpose.FLIP_LEFT_RIGHT, 2: Pillow.Transpose.ROTATE_90, 3: Pillow.Transpose.ROTATE_180, 4: Pillow.Transpose.ROTATE_270}
    ways |= {5: Pillow.Transpose.FLIP_TOP_BOTTOM, 6: Pillow.Transpose.TRANSPOSE, 7: Pillow.Transpose.TRANSVERSE}
    stored = Pillow.fromarray(grey(60))
    if back[orientation]:
        stored = stored.transpose(ways[back[orientation]])
    exif = Pillow.Exif()
    exif[0x0112] = orientation
    folder = tmp_path / "images" / "C1"
    folder.mkdir(parents=True)
    file = folder / f"000001.{kind.lower()}"
    stored.save(file, kind, exif=exif)
    with caplog.at_level(logging.WARNING):
        (found,) = frames_of_pictures(file)
        (read,) = image_sources(tmp_path, ["C1"])["C1"].images(1, SIZE)
    assert read is not None
    for image in (found.image, read):
        assert image.shape == (*SIZE, 3)
        assert np.abs(image.astype(int) - grey(60)).mean() < 4
    assert ("turned upright" in caplog.text) == (orientation != 1)


def test_one_line_tells_of_all_turned_images_of_a_folder(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    exif = Pillow.Exif()
    exif[0x0112] = 6
    for name in ("1.jpg", "2.jpg", "3.jpg"):
        Pillow.fromarray(grey(60)).save(tmp_path / name, exif=exif)
    with caplog.at_level(logging.WARNING):
        assert len(list(frames_of_pictures(tmp_path))) == 3
    assert caplog.text.count("turned upright") == 1


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_values_of_32_bits_are_refused(tmp_path: Path, kind: type) -> None:
    Pillow.fromarray(np.full((8, 8), 70000, kind)).save(tmp_path / "deep.tif")
    with pytest.raises(ValueError, match=rf"deep\.tif: is an image of {kind.__name__} values, needs 8 or 16 bits"):
        list(frames_of_pictures(tmp_path))


@pytest.mark.parametrize("suffix", PICTURES)
def test_bytes_behind_the_end_and_all_suffixes(suffix: str) -> None:
    data = cv2.imencode(suffix, grey(90))[1].tobytes()
    for more in (b"", b"\0" * 3000, b"motion photo" * 400):
        assert np.abs(decode_picture(data + more).astype(int) - grey(90)).mean() < 3
    for cut in (0, 10, len(data) // 2):
        with pytest.raises(ValueError, match=r"is no image that is read|is truncated or damaged"):
            decode_picture(data[:cut])


def test_what_a_library_only_warns_of_is_decoded() -> None:
    data = cv2.imencode(".jpg", grey(90))[1].tobytes()
    assert decode_picture(data[:-2] + b"\0\x11\x22" + data[-2:]).shape == (*SIZE, 3)
    no_end = cv2.imencode(".png", grey(90))[1].tobytes()[:-12]
    np.testing.assert_array_equal(decode_picture(no_end), grey(90))


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_depth_is_that_of_the_content(bits: int, suffix: str) -> None:
    """Cameras of 12 bits leave the upper four of 16 empty."""
    deep = grey(90).astype(np.uint16) << (bits - 8)
    found = decode_picture(cv2.imencode(suffix, deep)[1].tobytes())
    np.testing.assert_array_equal(found, grey(90))


def video(path: Path, times: list[int], codec: str = "libx264", rate: int = 30) -> Path:
    """A video whose frames have these times in units of 1/30 s."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = SIZE[1], SIZE[0], "yuv420p"
        stream.codec_context.time_base = Fraction(1, 30)
        for k, time in enumerate(times):
            frame = av.VideoFrame.from_ndarray(grey(20 + 10 * k), "rgb24")
            frame.pts, frame.time_base = time, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("suffix", [".mkv", ".mp4", ".webm", ".avi"])
def test_frames_are_counted_by_decoding_and_times_are_stamps(tmp_path: Path, suffix: str) -> None:
    """A Matroska file tells no number of frames: duration times rate is an estimate."""
    times = list(range(8)) if suffix == ".avi" else [0, 1, 2, 9, 10, 25, 26, 40]
    codec = {".webm": "libvpx-vp9", ".avi": "mpeg4"}.get(suffix, "libx264")
    file = video(tmp_path / f"C1{suffix}", times, codec)
    assert len(list(frames_of_pictures(file))) == number_of_pictures(file) == number_of_frames(file) == 8
    np.testing.assert_allclose(frame_times(file) - frame_times(file)[0], np.array(times) / 30, atol=0.002)
    source = VideoFile(file)
    assert source.frames() == 8
    assert source.cut(3, 8).frames() == 5
    assert sum(image is not None for image in source.images(8, SIZE)) == 8
    with pytest.raises(ValueError, match="has 8 frames, the recording has 9"):
        list(source.images(9, SIZE))


def test_cameras_are_named_by_folders_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write(tmp_path / "clip.v2", ["1.png"])
    assert [frame.camera for frame in frames_of_pictures(folder)] == ["clip.v2"]
    monkeypatch.chdir(folder)
    assert [frame.camera for frame in frames_of_pictures(Path("."))] == ["clip.v2"]
    (folder / "sub").mkdir()
    monkeypatch.chdir(folder / "sub")
    assert [frame.camera for frame in frames_of_pictures(Path(".."))] == ["clip.v2"]


def test_other_content_has_another_checksum(tmp_path: Path) -> None:
    folder = write(tmp_path / "shot", ["1.png", "2.png"])
    before = pictures_checksum(folder)
    assert pictures_checksum(folder) == before
    cv2.imwrite(str(folder / "2.png"), grey(11))
    assert pictures_checksum(folder) != before
    assert content_checksum([folder / "1.png"]) != content_checksum([folder / "2.png"])
