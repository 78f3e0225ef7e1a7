"""The times of the frames of cameras, and the ticks that follow. A tick is a time with the views of about that time.

A camera has its own rate, offset or stamps, or it is in step with the frames of the recording. These frames have the rate of the recording; truth,
odometry and results count them. Where cameras on robots have stamps, or all cameras of the recording the same, frames are at these times instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tracker.geometry import Array
from tracker.io.csv_tables import read_numbered_table, write_table
from tracker.io.json_files import JsonObject
from tracker.io.video_files import packet_times
from tracker.sequence.calibration import MAX_RATE, MIN_RATE
from tracker.types.ticks import ROUNDING

FILE = "times.csv"
COLUMNS = {"camera": str, "frame": int, "time_s": float}
TOGETHER = 0.01
"""s: views within this time are one tick. People walk 2 cm meanwhile, less than the error of any box."""
NEAR = 0.15
"""s: the view of a fixed camera nearest to a frame is in its tick, if within this time. People are predicted to the time of the view.

Walking people start and turn within some 0.5 s. Views of one tick are associated with each other; views of two ticks are not.
"""
LONGEST = 1e7
"""s: largest size of a time."""


@dataclass(frozen=True, eq=False)
class CameraClock:
    """The times of the frames of a camera.

    stamps: frame from 0 → s; the camera has no other frames. Where it is None, frame f is at offset s + f / rate; rate None: that of the recording.
    """

    offset: float = 0.0
    rate: float | None = None
    stamps: Mapping[int, float] | None = None

    def __post_init__(self) -> None:
        if self.rate is not None and not MIN_RATE <= self.rate <= MAX_RATE:
            raise ValueError(f"rate is {self.rate}, needs {MIN_RATE:g} to {MAX_RATE:g} frames/s")
        if not abs(self.offset) <= LONGEST:
            raise ValueError(f"offset is {self.offset} s, needs at most {LONGEST:g} in size")
        if self.stamps is None:
            return
        times = [self.stamps[frame] for frame in sorted(self.stamps)]
        if not times or not all(abs(time) <= LONGEST for time in times) or (np.diff(times) <= 0).any():
            raise ValueError(f"stamps are {str(times)[:60]}, needs at least one, growing with the frames, and at most {LONGEST:g} s in size")

    def time(self, frame: int, rate: float) -> float:
        """s of a frame from 0; rate: of the recording. Raises KeyError for a frame without a stamp."""
        return self.stamps[frame] if self.stamps is not None else self.offset + frame / (self.rate or rate)

    def frames(self, end: float, rate: float) -> Iterable[int]:
        """The frames before `end` s, of a recording of that rate."""
        if self.stamps is not None:
            return sorted(frame for frame, time in self.stamps.items() if time < end)
        return range(max(0, int(np.ceil((end - self.offset) * (self.rate or rate) - ROUNDING))))

    def period(self, rate: float) -> float:
        """Usual time between frames, s; 0 where it is that of a recording of `rate` frames/s."""
        if self.stamps is None:
            usual = 1 / (self.rate or rate)
        else:
            frames = sorted(self.stamps)
            usual = float(np.median(np.diff([self.stamps[f] for f in frames]) / np.diff(frames))) if len(frames) > 1 else 1 / rate
        return 0.0 if abs(usual * rate - 1) < SAME else usual

    def later(self, seconds: float) -> CameraClock:
        """The clock with all times later by `seconds`."""
        if self.stamps is None:
            return replace(self, offset=self.offset + seconds)
        return replace(self, stamps={frame: time + seconds for frame, time in self.stamps.items()})


SAME = 0.02
"""Relative difference of the rates of two cameras in step that jitter of stamps may cause."""


class TickViews(NamedTuple):
    """The content of a tick: time s, frame and `reported` as in Tick. frames: camera → its own frame. later: camera → s after the tick."""

    time: float
    frame: int
    reported: bool
    frames: dict[str, int]
    later: dict[str, float]


@dataclass(frozen=True, eq=False)
class Schedule:
    """The ticks of cameras with clocks. rate: of the recording; frames: how many it has; robots: camera → whether a robot carries it.

    stamps: as in Recording. The frames of cameras on robots are those of the recording, as odometry belongs to them.
    """

    rate: float
    frames: int
    clocks: Mapping[str, CameraClock]
    robots: Mapping[str, bool]
    stamps: Mapping[int, float] = field(default_factory=dict)
    times: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", self._frame_times())

    def _frame_times(self) -> Array:
        """Times (frames,) s of the frames of the recording."""
        regular, anchors = np.arange(self.frames) / self.rate, dict[int, float]()
        carried = [name for name, on_robot in self.robots.items() if on_robot and name in self.clocks]
        for name in carried:
            for frame, time in (self.clocks[name].stamps or {}).items():
                anchors[frame] = max(time, anchors.get(frame, time))
        if not carried:
            anchors = dict(self.stamps)
        known = np.array(sorted(frame for frame in anchors if frame < self.frames), dtype=np.int64)
        if not len(known):
            return regular
        # Between frames with stamps, time passes evenly. Stamps of two robots may overtake each other by less than a frame.
        late = np.interp(np.arange(self.frames), known, [anchors[frame] - regular[frame] for frame in known.tolist()])
        least = 1e-6 * np.arange(self.frames)
        return np.asarray(np.maximum.accumulate(regular + late - least) + least)

    def ticks(self) -> list[TickViews]:
        """All ticks in order. A tick never has two views of one camera, nor two frames of the recording."""
        events: list[Event] = [Event(float(time), "", k) for k, time in enumerate(self.times)]
        for name, on_robot in self.robots.items():
            clock = self.clocks.get(name)
            if clock is None:
                events += [event._replace(camera=name) for event in events[: self.frames]]
            elif on_robot:
                events += [Event(clock.time(f, self.rate), name, f) for f in clock.frames(self.end, self.rate) if f < self.frames]
            else:
                events += self._views(name, clock)
        order = {name: k for k, name in enumerate(("", *self.robots))}
        events.sort(key=lambda event: (event.time, order[event.camera]))
        groups: list[list[Event]] = []
        for event in events:
            if groups and event.time - groups[-1][0].time <= TOGETHER and all(_may_share(event, other) for other in groups[-1]):
                groups[-1].append(event)
            else:
                groups.append([event])
        out: list[TickViews] = []
        for group in groups:
            out.append(self._tick(group, out[-1].frame + out[-1].reported if out else 0))
        return out

    @property
    def end(self) -> float:
        """The time, s, before which all views are."""
        return float(self.times[-1]) + near_frame(self.rate) + 1e-9 if self.frames else 0.0

    def nearest(self, name: str, within: float) -> dict[int, tuple[int, float]]:
        """Own frame of a camera with a clock → the frame of the recording to which it is nearest, and its delay after it, s.

        Own frames that are farther than `within` s from any frame of the recording are left out.
        """
        found = dict[int, tuple[int, float]]()
        if not self.frames:
            return found
        own = list(self.clocks[name].frames(float(self.times[-1]) + within + 1e-9, self.rate))
        times = np.array([self.clocks[name].time(frame, self.rate) for frame in own])
        for frame, time, k in zip(own, times, np.searchsorted((self.times[1:] + self.times[:-1]) / 2, times).tolist(), strict=True):
            apart = float(time - self.times[k])
            if abs(apart) <= within and abs(apart) < abs(found.get(k, (0, np.inf))[1]):
                found[k] = frame, apart
        return {frame: (k, apart) for k, (frame, apart) in found.items()}

    def _views(self, name: str, clock: CameraClock) -> Iterable[Event]:
        """The views of a fixed camera, both in the ticks of frames and between frames."""
        at = self.nearest(name, near_frame(self.rate))
        for frame in clock.frames(self.end, self.rate):
            time = clock.time(frame, self.rate)
            if frame in at:
                k, apart = at[frame]
                yield Event(float(self.times[k]), name, frame, round(apart, 6))
            elif time < self.times[-1]:
                yield Event(time, name, frame, between=True)

    def _tick(self, group: list[Event], following: int) -> TickViews:
        """following: the first frame that is not reported yet."""
        of = {event.camera: event for event in group}
        seen = {name: of[name] for name in self.robots if name in of}
        frames, later = {name: event.frame for name, event in seen.items()}, {name: event.later for name, event in seen.items() if event.later}
        if "" in of:
            return TickViews(of[""].time, of[""].frame, True, frames, later)
        on_robot = [k for name, k in frames.items() if self.robots[name]]
        return TickViews(group[0].time, max([following, *on_robot]), False, frames, later)


def near_frame(rate: float) -> float:
    """Largest time, s, between a frame of a recording and the views of fixed cameras in its tick."""
    return max(min(NEAR, 0.5 / rate), TOGETHER)


class Event(NamedTuple):
    """A view of a camera, or a frame of the recording, whose `camera` is "".

    time: s of the tick; later: s from it to the view. between: whether it is in no tick of a frame.
    """

    time: float
    camera: str
    frame: int
    later: float = 0.0
    between: bool = False


def _may_share(event: Event, other: Event) -> bool:
    """Whether two events may be in one tick."""
    return event.camera != other.camera and not ("" in (event.camera, other.camera) and (event.between or other.between))


def read_times(file: Path, cameras: Iterable[str]) -> dict[str, CameraClock]:
    """The clocks of times.csv. Raises ValueError with file and line for other columns, unknown cameras, doubled frames, times that do not grow."""
    known, found, last = list(cameras), dict[str, dict[int, float]](), dict[str, int]()
    lines, table = read_numbered_table(file, COLUMNS)
    for line, name, frame, time in zip(lines, *(table[column].tolist() for column in COLUMNS), strict=True):
        stamps = found.setdefault(name, {})
        if name not in known:
            raise ValueError(f"{file}:{line}: camera is {name[:40]!r}, needs one of {', '.join(known)}")
        if frame < 1 or frame - 1 in stamps or not abs(time) <= LONGEST:
            raise ValueError(f"{file}:{line}: {name} has frame {frame} at {time:g} s, needs each frame once, from 1, and times in s")
        before = last.get(name, frame - 1)
        if before < frame - 1 and not time > stamps[before]:
            raise ValueError(f"{file}:{line}: {name} has frame {frame} at {time:g} s, and {before + 1} at {stamps[before]:g} s; times must grow")
        stamps[frame - 1], last[name] = time, frame - 1
    out = {}
    for name, stamps in found.items():
        try:
            out[name] = CameraClock(stamps=stamps)
        except ValueError as error:
            raise ValueError(f"{file}: {name}: {error}") from None
    return out


def write_times(file: Path, clocks: Mapping[str, CameraClock]) -> None:
    """Write times.csv with the cameras that have stamps; read_times reads the same."""
    stamped = [(name, clock.stamps) for name, clock in clocks.items() if clock.stamps is not None]
    write_table(file, list(COLUMNS), [[name, frame + 1, time] for name, stamps in stamped for frame, time in sorted(stamps.items())])


def clock_fields(clock: CameraClock | None) -> dict[str, float]:
    """The fields of a camera's entry in recording.json that clock_from reads; none for a clock with stamps."""
    if clock is None or clock.stamps is not None:
        return {}
    return {"offset_s": clock.offset} | ({} if clock.rate is None else {"rate": clock.rate})


