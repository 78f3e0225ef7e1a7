"""Images with estimates: all cameras are drawn, those that a place has of its own, too."""

from pathlib import Path

import numpy as np
import pytest

from sim.recording import record
from sim.scenario import Scenario
from sim.visualization.overlays import BODY, annotated, body_corners, contact_sheet
from sim.visualization.plan_and_video import video_frames
from tests.worlds.places.samples import MODEL
from tracker.geometry import Pose
from tracker.pipeline import track
from tracker.sequence import Results, read_sequence


@pytest.mark.render
def test_cameras_of_a_place_are_drawn_beside_those_of_robots(tmp_path: Path) -> None:
    (tmp_path / "site.xml").write_text(MODEL)
    record(Scenario(world=str(tmp_path / "site.xml"), robots=1, people=2, frames=2, width=128), tmp_path / "s")
    sequence = read_sequence(tmp_path / "s")
    results = Results.of(track(sequence.setup, sequence.ticks), run={})
    tick = next(iter(sequence.ticks))
    images = annotated(sequence, results, tick)
    assert {name: image.shape for name, image in images.items()} == {"robot_0_camera": (64, 128, 3), "View_001": (72, 96, 3)}
    sheet = contact_sheet(images, "both")
    assert sheet.shape[1] == 2 * (128 + 8)
    frame = next(iter(video_frames(sequence, results, [tick])))
    assert len(np.unique(frame[frame.shape[0] // 4 : frame.shape[0] // 2, : frame.shape[1] // 4])) > 10, "the second strip is not empty"


def test_a_body_is_as_wide_below_a_high_camera() -> None:
    for height in (0.0, 4.5):
        right, _, left, _ = body_corners(Pose.planar(0.0, 0.0, 0.0, height), np.array([1.8, 2.4, 0.0]))
        assert np.linalg.norm(right - left) == pytest.approx(BODY[0])
