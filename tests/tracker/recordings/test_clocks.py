"""Clocks of cameras: times.csv and its errors, the ticks that follow, and people who are followed by cameras with rates and delays of their own."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import walked_room
from tracker.detector_models.observations import TruePeople, observed
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.recordings import Recording
from tracker.recordings.calibration_feet import CalibrationCase
from tracker.recordings.calibration_timing import delays_among
from tracker.recordings.clock_offsets import estimated_offsets, parsed_offsets, with_offsets
from tracker.recordings.clocks import TOGETHER, CameraClock, Schedule
from tracker.recordings.degradation import Degradation, degraded_boxes, projected_boxes
from tracker.recordings.folder import read_recording, write_recording
from tracker.sequence.results import Results

RATE = 20.0
OWN = {"C2": CameraClock(0.1, 5.0), "C3": CameraClock(stamps={f: f / RATE for f in range(120) if f % 10 != 3 and not 40 <= f < 80})}
"""One camera at 5 frames/s, 0.1 s late; one that loses a tenth of its frames, and freezes for 2 s."""


def fast_room() -> Recording:
    """Four people who walk 1.2 m/s, 20 frames/s."""
    room = walked_room(people=4, frames=120, speed=1.2 * 4 / RATE)
    return Recording(RATE, room.cameras, room.detections, room.truth, area=room.area)


def with_clocks(room: Recording, clocks: dict[str, CameraClock]) -> Recording:
    """The room whose cameras take their frames at other times: boxes are those of the frame at that time."""
    detections = dict(room.detections)
    for name, clock in clocks.items():
        at = {f: round(clock.time(f, RATE) * RATE) for f in clock.frames(room.frames / RATE, RATE)}
        detections[name] = {f: room.detections[name][k] for f, k in at.items()}
    return replace(room, detections=detections, clocks=clocks)


def mota(room: Recording, delay: int = 0) -> float:
    sequence = room.sequence()
    estimates = list(track(sequence.setup, sequence.ticks, Parameters(delay=delay)))
    assert [one.index for one in estimates] == list(range(room.frames))
    return float(evaluate(sequence, Results.of(estimates, run={}))["targets"]["mota"])


def test_cameras_with_clocks_of_their_own_follow_people_as_cameras_in_step_do() -> None:
    room, delay = fast_room(), 5
    apart = with_clocks(room, OWN | {"C2": CameraClock(0.2, 5.0)})
    assert mota(apart, delay) > mota(room, delay) - 0.02
    # Without its times the slow camera's boxes are those of other moments.
    pair = ["C2", "C3"]
    assert mota(apart.choose(pair), delay) > mota(room.choose(pair), delay) - 0.02
    assert mota(replace(apart, clocks={}).choose(pair), delay) < mota(room.choose(pair), delay) - 0.1


def test_cameras_in_step_make_a_tick_of_each_frame() -> None:
    names = dict.fromkeys(("A", "B"), False)
    ticks = Schedule(7.0, 30, {}, names).ticks()
    assert [(t.time, t.frame, t.reported, t.frames) for t in ticks] == [(k / 7, k, True, {"A": k, "B": k}) for k in range(30)]
    # Clocks that say the same make the same.
    assert Schedule(7.0, 30, {"A": CameraClock(), "B": CameraClock(rate=7.0)}, names).ticks() == ticks


def test_each_view_and_each_frame_is_in_one_tick() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        stamps = {f: float(t) for f, t in enumerate(np.cumsum(rng.uniform(0.002, 0.2, 40))) if rng.random() < 0.8}
        # An offset of just half a period is on the edge between two ticks.
        first = CameraClock(3 / 7 + 0.5 / 7, 7.0) if rng.random() < 0.2 else CameraClock(rng.uniform(-0.3, 0.3), rng.uniform(2, 30))
        clocks = {"A": first, "B": CameraClock(stamps=stamps)}
        plan = Schedule(7.0, 30, clocks, dict.fromkeys(("A", "B", "C"), False))
        ticks = plan.ticks()
        assert all(b.time > a.time and (b.frame > a.frame if a.reported else b.frame >= a.frame) for a, b in itertools.pairwise(ticks))
        assert [t.frame for t in ticks if t.reported] == list(range(30))
        seen = Counter((name, f) for t in ticks for name, f in t.frames.items())
        assert set(seen.values()) == {1}
        # After the last frame, only the view that is nearest to it has a tick.
        of_b, last = {f for name, f in seen if name == "B"}, float(plan.times[-1])
        assert {f for f in of_b if stamps[f] <= last} == {f for f, time in stamps.items() if time <= last}
        assert [f for f in of_b if stamps[f] > last] in ([], [min((f for f in stamps if stamps[f] > last), default=None)])
        off = [clocks[name].time(f, 7.0) - t.time - t.later.get(name, 0.0) for t in ticks for name, f in t.frames.items() if name in clocks]
        assert np.abs(off).max() <= TOGETHER
        assert max(abs(later) for t in ticks for later in t.later.values()) <= 0.5 / 7 + 1e-6


def test_a_late_view_is_in_the_tick_of_the_nearest_frame() -> None:
    """At 7 frames/s a view that is 0.06 s late; at 2 frames/s one that is 0.2 s late has a tick of its own."""
    names = dict.fromkeys(("A", "B"), False)
    near, far = (Schedule(rate, 3, {"B": CameraClock(offset)}, names).ticks() for rate, offset in ((7.0, 0.06), (2.0, 0.2)))
    assert [(t.frames, t.later) for t in near] == [({"A": k, "B": k}, {"B": 0.06}) for k in range(3)]
    assert [(t.frames, t.reported) for t in far] == [({"A": 0}, True), ({"B": 0}, False), ({"A": 1}, True), ({"B": 1}, False), ({"A": 2}, True)]
    assert not any(t.later for t in far)


def test_frames_of_a_lone_camera_are_at_its_stamps() -> None:
    stamps = {0: 0.0, 1: 0.04, 2: 0.3, 5: 0.5}
    lone = Recording(25.0, {"C1": walked_room().cameras["C1"]}, {"C1": {}}, clocks={"C1": CameraClock(stamps=stamps)}, frames=6)
    ticks = lone.schedule.ticks()
    assert {t.frame: t.time for t in ticks if t.frames} == pytest.approx(stamps, abs=1e-5)
    assert all(t.reported for t in ticks)
    assert len(ticks) == 6


def test_a_chosen_camera_with_stamps_keeps_the_frames_of_the_recording() -> None:
    """C1 is faster than the recording; alone, it is not all cameras."""
    room = walked_room(people=2, frames=20)
    fast = {f: f / 12 for f in range(58)}
    boxes = {f: room.detections["C1"][f // 3] for f in fast}
    apart = replace(room, detections={**room.detections, "C1": boxes}, clocks={"C1": CameraClock(stamps=fast)}, stamps=None)
    alone = apart.choose(["C1"])
    assert alone.frames == 20
    assert alone.schedule.times.tolist() == apart.schedule.times.tolist()
    assert {t.frame: t.frames["C1"] for t in alone.schedule.ticks() if t.reported} == {k: 3 * k for k in range(20)}


def test_frames_stay_at_shared_stamps_where_a_camera_is_late() -> None:
    """All cameras take frames 0.3 s apart, with a break of 5 s, in a recording of 4 frames/s."""
    room = walked_room(people=2, frames=20)
    stamps = {f: 0.3 * f + 5.0 * (f >= 10) for f in range(20)}
    shared = replace(room, clocks=dict.fromkeys(room.cameras, CameraClock(stamps=stamps)), stamps=None)
    late = with_offsets(shared, {"C2": 0.1})
    assert late.frames == 21
    assert late.schedule.times[:20].tolist() == pytest.approx(list(stamps.values()), abs=1e-4)
    assert [t.later["C2"] for t in late.schedule.ticks() if t.frame < 20] == pytest.approx([0.1] * 20, abs=1e-4)
    part = late.cut(5, 15)
    assert part.schedule.times.tolist() == pytest.approx([stamps[f] - stamps[5] for f in range(5, 15)], abs=1e-4)
    assert part.truth_of("C1") == part.truth


def test_a_part_with_a_late_camera_holds_its_last_view() -> None:
    late = replace(walked_room(people=2, frames=20), frames=0, clocks={"C2": CameraClock(0.1)})
    part = late.cut(5, 15)
    assert part.frames == 10
    assert sorted(part.detections["C2"]) == list(range(10))


def test_odometry_of_a_robot_is_that_of_its_frame() -> None:
    """Stamps of two robots jitter: frame k of a robot is in a tick of frame k, which is reported after both."""
    stamps = [{k: k / 4 + 0.03 * ((k * m) % 5) for k in range(12)} for m in (1, 2)]
    clocks = {name: CameraClock(stamps=of) for name, of in zip("AB", stamps, strict=True)}
    ticks = Schedule(4.0, 12, clocks, {"A": True, "B": True}).ticks()
    assert all(f == t.frame for t in ticks for f in t.frames.values())
    assert [t.frame for t in ticks if t.reported] == list(range(12))


def test_times_are_written_and_read(tmp_path: Path) -> None:
    room = with_clocks(fast_room(), OWN)
    write_recording(tmp_path, room)
    again = read_recording(tmp_path)
    assert again.frames == room.frames
    for name, clock in OWN.items():
        assert vars(again.clocks[name]) == vars(clock)
    ticks, others = (list(one.sequence().ticks) for one in (room, again))
    assert [(t.time, t.index, [(v.camera, len(v.detections)) for v in t.views]) for t in ticks] == [
        (t.time, t.index, [(v.camera, len(v.detections)) for v in t.views]) for t in others
    ]
    # A part begins at time 0 with the frames of that part.
    part = again.cut(20, 60)
    whole = [(t.time - 1.0, t.index - 20, [v.camera for v in t.views]) for t in ticks if 20 <= t.index < 60]
    assert [(pytest.approx(t.time, abs=1e-9), t.index, [v.camera for v in t.views]) for t in part.sequence().ticks] == whole


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("C9,1,0.0", "times.csv:2: camera is 'C9', needs one of C1, C2, C3, C4"),
        ("C1,0,0.0", "times.csv:2: C1 has frame 0 at 0 s"),
        ("C1,1,0.0\nC1,1,0.1", "times.csv:3: C1 has frame 1 at 0.1 s, needs each frame once"),
        ("C1,1,0.5\nC1,2,0.4", "times.csv:3: C1 has frame 2 at 0.4 s, and 1 at 0.5 s; times must grow"),
        ("C1,1,0.5", "C1 has data in frame 2, for which times.csv has no row"),
    ],
)
def test_wrong_times_are_one_line(tmp_path: Path, rows: str, words: str) -> None:
    write_recording(tmp_path, walked_room(people=3, frames=2))
    (tmp_path / "times.csv").write_text(f"camera,frame,time_s\n{rows}\n")
    with pytest.raises(ValueError, match=re.escape(words)):
        read_recording(tmp_path)


@pytest.mark.parametrize("late", [1, -1])
def test_offsets_of_clocks_are_found_and_applied(late: int) -> None:
    room = walked_room(people=6)
    boxes = {f - late: b for f, b in room.detections["C2"].items() if 0 <= f - late < room.frames}
    wrong = replace(room, detections={**room.detections, "C2": boxes})
    found = estimated_offsets(wrong)
    assert found == {"C2": pytest.approx(late / 4, abs=0.05)}
    assert estimated_offsets(room) == estimated_offsets(with_offsets(wrong, {"C2": late / 4})) == {}
    mended = with_offsets(wrong, parsed_offsets(f"C2={late / 4}", list(room.cameras)))
    assert mended.frames >= room.frames
    assert mended.clocks["C2"].time(0, 4.0) == late / 4
    assert len(list(mended.sequence().ticks)) >= room.frames


def test_parts_of_a_frame_that_a_clock_tells_are_no_delay() -> None:
    whole = walked_room(frames=480, speed=0.8)

    def third(of: Mapping[int, Any], first: int) -> dict[int, Any]:
        return {(frame - first) // 3: value for frame, value in of.items() if frame >= first and (frame - first) % 3 == 0}

    assert whole.truth is not None
    boxes = {name: third(of, int(name == "C2")) for name, of in whole.detections.items()}
    room = replace(whole, rate=whole.rate / 3, detections=boxes, truth=third(whole.truth, 0))
    assert abs(estimated_offsets(room)["C2"] - 1 / whole.rate) < 0.05
    known = replace(room, clocks={"C2": CameraClock(offset=1 / whole.rate)})
    assert max(abs(delay.frames) for delay in delays_among(CalibrationCase.of(known)).values()) < 0.1
    assert not any(estimated_offsets(known).values())


def test_boxes_are_projected_and_degraded_at_the_times_of_each_camera() -> None:
    """A camera at 5 frames/s, 0.1 s late, sees the places of every fourth frame from the second on; one without stamps for a frame has no box."""
    room = fast_room()
    exact, own = projected_boxes(room), projected_boxes(replace(room, detections={}, clocks=OWN))
    assert sorted(own.detections["C2"]) == list(range(30))
    assert sorted(own.detections["C3"]) == sorted(OWN["C3"].stamps or {})
    for frame, (boxes, _) in own.detections["C2"].items():
        np.testing.assert_allclose(boxes, exact.detections["C2"][4 * frame + 2][0])
    # Between frames of the truth, places are interpolated.
    half = replace(room, detections={}, clocks={"C2": CameraClock(0.5 / RATE)})
    places = half.truth_of("C2")[7][1]
    np.testing.assert_allclose(places, ((room.truth or {})[7][1] + (room.truth or {})[8][1]) / 2)
    worse = degraded_boxes(own, Degradation(drop=0.5), 1)
    assert {name: len(of) for name, of in worse.detections.items()} == {"C1": 120, "C2": 30, "C3": len(OWN["C3"].stamps or {}), "C4": 120}


def test_frames_without_a_picture_are_no_misses_of_a_detector() -> None:
    room = fast_room()
    apart = with_clocks(room, OWN).in_step()
    shown = {name: [one.frame for one in observed(apart, TruePeople(apart.truth or {}, {})) if one.camera == name] for name in room.cameras}
    assert {name: len(frames) for name, frames in shown.items()} == {"C1": 120, "C2": 30, "C3": len(OWN["C3"].stamps or {}), "C4": 120}
