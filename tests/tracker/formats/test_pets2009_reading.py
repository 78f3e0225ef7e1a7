"""Opening PETS 2009 folders, and choices that they do not have."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tracker.detections.boxes import detections_from_boxes
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import angles_from_bearing


def test_pets(data: Callable[..., Path]) -> None:
    sequence = open_sequence(data("pets2009", "S2.L1"), SourceOptions(("1", "5", "7")))
    assert list(sequence.setup.mounts) == ["View_001", "View_005", "View_007"]
    assert len(sequence.ticks) == 795
    assert sequence.truth is not None
    assert len(sequence.truth) == 795
    assert sequence.truth[0].person_id.tolist() == [9, 15, 19]


def test_all_views_are_the_default(data: Callable[..., Path]) -> None:
    assert len(open_sequence(data("pets2009", "S2.L1")).setup.mounts) == 7


def test_detection_keeps_its_foot_point(data: Callable[..., Path]) -> None:
    """The lower edge of the angular box goes through the middle of the lower edge of the pixel box, to the pixel."""
    sequence = open_sequence(data("pets2009", "S2.L1"), SourceOptions(("View_001",)))
    camera = sequence.setup.mounts["View_001"].camera
    boxes = np.array([[640.0, 240.0, 43.0, 80.0], [100.0, 400.0, 60.0, 150.0]])
    found = detections_from_boxes(camera, boxes, np.ones(2))
    azimuth, elevation = angles_from_bearing(found.bearing)
    low = elevation - found.extent[:, 1] / 2
    foot = np.stack([np.cos(low) * np.cos(azimuth), np.cos(low) * np.sin(azimuth), np.sin(low)], axis=1)
    pixels, inside = camera.pixels_from_bearings(foot)
    assert inside.all()
    np.testing.assert_allclose(pixels, [[661.5, 320.0], [130.0, 550.0]], atol=1e-6)


def test_other_and_degraded_detections(data: Callable[..., Path]) -> None:
    folder, other = data("pets2009", "S2.L1"), data("pets2009", "S2.L1", "mot15", "det.txt")
    choice = SourceOptions.parse([f"1={other}"], "drop=0.5,clutter=1", 3, cameras="1,5")
    assert SourceOptions.of_run(choice.to_run()).degradation == choice.degradation
    worse, again = open_sequence(folder, choice), open_sequence(folder, SourceOptions.of_run(choice.to_run()))
    assert worse.provenance == again.provenance != open_sequence(folder, SourceOptions(("1", "5"))).provenance
    for a, b in zip(list(worse.ticks)[:20], list(again.ticks)[:20], strict=True):
        for v, w in zip(a.views, b.views, strict=True):
            np.testing.assert_array_equal(v.detections.bearing, w.detections.bearing)
    # A view draws from a stream of its own: one more view does not change what another loses.
    alone = open_sequence(folder, SourceOptions.parse((), "drop=0.5,clutter=1", 3, cameras="5"))
    np.testing.assert_array_equal(list(alone.ticks)[7].views[0].detections.bearing, list(worse.ticks)[7].views[1].detections.bearing)


def test_choices_that_cannot_be_are_refused(data: Callable[..., Path], tmp_path: Path) -> None:
    folder, other = data("pets2009", "S2.L1"), data("pets2009", "S2.L1", "mot15", "det.txt")
    with pytest.raises(ValueError, match="no such folder"):
        open_sequence(tmp_path / "nowhere")
    (tmp_path / "detections").mkdir()
    with pytest.raises(ValueError, match="calibration/ in it or beside it"):
        open_sequence(tmp_path)
    with pytest.raises(ValueError, match=r"View_002.txt: no such file; there are View_001, View_003"):
        open_sequence(folder, SourceOptions(("2",)))
    with pytest.raises(ValueError, match="names a camera twice"):
        SourceOptions.parse(cameras="1,1")
    with pytest.raises(ValueError, match="--detections names View_001, --cameras has 5"):
        open_sequence(folder, SourceOptions.parse([f"1={other}"], cameras="5"))
    sequences.write(tmp_path / "s")
    with pytest.raises(ValueError, match="--degrade and --project are for recordings"):
        open_sequence(tmp_path / "s", SourceOptions.parse(degrade="drop=0.5"))
