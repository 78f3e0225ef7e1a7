"""A part of a sequence: some of its cameras, some of its frames, and other detections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from tracker.datasets.source_options import SourceOptions, camera_named
from tracker.detections.boxes import detections_from_boxes
from tracker.recordings import FrameBoxes
from tracker.recordings.folder import read_boxes
from tracker.types import Odometry, RobotDetections, Sequence, Setup, Tick, Ticks, Truth, View


@dataclass(frozen=True, eq=False)
class SelectedTicks:
    """Ticks from `first` to `end` − 1 with the cameras of `setup` alone. detections: camera → boxes that replace its own."""

    ticks: Ticks
    setup: Setup
    first: int
    end: int
    detections: dict[str, FrameBoxes]

    def __len__(self) -> int:
        return self.end - self.first

    def __iter__(self) -> Iterator[Tick]:
        for tick in islice(self.ticks, self.first, self.end):
            views = tuple(self._view(view, tick.index) for view in tick.views if view.camera in self.setup.mounts)
            index = tick.index - self.first
            yield Tick(index, index * self.setup.period, views)

    def _view(self, view: View, frame: int) -> View:
        seen = view.robot_detections
        kept = [] if seen is None else [k for k, robot in enumerate(seen.robot) if robot in self.setup.starts]
        if seen is not None and len(kept) < len(seen.robot):
            left = RobotDetections(seen.bearing[kept], tuple(seen.robot[k] for k in kept), seen.covariance[kept])
            view = replace(view, robot_detections=left)
        if view.camera not in self.detections:
            return view
        boxes, confidence = self.detections[view.camera].get(frame, (np.zeros((0, 4)), np.zeros(0)))
        return replace(view, detections=detections_from_boxes(self.setup.mounts[view.camera].camera, boxes, confidence))

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for moved in islice(self.ticks.odometry(), self.first, self.end):
            yield {robot: odometry for robot, odometry in moved.items() if robot in self.setup.starts}


def selected(sequence: Sequence, options: SourceOptions) -> Sequence:
    """The part of a sequence that `options` choose; the same sequence where they choose all of it.

    Raises ValueError for a camera that is not there, frames that are not there, and a first frame that is not 0 where robots move.
    """
    if not options.cameras and options.frames is None and not options.detections:
        return sequence
    mounts = sequence.setup.mounts
    names = [camera_named(text, mounts) for text in options.cameras] or list(mounts)
    kept = {name: mounts[name] for name in mounts if name in names}
    carriers = {mount.robot for mount in kept.values()}
    setup = replace(sequence.setup, mounts=kept, starts={name: start for name, start in sequence.setup.starts.items() if name in carriers})
    first, end = options.frames or (0, None)
    end = len(sequence.ticks) if end is None else min(end, len(sequence.ticks))
    if not 0 <= first < end:
        raise ValueError(f"--frames begins at {first}, needs a first frame below {len(sequence.ticks)}, all that the sequence has")
    if first and setup.moving_robots:
        raise ValueError(f"--frames begins at {first}, needs 0 where robots move, since their start is known at frame 0 alone")
    detections: dict[str, FrameBoxes] = {name: read_boxes(file) for name, file in options.detection_files(list(kept)).items()}
    columns = [list(mounts).index(name) for name in kept]
    truth = None if sequence.truth is None else tuple(_of_truth(t, t.index - first, setup, columns) for t in sequence.truth[first:end])
    provenance = sequence.provenance | {"cameras": list(kept), "frames": [first, end]}
    return Sequence(setup, SelectedTicks(sequence.ticks, setup, first, end, detections), truth, provenance)


def _of_truth(truth: Truth, index: int, setup: Setup, columns: list[int]) -> Truth:
    poses = {robot: pose for robot, pose in truth.T_world_robot.items() if robot in setup.starts}
    return replace(truth, index=index, T_world_robot=poses, visible=truth.visible[:, columns], tipped=truth.tipped & poses.keys())
