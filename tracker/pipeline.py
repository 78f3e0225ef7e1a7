"""The whole tracker, a tick at a time: robots place themselves, boxes become feet on the ground, feet become people.

`track` is told the setup once and is then handed ticks; it is never handed the truth, and what it says of a tick depends on that
tick and those before it, and on as many after it as the delay has. A fixed camera is a robot that never moves; nothing here tells
PETS 2009 from the simulator.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

from tracker.detections.front_end import FrontEnd, ImageParameters
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.gnn.tracker import GnnTracker
from tracker.mht.parameters import MhtParameters
from tracker.mht.tracker import MhtTracker
from tracker.slam.filter import Slam, map_snapshot
from tracker.slam.parameters import SlamParameters
from tracker.tracks.parameters import TrackParameters
from tracker.tracks.track_ids import TrackIds
from tracker.tracks.tracks import Tracks
from tracker.types import Estimate, Setup, Tick


@dataclass(frozen=True)
class Parameters:
    """All that can be set, by part."""

    slam: SlamParameters = field(default_factory=lambda: SlamParameters().persistent())  # wheels slip for a while, gyroscopes are off for good
    targets: TrackParameters = field(default_factory=TrackParameters)
    multiple: MhtParameters | None = None  # where given, people are followed by multiple hypotheses in place of `targets`
    images: ImageParameters = field(default_factory=ImageParameters)  # what is looked for in them, beside boxes
    delay: int = 0  # ticks after which a tick is spoken of; people are smoothed by what came since


def track(setup: Setup, ticks: Iterable[Tick], parameters: Parameters | None = None) -> Iterator[Estimate]:
    """One Estimate a tick, as soon as the tick has come, or `delay` ticks later.

    Raises ValueError where a tick names a camera that the setup does not have, or comes before the one that was handed in last.
    """
    tracker = Tracker(setup, parameters or Parameters())
    for tick in ticks:
        if estimate := tracker.step(tick):
            yield estimate
    while estimate := tracker.finish():
        yield estimate


class PeopleTracker(Protocol):
    """A tracker of people: takes a tick, and tells who was there some ticks before; None where it has nothing to tell yet, or no more."""

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Tracks | None: ...

    def drain(self) -> Tracks | None: ...


class Tracker:
    """The state between ticks: the SLAM filter of the team, and the hypotheses on people."""

    def __init__(self, setup: Setup, parameters: Parameters) -> None:
        self.setup, self.parameters = setup, parameters
        self.slam = Slam(setup, parameters.slam)
        single, many, delay = parameters.targets, parameters.multiple, parameters.delay
        self._sight = FrontEnd(setup, (many or single).fusion, parameters.images)
        seen = self._sight.setup
        self._people: PeopleTracker = GnnTracker(seen, single, delay) if many is None else MhtTracker(seen, many, delay)
        self._names = TrackIds(setup)
        self._waiting: deque[Estimate] = deque()
        self._last = -1

    def step(self, tick: Tick) -> Estimate | None:
        """Take a tick; what is said of the tick `delay` ticks before it, None where there was none."""
        self._check(tick)
        self.slam.step(tick)
        # Who started where nobody knows, and has not found the team yet, is nowhere.
        poses = {robot: (self.slam.pose(robot), self.slam.covariance(robot)) for robot in self.setup.starts if self.slam.placed(robot)}
        placed, spread = {robot: pose for robot, (pose, _) in poses.items()}, {robot: P for robot, (_, P) in poses.items()}
        estimate = Estimate.of_robots(tick.index, placed, spread, dict(self.slam.counters))
        self._waiting.append(replace(estimate, chart=map_snapshot(self.slam, tick.index)))
        return self._told(self._people.step(*self._sight.step(tick, poses)))

    def finish(self) -> Estimate | None:
        """What is said of the oldest tick that is waiting, when no more ticks come; None where none is."""
        return self._told(self._people.drain())

    def _told(self, people: Tracks | None) -> Estimate | None:
        if people is None:
            return None
        ids, position, covariance = self._names.report(people)
        return replace(self._waiting.popleft(), target_id=ids, position=position, covariance=covariance)

    def _check(self, tick: Tick) -> None:
        if tick.index <= self._last:
            raise ValueError(f"tick {tick.index} comes after tick {self._last}, needs growing indices")
        for view in tick.views:
            if view.camera not in self.setup.mounts:
                raise ValueError(f"tick {tick.index} has a view of camera {view.camera!r}, setup has {', '.join(self.setup.mounts)}")
        self._last = tick.index
