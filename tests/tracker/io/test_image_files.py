"""Image and video files: round trips, checks of headers, and full disks."""

import resource
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tracker.io.image_files import JPEG, PNG, PNG_RUN_LENGTH, ImageWriter, decode_image, image_size, range_counts
from tracker.io.video_files import VideoWriters

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("options", [PNG, PNG_RUN_LENGTH])
@pytest.mark.parametrize("shape", [(1, 1), (7, 13), (64, 128)])
def test_instances_round_trip(tmp_path: Path, options: list[int], shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    columns = np.repeat(rng.integers(0, 300, (1, shape[1])), shape[0], axis=0)
    images = [np.zeros(shape, np.uint16), rng.integers(0, 65536, shape), columns]
    coders = ImageWriter(tmp_path)
    for k, image in enumerate(images):
        coders.put(f"{k}.png", image.astype(np.uint16), options)
    coders.wait()
    coders.close()
    for k, image in enumerate(images):
        data = (tmp_path / f"{k}.png").read_bytes()
        assert image_size(data) == shape
        assert coders.checksums[f"{k}.png"][1] == len(data)
        np.testing.assert_array_equal(decode_image(data, shape), image)


def test_range_round_trip_to_half_a_unit() -> None:
    metres = np.array([[0.01, 1.0, 3.14159, 255.9, 256.0, 1e6, np.inf]], np.float32)
    counts = range_counts(metres)
    np.testing.assert_allclose(counts[0, :4] / 256, metres[0, :4], atol=0.5 / 256 + 1e-6)
    assert not counts[0, 4:].any()


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_other_size_and_truncation_are_refused(ending: str) -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 80, 3), np.uint8)
    data = cv2.imencode(ending, image, JPEG if ending == ".jpg" else PNG)[1].tobytes()
    assert image_size(data) == (48, 80)
    with pytest.raises(ValueError, match=r"is 80 x 48 px, needs 81 x 48 px"):
        decode_image(data, (48, 81))
    for cut in (0, 10, 30, len(data) // 2, len(data) - 3):
        with pytest.raises(ValueError, match=r"is no image that is read|is truncated or damaged"):
            decode_image(data[:cut], (48, 80))


def test_videos_hold_all_frames_and_colors(tmp_path: Path) -> None:
    videos = VideoWriters(tmp_path / "videos", 7.0)
    for k in range(5):
        videos.put("a", np.full((48, 64, 3), (40 * k, 60, 200), np.uint8))
    videos.finish()
    read = cv2.VideoCapture(str(tmp_path / "videos" / "a.mp4"))
    assert read.get(cv2.CAP_PROP_FPS) == 7.0
    for k in range(5):
        ok, frame = read.read()
        assert ok
        np.testing.assert_allclose(frame[20, 30, ::-1], (40 * k, 60, 200), atol=12)
    assert not read.read()[0]


DRAWN = """
import sys, numpy as np
from pathlib import Path
images = (np.random.default_rng(k).integers(0, 255, (240, 320, 3), np.uint8) for k in range(30))
"""
BY_OPENCV = """
from tracker.io.video_files import VideoWriters
videos = VideoWriters(Path(sys.argv[1]), 7.0)
for image in images:
    videos.put("a", image)
videos.finish()
"""
BY_AV = """
from sim.visualization.plan_and_video import write_video
write_video(Path(sys.argv[1]), images, 7.0)
"""


@pytest.mark.command
@pytest.mark.parametrize(("program", "name"), [(BY_OPENCV, "v"), (BY_AV, "out.mp4")])
def test_video_on_a_full_disk_is_an_error(tmp_path: Path, program: str, name: str) -> None:
    """The encoders say nothing of a disk that is full."""
    limit = 100_000
    done = subprocess.run(
        [sys.executable, "-c", DRAWN + program, tmp_path / name],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.stderr.strip().splitlines()[-1].endswith("frames could be written; is the disk full?"), done.stderr
    assert not (tmp_path / "out.mp4").exists()
