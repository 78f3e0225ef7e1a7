"""PETS 2009 export: the reader of PETS 2009 reads it, and it scores as the sequence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, RATE
from tracker.formats.opening import open_sequence
from tracker.formats.pets2009 import read_annotations, view_names
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Grid
from tracker.io.tsai_xml import read_camera
from tracker.metrics.evaluation import evaluate
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results

Exported = Callable[[str], Path]


def results(tracks: dict[int, tuple[Ints, Array]], robots: dict[str, list[object]]) -> Results:
    return Results(FRAMES, tracks, robots, {name: [np.eye(6)] * FRAMES for name in robots}, {})  # type: ignore[arg-type]


def test_reader_recovers_the_sequence(sequence: Path, exported: Exported) -> None:
    source, again = read_sequence(sequence), open_sequence(exported("pets") / "plaza")
    assert list(again.setup.mounts) == ["View_001", "View_002", "View_003"]
    assert again.setup.period == 1 / RATE
    assert isinstance(again.setup.ground, Grid)
    assert isinstance(source.setup.ground, Grid)
    assert_array_equal(again.setup.ground.heights, source.setup.ground.heights)
    for k, name in enumerate(again.setup.mounts):
        mount, start = source.setup.mounts[f"view_{k}"], source.setup.starts[f"view_{k}"]
        assert again.setup.mounts[name].camera == mount.camera
        there = again.setup.starts[name]
        assert start is not None
        assert there is not None
        assert_allclose((there.T_world_robot.inverse() @ start.T_world_robot).log(), 0, atol=1e-9)
    assert source.truth is not None
    assert again.truth is not None
    for old, new in zip(source.truth, again.truth, strict=True):
        assert_array_equal(new.person_id, old.person_id)
        assert_allclose(new.feet, old.feet, atol=1e-9)
    for old_tick, new_tick in zip(source.ticks, again.ticks, strict=True):
        assert new_tick.time == pytest.approx(old_tick.time)
        for old_view, new_view in zip(old_tick.views[1:], new_tick.views, strict=True):
            assert_allclose(new_view.detections.bearing, old_view.detections.bearing, atol=1e-9)
            assert_allclose(new_view.detections.extent, old_view.detections.extent, atol=1e-9)
            assert_array_equal(new_view.detections.confidence, old_view.detections.confidence)


def test_export_scores_as_the_sequence(sequence: Path, exported: Exported) -> None:
    """View_001 sees everybody here. A tracker that misses, drifts and swaps gets the same numbers from both."""
    source, again, rng = read_sequence(sequence), open_sequence(exported("pets") / "plaza"), np.random.default_rng(9)
    tracks = {}
    for truth in source.truth or ():
        kept = rng.random(len(truth.person_id)) < 0.85
        ids = truth.person_id[kept] + 1000 * (truth.index > 3)
        tracks[truth.index] = ids, truth.feet[kept] + rng.normal(0, 0.3, (kept.sum(), 3)) * [1, 1, 0]
    robots = {"robot_0": [t.T_world_robot["robot_0"] for t in source.truth or ()]}
    ours = evaluate(source, results(tracks, robots))["targets"]  # type: ignore[arg-type]
    theirs = evaluate(again, results(tracks, {}))["targets"]
    assert ours["misses"] + ours["switches"] > 0
    for name, value in ours.items():
        assert_allclose(theirs[name], value, atol=1e-9, err_msg=name)


def test_annotations_reach_from_feet_to_head(sequence: Path, exported: Exported) -> None:
    name, camera, T = read_camera(exported("pets") / "plaza" / "calibration" / "View_001.xml")
    assert name == "View_001"
    assert isinstance(camera, Tsai)
    source = read_sequence(sequence)
    whole = read_annotations(exported("pets") / "plaza" / "annotations" / "plaza.xml")
    assert list(whole) == list(range(FRAMES))
    for truth in source.truth or ():
        ids, boxes = whole[truth.index]
        assert_array_equal(ids, truth.person_id)
        feet, _ = camera.pixels_from_bearings(T.inverse().apply(truth.feet))
        head, _ = camera.pixels_from_bearings(T.inverse().apply(truth.feet + np.array([0.0, 0.0, 1.72])))
        assert_allclose(boxes[:, 0] + boxes[:, 2] / 2, feet[:, 0], atol=1e-9)
        assert_allclose(boxes[:, 1] + boxes[:, 3], feet[:, 1], atol=1e-9)
        assert_allclose(boxes[:, 1], head[:, 1], atol=4)


def test_names_of_views() -> None:
    assert view_names(["b", "a"]) == {"b": "View_001", "a": "View_002"}
    assert view_names(["View_005", "View_001"]) == {"View_005": "View_005", "View_001": "View_001"}
    assert view_names(["View_005", "View_007"]) == {"View_005": "View_001", "View_007": "View_002"}
    assert view_names(["View_001", "x"]) == {"View_001": "View_001", "x": "View_002"}
