"""Videos beside detections: frames in step with ticks, and tracking of real people with them."""

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tracker.datasets.opening import open_sequence
from tracker.datasets.pets2009 import PetsOptions
from tracker.datasets.pets2009_videos import with_videos
from tracker.detections.front_end import ImageParameters
from tracker.detections.optical_flow import TrackletParameters
from tracker.detections.silhouettes import SilhouetteParameters
from tracker.io.video_files import VideoWriters
from tracker.metrics.evaluation import evaluate
from tracker.mht.parameters import MhtParameters
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import TicksInMemory


def test_frames_belong_to_their_ticks(data: Any, tmp_path: Path) -> None:
    sequence = open_sequence(data("pets2009/S2.L1"), [1, 5])
    sequence = replace(sequence, ticks=TicksInMemory(tuple(sequence.ticks)[:4], sequence.setup.mounts))
    videos = VideoWriters(tmp_path / "video", 7.0)
    for k in range(4):
        videos.put("View_005", np.full((96, 128, 3), 50 * k, dtype=np.uint8))
    videos.finish()
    for _ in range(2):
        found = list(with_videos(sequence, tmp_path).ticks)
        assert [tick.index for tick in found] == [0, 1, 2, 3]
        for k, tick in enumerate(found):
            assert tick.views[0].image is None
            assert tick.views[1].image is not None
            assert abs(float(tick.views[1].image.mean()) - 50 * k) < 4


def test_short_or_invalid_video_is_refused(data: Any, tmp_path: Path) -> None:
    sequence = open_sequence(data("pets2009/S2.L1"), [1])
    with pytest.raises(ValueError, match=r"has no images, and no video/CAMERA.mp4 of View_001"):
        with_videos(sequence, tmp_path)
    videos = VideoWriters(tmp_path / "video", 7.0)
    for _ in range(2):
        videos.put("View_001", np.zeros((96, 128, 3), dtype=np.uint8))
    videos.finish()
    with pytest.raises(ValueError, match=r"View_001.mp4: has 2 frames, the detections go on"):
        list(with_videos(sequence, tmp_path).ticks)
    (tmp_path / "video" / "View_001.mp4").write_text("x")
    with pytest.raises(ValueError, match=r"View_001.mp4: is no video"):
        list(with_videos(sequence, tmp_path).ticks)


def scores(folder: Path, frames: int, choice: PetsOptions, parameters: Parameters) -> dict[str, Any]:
    """Of the first frames of View_001 with its video."""
    sequence = with_videos(open_sequence(folder, [1], choice), folder)
    assert sequence.truth is not None
    short = replace(sequence, truth=sequence.truth[:frames])
    results = Results.of(track(sequence.setup, itertools.islice(iter(sequence.ticks), frames), parameters), {})
    return dict(evaluate(short, results)["targets"])


SINGLE = Parameters(images=ImageParameters(TrackletParameters(), SilhouetteParameters()), delay=5)
MANY = Parameters(multiple=MhtParameters(), images=ImageParameters(None, SilhouetteParameters(), appearance=True), delay=10)


@pytest.mark.parametrize("parameters", [SINGLE, MANY], ids=["single", "multiple"])
def test_tracking_real_people_with_images(data: Any, parameters: Parameters) -> None:
    """60 real frames, where nobody is to be confused."""
    found = scores(data("pets2009/S2.L1"), 60, PetsOptions(), parameters)
    assert found["mota"] > 0.95
    assert found["switches"] == 0


@pytest.mark.slow
def test_silhouettes_compensate_a_poor_detector(data: Any) -> None:
    """An old detector loses whom the sign hides; 400 frames."""
    folder = data("pets2009/S2.L1")
    poor = PetsOptions.parse((f"1={folder / 'mot15' / 'det.txt'}",), "", 0)
    seen, blind = (scores(folder, 400, poor, p) for p in (MANY, replace(MANY, images=ImageParameters())))
    assert seen["mota"] > 0.945
    assert seen["idf1"] > 0.96
    assert seen["mota"] > blind["mota"] + 0.05
