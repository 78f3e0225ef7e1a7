"""Videos hold all frames in their colours, play in a browser, and errors leave no file."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim.visualization.plan_and_video import write_video
from tests.sim.browser import CHROMIUM, Browser

RATE = 7.0
PAGE = '<!doctype html><meta charset="utf-8"><title>A video</title><video src="out.mp4" muted preload="auto"></video>'
PLAYED = """new Promise((done) => {
    const video = document.querySelector("video");
    const report = (why) => done({
        why, error: video.error && video.error.message, width: video.videoWidth, height: video.videoHeight,
        duration: video.duration, time: video.currentTime, shown: video.getVideoPlaybackQuality().totalVideoFrames,
    });
    setTimeout(() => report("no end in 20 s"), 20000);
    video.addEventListener("error", () => report("error"));
    video.addEventListener("ended", () => report("ended"));
    video.play().catch((reason) => report(String(reason)));
})"""


def frames(count: int, width: int = 320, height: int = 180) -> Iterator[NDArray[np.uint8]]:
    """RGB frames of one colour each, redder from frame to frame."""
    for k in range(count):
        yield np.full((height, width, 3), (60 + 10 * k, 120, 200), np.uint8)


def test_all_frames_are_read_back_in_their_colours_and_are_the_same_bytes_again(tmp_path: Path) -> None:
    for name in ("out.mp4", "again.mp4"):
        write_video(tmp_path / name, frames(12), RATE)
    assert (tmp_path / "out.mp4").read_bytes() == (tmp_path / "again.mp4").read_bytes()
    read = cv2.VideoCapture(str(tmp_path / "out.mp4"))
    assert read.get(cv2.CAP_PROP_FPS) == RATE
    for expected in frames(12):
        ok, frame = read.read()
        assert ok
        np.testing.assert_allclose(frame[:, :, ::-1], expected, atol=6)
    assert not read.read()[0]


@pytest.mark.command
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium to play the video")
def test_a_browser_plays_it_to_the_end(tmp_path: Path) -> None:
    write_video(tmp_path / "out.mp4", frames(7), RATE)
    (tmp_path / "page.html").write_text(PAGE)
    with Browser(640) as browser:
        browser.open(tmp_path / "page.html")
        played = browser.evaluate(PLAYED)
        assert browser.complaints == []
    assert played["why"] == "ended", played
    assert played["error"] is None
    assert (played["width"], played["height"]) == (320, 180)
    assert played["duration"] == pytest.approx(7 / RATE, abs=0.01)
    assert played["time"] == pytest.approx(7 / RATE, abs=0.01)
    assert played["shown"] >= 3


def test_what_cannot_be_written_leaves_no_file(tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    with pytest.raises(ValueError, match=r"out.mp4: no frame to write"):
        write_video(out, iter(()), RATE)
    for width, height in ((321, 180), (320, 181)):
        with pytest.raises(ValueError, match=rf"out.mp4: frames are {width} x {height} pixels, needs an even width and height"):
            write_video(out, frames(2, width, height), RATE)
    with pytest.raises(ValueError, match=r"out.mp4: frame 2 has the shape \(90, 320, 3\), needs \(180, 320, 3\)"):
        write_video(out, [*frames(2), *frames(1, 320, 90)], RATE)
    with pytest.raises(ValueError, match=r"out.mp4: video cannot be written here"):
        write_video(tmp_path / "none" / "out.mp4", frames(2), RATE)
    assert list(tmp_path.iterdir()) == []
