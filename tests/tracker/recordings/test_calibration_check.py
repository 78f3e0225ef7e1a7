"""Planted errors of calibration and frame numbers are found and named, and nothing is found in correct recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import CORNERS, planted, walked_room, with_extrinsics, with_frames
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.recordings import Recording
from tracker.recordings.calibration_check import CalibrationReport, check_calibration
from tracker.recordings.calibration_feet import MOST_BOXES, CalibrationCase
from tracker.recordings.calibration_timing import STRETCHES
from tracker.recordings.degradation import BoxNoise

Data = Callable[..., Path]
PLANTED = {name: seen for name, (_, _, seen) in planted(walked_room(people=1, frames=2)).items()}
"""Name of an error → whether it can be seen without truth."""
OTHER_CAMERAS = {f"frames + 1 in C{k}" for k in (2, 3, 4)}
"""Found like that of C1: in real recordings, and of C3 where it is named."""


@cache
def room() -> Recording:
    return walked_room()


def kinds(report: CalibrationReport) -> list[str]:
    return [finding.kind for finding in report.findings]


def test_changed_boxes_are_those_of_the_frames_that_are_used() -> None:
    boxes = {f: (np.tile([600.0, 300.0, 40.0, 100.0], (MOST_BOXES // 3, 1)), np.ones(MOST_BOXES // 3)) for f in range(5)}
    case = CalibrationCase.of(Recording(4.0, {"C1": room().cameras["C1"]}, {"C1": boxes}))
    changed = case.with_changed_boxes(["C1"], lambda box, _: box)
    assert len(changed.rays["C1"].frame) == len(case.rays["C1"].frame) == MOST_BOXES


def without_truth(recording: Recording) -> Recording:
    return replace(recording, truth=None)


@pytest.mark.parametrize("error", [error for error in PLANTED if error not in OTHER_CAMERAS])
def test_each_planted_error_is_found_and_no_other(error: str) -> None:
    """Without truth where it can be seen so. With truth too: the soak test of real recordings."""
    kind, wrong, seen = planted(room())[error]
    assert kinds(check_calibration(without_truth(wrong) if seen else wrong)) == [kind]


@pytest.mark.parametrize(("people", "seed"), [(2, 0), (8, 1), (40, 0)])
def test_nothing_is_found_in_a_correct_recording(people: int, seed: int) -> None:
    recording = walked_room(people=people, frames=40 if people == 40 else 160, seed=seed)
    assert kinds(check_calibration(recording)) == []
    assert kinds(check_calibration(without_truth(recording))) == []


def test_nothing_is_found_in_boxes_of_nobody() -> None:
    """False boxes alone, or none, are no evidence."""
    recording = walked_room(people=1)
    nobody = replace(recording, detections={name: {f: (b[1:], c[1:]) for f, (b, c) in boxes.items()} for name, boxes in recording.detections.items()})
    assert kinds(check_calibration(without_truth(nobody))) == []
    assert kinds(check_calibration(replace(recording, detections={}))) == []


def test_one_camera_without_truth_is_told_by_the_heights_of_boxes() -> None:
    recording = without_truth(room().choose(["C2"]))
    assert kinds(check_calibration(recording)) == []
    assert kinds(check_calibration(with_extrinsics(recording, lambda e: (e[0], e[1] * 1000)))) == ["units-mm"]
    assert kinds(check_calibration(with_extrinsics(recording, lambda e: (e[0].T, e[1])))) == ["rotation-transposed"]


def test_all_in_millimetres_is_told_of_each_part() -> None:
    wrong = with_extrinsics(room(), lambda e: (e[0], e[1] * 1000))
    assert wrong.truth is not None
    truth = {frame: (ids, places * 1000) for frame, (ids, places) in wrong.truth.items()}
    report = check_calibration(replace(wrong, truth=truth, area=np.asarray(wrong.area) * 1000))
    assert kinds(report) == ["units-mm", "truth-mm", "area-mm"]
    assert report.findings[0].cameras == ("C1", "C2", "C3", "C4")
    assert "all cameras" in report.findings[0].words
    assert "millimetres" in report.findings[0].words


@pytest.mark.parametrize("shift", [-4, 1])
def test_the_frames_and_the_camera_are_named(shift: int) -> None:
    late = with_frames(room().cut(10, 160), lambda frame: frame + 5 + shift, ("C3",))
    late = with_frames(late, lambda frame: frame + 5, ("C1", "C2", "C4"))
    assert late.truth is not None
    late = replace(late, truth={frame + 5: people for frame, people in late.truth.items()}, frames=0)
    (finding,) = check_calibration(late).findings
    assert finding.cameras == ("C3",)
    assert f"{abs(shift)} frame" in finding.words
    assert ("late" if shift > 0 else "early") in finding.words


@pytest.mark.parametrize("n", [2, 30])
def test_every_nth_frame_names_n(n: int) -> None:
    assert n in STRETCHES
    recording = room()
    assert recording.truth is not None
    faster = replace(recording, truth={n * frame: people for frame, people in recording.truth.items()}, frames=0)
    (finding,) = check_calibration(faster).findings
    assert f"{n} times as fast" in finding.words


def test_a_camera_below_the_ground_is_told_of() -> None:
    """No form of R and t explains a camera that was lowered."""
    recording = room()
    camera = recording.cameras["C1"]
    low = replace(camera, pose=replace(camera.pose, translation=camera.pose.translation - [0.0, 0.0, 4.0]))
    report = check_calibration(replace(recording, cameras={**recording.cameras, "C1": low}))
    assert kinds(report) == ["camera-below-ground"]
    assert "1.60 m below the ground" in report.findings[0].words


def test_figures_of_cameras() -> None:
    report = check_calibration(room())
    for one, place in zip(report.cameras, CORNERS, strict=True):
        assert np.allclose(one.place, place)
        assert one.above == pytest.approx(place[2])
        assert np.cos(np.radians(one.heading)) == pytest.approx(np.sign(6 - place[0]) * abs(np.cos(np.radians(one.heading))))
        assert -40 < one.pitch < -5
        assert one.distance is not None
        assert one.distance < 0.4
        assert one.compared == "truth"
        assert one.grounded > 0.9
        assert one.tall > 0.8
        assert one.area_share is not None
        assert 0.3 < one.area_share <= 1
    others = check_calibration(without_truth(room())).cameras[0]
    assert others.compared == "cameras"
    assert len(report.lines()) == 5
    assert [one["name"] for one in report.to_json()["cameras"]] == ["C1", "C2", "C3", "C4"]


SOURCES = {
    "CMC1": (("cmc", "CMC1"), {}),
    "CMC2": (("cmc", "CMC2"), {}),
    "CMC1, Faster R-CNN": (("cmc", "CMC1"), {"other": True}),
    "CMC2, Faster R-CNN": (("cmc", "CMC2"), {"other": True}),
    "WILDTRACK": (("wildtrack",), {"misses": 0.1}),
    "WILDTRACK, half missing": (("wildtrack",), {"misses": 0.5}),
    "PETS 2009": (("pets2009", "S2.L1"), {}),
}
LONG = ("CMC2, Faster R-CNN", "WILDTRACK, half missing", "PETS 2009")
IN_STEP = {"CMC1": {"C2"}, "CMC2": {"C3"}}
"""Cameras that are 0.4 frames out of step. Without truth, one frame more in the other direction leaves them as much in step as they are."""


@cache
def opened(path: Path, other: bool = False, misses: float | None = None) -> Recording:
    noise = None if misses is None else BoxNoise(misses, 0.02)
    detections = {"": path / "detections-faster-rcnn"} if other else {}
    return open_recording(path, SourceOptions(detections=detections, projected=noise))


@pytest.mark.parametrize("source", [pytest.param(source, marks=[pytest.mark.soak] if source in LONG else []) for source in SOURCES])
def test_nothing_is_found_in_real_recordings(data: Data, source: str) -> None:
    parts, options = SOURCES[source]
    recording = opened(data(*parts), **options)
    assert kinds(check_calibration(recording)) == []
    assert kinds(check_calibration(without_truth(recording))) == []


@pytest.mark.soak
@pytest.mark.parametrize(("source", "truth"), [("CMC1", True), ("CMC1", False), ("CMC2", True), ("WILDTRACK", True)])
def test_planted_errors_are_found_in_real_recordings(data: Data, source: str, truth: bool) -> None:
    parts, options = SOURCES[source]
    recording = opened(data(*parts), **options)
    # Each error takes 2 to 4 s: all of them in one recording, every third in the others.
    for error, (kind, wrong, seen) in list(planted(recording).items())[:: 1 if source == "CMC1" else 3]:
        if truth or (seen and error.removeprefix("frames + 1 in ") not in IN_STEP.get(source, ())):
            assert kinds(check_calibration(wrong if truth else without_truth(wrong))) == [kind], error
