"""Videos beside detections: the frames of real files, in step with the ticks; and that tracking real people by them loses nobody."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tracker.evaluation import evaluate
from tracker.films import filmed
from tracker.pipeline import Parameters, track
from tracker.results import Results
from tracker.sequence import TicksInMemory
from tracker.sources import open_source
from tracker.tracklets import TrackletParameters
from tracker.videos import Videos


def test_frames_come_with_their_ticks(data: Any, tmp_path: Path) -> None:
    sequence = open_source(data("pets2009/S2.L1"), [1, 5])
    sequence = replace(sequence, ticks=TicksInMemory(tuple(sequence.ticks)[:4], sequence.setup.mounts))
    videos = Videos(tmp_path / "video", 7.0)
    for k in range(4):
        videos.put("View_005", np.full((96, 128, 3), 50 * k, dtype=np.uint8))
    videos.finish()
    for _ in range(2):
        found = list(filmed(sequence, tmp_path).ticks)
        assert [tick.index for tick in found] == [0, 1, 2, 3]
        for k, tick in enumerate(found):
            assert tick.views[0].image is None
            assert tick.views[1].image is not None
            assert abs(float(tick.views[1].image.mean()) - 50 * k) < 4


def test_a_video_that_ends_early_or_is_none(data: Any, tmp_path: Path) -> None:
    sequence = open_source(data("pets2009/S2.L1"), [1])
    with pytest.raises(ValueError, match=r"has no images, and no video/CAMERA.mp4 of View_001"):
        filmed(sequence, tmp_path)
    videos = Videos(tmp_path / "video", 7.0)
    for _ in range(2):
        videos.put("View_001", np.zeros((96, 128, 3), dtype=np.uint8))
    videos.finish()
    with pytest.raises(ValueError, match=r"View_001.mp4: has 2 frames, the detections go on"):
        list(filmed(sequence, tmp_path).ticks)
    (tmp_path / "video" / "View_001.mp4").write_text("x")
    with pytest.raises(ValueError, match=r"View_001.mp4: is no video"):
        list(filmed(sequence, tmp_path).ticks)


def test_real_people_by_images(data: Any) -> None:
    """60 real frames, where nobody is to be confused."""
    folder = data("pets2009/S2.L1")
    sequence = filmed(open_source(folder, [1]), folder)
    ticks = []
    for tick in sequence.ticks:
        ticks.append(tick)
        if len(ticks) == 60:
            break
    assert sequence.truth is not None
    short = replace(sequence, truth=sequence.truth[:60])
    results = Results.of(track(sequence.setup, ticks, Parameters(tracklets=TrackletParameters(), delay=5)), {})
    scores = evaluate(short, results)["targets"]
    assert scores["mota"] > 0.95
    assert scores["switches"] == 0
