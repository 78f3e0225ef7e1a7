"""The whole tracker, tick by tick: SLAM of the robots, projection of boxes to the ground, tracking of people.

`track` takes the setup once and then ticks, never the truth. The estimate of a frame depends on the ticks up to it, and up to the frame `delay`
frames after it. A fixed camera is a robot that never moves. Nothing here distinguishes PETS 2009 from the simulator.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from tracker.detections.front_end import FrontEnd, ImageParameters
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.detections.rejections import BOXES, NO_POSE, count_rejections
from tracker.geometry import Array, Pose
from tracker.mht.global_hypothesis import CliqueSolver, written_to
from tracker.mht.tracker import MhtTracker
from tracker.reading_ahead import ahead
from tracker.slam.filter import Slam
from tracker.slam.image_features import ImageFeatures
from tracker.slam.parameters import SlamParameters
from tracker.tracks.attitude import corrected_pose
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.tracks import TrackIds, Tracks
from tracker.types import Estimate, Setup, Tick


@dataclass(frozen=True)
class Parameters:
    """The parameters of all parts."""

    slam: SlamParameters = field(default_factory=lambda: SlamParameters().with_odometry_biases())  # with wheel slip and gyroscope bias
    targets: MhtParameters = field(default_factory=MhtParameters)
    images: ImageParameters = field(default_factory=ImageParameters)  # what is extracted from images beside boxes
    delay: int = 0  # frames of the fixed-lag smoother, by which estimates are late
    graphs: Path | None = None  # folder into which every graph of leaves is written with the clique that was chosen


def track(
    setup: Setup, ticks: Iterable[Tick], parameters: Parameters | None = None, threads: int = 1, solver: CliqueSolver | None = None
) -> Iterator[Estimate]:
    """One Estimate for each frame, `delay` frames later: for each tick that is `reported`.

    threads: with two or more, reading of a tick, search in the images of an earlier tick, and localization run in threads of their own.
    The estimates do not depend on it. Up to six ticks are in memory then.
    solver: of the graphs of leaves, by default `proved_cliques`.
    Raises ValueError where a tick has a camera that the setup does not have, and where indices of frames or times do not grow.
    """
    parameters = parameters or Parameters()
    with ExitStack() as stack:
        if threads == 1:
            tracker = Tracker(setup, parameters, solver=solver)
            placed: Iterable[PlacedTick] = map(tracker.place, map(tracker.search, ticks))
        else:
            tracker = Tracker(setup, parameters, stack.enter_context(ThreadPoolExecutor(threads)), solver)
            searched = stack.enter_context(ahead(map(tracker.search, stack.enter_context(ahead(ticks)))))
            placed = stack.enter_context(ahead(map(tracker.place, searched)))
        for tick in placed:
            if estimate := tracker.follow(tick):
                yield estimate
        while estimate := tracker.finish():
            yield estimate


@dataclass(frozen=True, eq=False)
class PlacedTick:
    """A tick with the robots' poses in `estimate`, and the boxes of fixed cameras on the ground with the viewpoint of each.

    moving: T_world_robot of the moving robots, with the covariance (6, 6) of its right tangent.
    """

    tick: Tick
    estimate: Estimate
    feet: list[GroundDetections]
    cameras: list[Viewpoint]
    moving: dict[str, tuple[Pose, Array]]


class Tracker:
    """The state between ticks: the SLAM filter of the team, and the tracker of people."""

    def __init__(self, setup: Setup, parameters: Parameters, threads: ThreadPoolExecutor | None = None, solver: CliqueSolver | None = None) -> None:
        """threads: work on the views of a tick side by side."""
        targets = parameters.targets.over(setup)
        self.setup, self.parameters = setup, parameters
        self.slam, self._features = Slam(setup, parameters.slam), ImageFeatures(setup, parameters.slam.features, threads)
        self._front_end = FrontEnd(setup, targets.fusion, parameters.images, threads)
        solver = solver if parameters.graphs is None else written_to(parameters.graphs, solver)
        self._people = MhtTracker(self._front_end.setup, targets, parameters.delay, solver)
        self._track_ids = TrackIds(setup)
        self._waiting: deque[tuple[float, Estimate]] = deque()  # with the times of their frames, s
        self._rejections: Counter[str] = Counter()
        self._frame, self._time = -1, -math.inf

    def step(self, tick: Tick) -> Estimate | None:
        """Take a tick; the estimate of the frame `delay` frames before it, None at the start."""
        return self.follow(self.place(self.search(tick)))

    def search(self, tick: Tick) -> Tick:
        """The tick with the features of its images. This needs no pose, so it may run ahead of `place`."""
        return self._features.find(tick)

    def place(self, tick: Tick) -> PlacedTick:
        """Localize the robots at a tick with features, and place the boxes of fixed cameras. This needs nothing of the people, so it may run ahead
        of `follow`."""
        self._check(tick)
        self.slam.step(tick)
        # Robots with an unknown start have no pose until they are localized in the map of the team.
        poses = {robot: (self.slam.pose(robot), self.slam.covariance(robot)) for robot in self.setup.starts if self.slam.is_localized(robot)}
        known, covariances = {robot: pose for robot, (pose, _) in poses.items()}, {robot: P for robot, (_, P) in poses.items()}
        moving = {robot: poses.pop(robot) for robot in self.setup.moving_robots if robot in poses}
        feet, cameras = self._front_end.step(tick, poses)
        estimate = Estimate.of_robots(tick.index, known, covariances, self.slam.counters)
        return PlacedTick(tick, replace(estimate, map_snapshot=self.slam.map_snapshot(tick.index)), feet, cameras, moving)

    def follow(self, placed: PlacedTick) -> Estimate | None:
        """Follow the people at the next tick; the estimate of the frame `delay` frames before it, None at the start."""
        tick = placed.tick
        feet, cameras = self._front_end.step(tick, self._corrected(placed))
        feet, cameras = [*placed.feet, *feet], [*placed.cameras, *cameras]
        people = self._people.step(feet, cameras, tick.time, tick.reported)
        self._count_rejections(tick, feet)
        if tick.reported:
            counters = placed.estimate.counters | dict(self._rejections)
            self._waiting.append((tick.time, replace(placed.estimate, counters=counters)))
        return self._completed(people)

    def _corrected(self, placed: PlacedTick) -> dict[str, tuple[Pose, Array]]:
        """The poses of the moving robots, with the attitudes that their views show."""
        out, people = dict(placed.moving), self._people.filter
        for view in placed.tick.views:
            robot = self.setup.mounts[view.camera].robot
            if robot in out:
                expected = people.expected(placed.tick.time + view.later)
                out[robot] = corrected_pose(self.setup, out[robot], view, expected, people.parameters)
        return out

    def finish(self) -> Estimate | None:
        """The estimate of the oldest frame that is waiting, after the last tick; None where none is."""
        return self._completed(self._people.drain())

    def current(self) -> Tracks:
        """The people of the last tick by what is known so far, whatever the delay; not yet reported. Raises ValueError before the first tick."""
        return self._people.current()

    def _completed(self, people: Tracks | None) -> Estimate | None:
        """The waiting estimate with its people, None without people to report."""
        if people is None:
            return None
        time, estimate = self._waiting.popleft()
        ids, position, covariance = self._track_ids.report(people, time)
        return replace(estimate, target_id=ids, position=position, covariance=covariance)

    def _count_rejections(self, tick: Tick, feet: list[GroundDetections]) -> None:
        """Add the boxes of a tick to the counts of boxes by the gate that stops them. Silhouettes are not boxes of the input."""
        given = [f for f in feet if f.camera in self.setup.mounts]
        self._rejections.update(count_rejections(given, self.setup))
        if lost := sum(len(view.detections) for view in tick.views) - sum(len(f) for f in given):
            self._rejections.update({BOXES: lost, NO_POSE: lost})

    def _check(self, tick: Tick) -> None:
        if tick.index <= self._frame:
            raise ValueError(f"tick {tick.index} comes after tick {self._frame}, needs growing indices")
        if not tick.time > self._time:
            raise ValueError(f"tick {tick.index} is at {tick.time:.6f} s, after one at {self._time:.6f} s, needs growing times")
        for view in tick.views:
            if view.camera not in self.setup.mounts:
                raise ValueError(f"tick {tick.index} has a view of camera {view.camera!r}, setup has {', '.join(self.setup.mounts)}")
        self._time = tick.time
        if tick.reported:
            self._frame = tick.index
