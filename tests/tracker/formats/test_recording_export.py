"""Export as a recording: read back, it has the same cameras, boxes, truth, images and scores."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.formats.scene import FRAMES
from tests.tracker.recordings.test_folder import same_recording
from tracker.formats.exported_sequence import RecordedSequence
from tracker.formats.exporting import export_source
from tracker.formats.opening import open_recording, open_sequence
from tracker.formats.recording_export import recording_of
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Pose
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import track
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results
from tracker.types import Sequence

Exported = Callable[[str], Path]


def test_a_sequence_is_read_back(sequence: Path, exported: Exported) -> None:
    again = open_recording(exported("recording") / "plaza")
    same_recording(recording_of(RecordedSequence.open(sequence)), again)
    known, read = read_sequence(sequence), again.sequence(images=True)
    assert known.setup.moving_robots == read.setup.moving_robots
    for a, b in zip(known.ticks, read.ticks, strict=True):
        for v, w in zip(a.views, b.views, strict=True):
            np.testing.assert_array_equal(v.image, w.image)
            np.testing.assert_allclose(v.detections.bearing, w.detections.bearing, atol=1e-6)
            np.testing.assert_allclose(v.detections.extent, w.detections.extent, atol=1e-6)
            np.testing.assert_allclose(v.detections.covariance, w.detections.covariance, rtol=1e-12)
            assert (v.odometry is None) == (w.odometry is None)


def test_what_a_robot_sees_of_itself_is_kept(sequence: Path) -> None:
    recorded = RecordedSequence.open(sequence)
    own_body = np.arange(32).reshape(4, 8) % 5 == 0
    mounts = {n: replace(m, own_body=own_body if m.robot in recorded.setup.moving_robots else None) for n, m in recorded.setup.mounts.items()}
    seen = replace(recorded, sequence=replace(recorded.sequence, setup=replace(recorded.setup, mounts=mounts)))
    again = recording_of(seen).setup().mounts
    assert {n: m.own_body is own_body for n, m in again.items()} == {n: m.robot in recorded.setup.moving_robots for n, m in mounts.items()}


def test_the_same_results_have_the_same_scores(sequence: Path, exported: Exported) -> None:
    """Of a tracker's own results, and of the true places of every second person."""
    known, read = read_sequence(sequence), open_sequence(exported("recording") / "plaza")
    tracked = Results.of(track(known.setup, known.ticks), run={})
    half = replace(tracked, tracks={t.index: (t.person_id[::2], t.feet[::2]) for t in known.truth or ()})
    for results in (tracked, half):
        one, other = evaluate(known, results), evaluate(read, results)
        assert one["targets"] == pytest.approx(other["targets"])
        assert one["everybody"] == pytest.approx(other["everybody"])
        assert one["robots"]["ate_m"] == pytest.approx(other["robots"]["ate_m"], abs=1e-6)


def test_a_recording_of_a_recording_is_the_same(exported: Exported, tmp_path: Path) -> None:
    source = exported("recording") / "plaza"
    export_source(source, tmp_path / "again")
    same_recording(open_recording(source), open_recording(tmp_path / "again"))
    with pytest.raises(ValueError, match="lies in"):
        export_source(source, source / "x")


def test_parts_of_a_sequence(sequence: Path) -> None:
    known = read_sequence(sequence)
    fixed = SourceOptions.parse(cameras="view_0,view_2", frames="2:5")
    part = open_sequence(sequence, fixed)
    assert list(part.setup.mounts) == ["view_0", "view_2"]
    assert part.setup.moving_robots == ()
    ticks, truth = list(part.ticks), part.truth or ()
    assert [tick.index for tick in ticks] == [t.index for t in truth] == [0, 1, 2]
    np.testing.assert_array_equal(ticks[1].views[1].detections.bearing, list(known.ticks)[3].views[3].detections.bearing)
    np.testing.assert_array_equal(truth[1].visible[:, 1], (known.truth or ())[3].visible[:, 3])
    with pytest.raises(ValueError, match="--frames begins at 1, needs 0 where robots move"):
        open_sequence(sequence, SourceOptions.parse(frames="1:3"))


def estimates(source: Sequence) -> dict[int, Pose]:
    return {t.index: t.T_world_robot["robot_0"] for t in source.truth or ()}


def test_odometry_of_a_robot_is_kept(sequence: Path, exported: Exported) -> None:
    known, read = read_sequence(sequence), open_sequence(exported("recording") / "plaza")
    for frame, pose in estimates(known).items():
        assert abs((pose.inverse() @ estimates(read)[frame]).log()).max() < 1e-6
    for a, b in zip(known.ticks.odometry(), read.ticks.odometry(), strict=True):
        assert a.keys() == b.keys()
        for robot in a:
            np.testing.assert_allclose(a[robot].covariance, b[robot].covariance, rtol=1e-6)
            assert abs((a[robot].T_before_now.inverse() @ b[robot].T_before_now).log()).max() < 1e-7
    assert len(list(read.ticks.odometry())) == FRAMES
