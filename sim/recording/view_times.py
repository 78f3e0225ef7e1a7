"""The pictures that fixed cameras with clocks of their own take between two frames of a simulation."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from typing import final

from sim.cameras.view_clock import TimedPicture, ViewClock, parse_view_clocks
from sim.scenario import Scenario
from tracker.types import Setup


@final
class ViewTimes:
    """When the fixed cameras of a setup that are not in step with the frames take their pictures.

    pictures: camera → its pictures, those that do not arrive included. A robot stands for a fixed camera; all views of a rig are taken at once.
    """

    def __init__(self, scenario: Scenario, setup: Setup) -> None:
        self._period = scenario.period
        clocks = clocks_of(scenario, setup)
        end = (scenario.frames - 1) * scenario.period
        self.pictures = {name: clock.pictures(end, scenario.rate, scenario.stream(f"view_clock/{name}")) for name, clock in clocks.items()}
        self._by_frame: dict[int, dict[str, TimedPicture]] = defaultdict(dict)
        for name, of_camera in self.pictures.items():
            for picture in of_camera:
                self._by_frame[math.ceil(picture.time / self._period - 1e-9)][name] = picture

    def at(self, frame: int) -> Mapping[str, TimedPicture]:
        """Camera → the picture that it takes after the frame before and up to this one; cameras that are in step have none."""
        return self._by_frame.get(frame, {})

    def before(self, frame: int, picture: TimedPicture) -> float:
        """s from a picture of `at` to the frame."""
        return min(max(frame * self._period - picture.time, 0.0), self._period)


def clocks_of(scenario: Scenario, setup: Setup) -> dict[str, ViewClock]:
    """Fixed camera → its clock, of those that are not in step. Raises ValueError for a clock of a camera that is not there."""
    if not scenario.view_clock:
        return {}
    clocks = parse_view_clocks(scenario.view_clock, scenario.rate)
    fixed = {name: mount.robot for name, mount in setup.mounts.items() if setup.is_fixed(mount.robot)}
    if unknown := sorted(set(clocks) - {""} - set(fixed.values())):
        raise ValueError(f"view_clock names {unknown[0]!r}, but the fixed cameras are {', '.join(fixed) or 'none'}")
    return {name: clock for name, robot in fixed.items() if (clock := clocks.get(robot, clocks.get("", ViewClock()))) != ViewClock()}