def uneven_clock(video: Path, boxes: Iterable[int] = ()) -> CameraClock | None:
    """The clock of a video by its stamps, where an interval differs from the usual one by more than UNEVEN; else None. No image is decoded.

    boxes: frames with boxes. Those after the end of the video, which `pilsim check` reports, follow at the usual interval.
    """
    times = packet_times(video)
    steps = np.diff(times)
    if len(steps) < 2 or not (steps > 0).all() or np.abs(steps / np.median(steps) - 1).max() <= UNEVEN:
        return None
    last, end = len(steps), float(times[-1] - times[0])
    after = {frame: end + (frame - last) * float(np.median(steps)) for frame in boxes if frame > last}
    return CameraClock(stamps=dict(enumerate((times - times[0]).tolist())) | after)


UNEVEN = 0.5
"""Share of the usual interval between frames: stamps of containers are rounded to some ms."""


def clock_from(entry: Mapping[str, Any], where: str) -> CameraClock | None:
    """The clock of a camera's entry in recording.json by its `rate` and `offset_s`; None without both."""
    fields = JsonObject(dict(entry), where)
    if entry.get("offset_s") is None and entry.get("rate") is None:
        return None
    offset = fields.number("offset_s", -LONGEST, LONGEST, "seconds") if entry.get("offset_s") is not None else 0.0
    return CameraClock(offset, fields.number("rate", MIN_RATE, MAX_RATE, "frames/s") if entry.get("rate") is not None else None)
