"""The whole tracker, a tick at a time: robots place themselves, boxes become feet on the ground, feet become people.

`track` is told the setup once and is then handed ticks; it is never handed the truth, and what it says of a tick depends on that
tick and those before it. A fixed camera is a robot that never moves; nothing here tells PETS 2009 from the simulator.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from tracker.fusion import stand
from tracker.geometry import Array
from tracker.hypotheses import Hypotheses, TargetParameters
from tracker.measurements import Estimate, Ints, Setup, Tick
from tracker.slam import Slam, SlamParameters
from tracker.trees import Tracks


@dataclass(frozen=True)
class Parameters:
    """All that can be set, by part."""

    slam: SlamParameters = field(default_factory=SlamParameters)
    targets: TargetParameters = field(default_factory=TargetParameters)


def track(setup: Setup, ticks: Iterable[Tick], parameters: Parameters | None = None) -> Iterator[Estimate]:
    """One Estimate a tick, as soon as the tick has come.

    Raises ValueError where a tick names a camera that the setup does not have, or comes before the one that was handed in last.
    """
    tracker = Tracker(setup, parameters or Parameters())
    for tick in ticks:
        yield tracker.step(tick)


class Tracker:
    """The state between ticks: the SLAM filter of the team, and the hypotheses on people."""

    def __init__(self, setup: Setup, parameters: Parameters) -> None:
        self.setup, self.parameters = setup, parameters
        self.slam = Slam(setup, parameters.slam)
        self.hypotheses = Hypotheses(setup, parameters.targets)
        self._names = _Names(setup)
        self._last = -1

    def step(self, tick: Tick) -> Estimate:
        self._check(tick)
        self.slam.step(tick)
        poses = {robot: (self.slam.pose(robot), self.slam.covariance(robot)) for robot in self.setup.starts}
        feet, cameras = [], []
        for view in tick.views:
            mount = self.setup.mounts[view.camera]
            pose = poses[mount.robot]
            feet.append(stand(self.setup, view.camera, view.detections, pose, self.parameters.targets.fusion))
            cameras.append((mount.camera, pose[0] @ mount.T_body_camera))
        people = self.hypotheses.step(feet, cameras)
        ids, position, covariance = self._names.report(people)
        return Estimate(
            tick.index,
            {robot: pose for robot, (pose, _) in poses.items()},
            {robot: P for robot, (_, P) in poses.items()},
            ids,
            position,
            covariance,
            dict(self.slam.counters),
        )

    def _check(self, tick: Tick) -> None:
        if tick.index <= self._last:
            raise ValueError(f"tick {tick.index} comes after tick {self._last}, needs growing indices")
        for view in tick.views:
            if view.camera not in self.setup.mounts:
                raise ValueError(f"tick {tick.index} has a view of camera {view.camera!r}, setup has {', '.join(self.setup.mounts)}")
        self._last = tick.index


class _Names:
    """Ids of people as they are reported: the id of the tree, and a new one for who left the area and came back."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._name: dict[int, int] = {}
        self._outside: dict[int, int] = {}
        self._next = 1

    def report(self, people: Tracks) -> tuple[Ints, Array, Array]:
        """Ids (k,), places on the ground (k, 3) m and covariances (k, 3, 3) of the people in the area."""
        place = people.state[:, :2]
        inside = np.ones(len(people), dtype=bool)
        if self.setup.area is not None:
            inside = ((place >= self.setup.area[0]) & (place <= self.setup.area[1])).all(axis=1)
        for tree, here in zip(people.tree.tolist(), inside, strict=True):
            self._outside[tree] = 0 if here else self._outside.get(tree, 0) + 1
            if tree not in self._name or (self._outside[tree] == 2 and self._name[tree]):
                # 0 marks a tree that has to be named anew when it comes in.
                self._name[tree] = 0
            if here and not self._name[tree]:
                self._name[tree], self._next = self._next, self._next + 1
        chosen = people.select(inside)
        covariance = np.zeros((len(chosen), 3, 3))
        covariance[:, :2, :2] = chosen.covariance[:, :2, :2]
        ids = np.array([self._name[tree] for tree in chosen.tree.tolist()], dtype=np.int64)
        return ids, np.column_stack([chosen.state[:, :2], self.setup.ground.height_at(chosen.state[:, :2])]), covariance
