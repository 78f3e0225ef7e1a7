"""User-defined controllers: functions from a robot's state and the driver's command to the controls of its actuators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.options import load_function


@dataclass(frozen=True, eq=False)
class RobotState:
    """State of a robot at a step of the physics; arrays are copies.

    time: s. position (3,) m, rotation (3, 3) and velocity (3,) m/s of the body robot_N in the world. rate: (3,) rad/s in the axes of the body.
    height: m of its origin over the ground. joints, speeds: name of a joint in its file → position and velocity, rad or m.
    """

    time: float
    position: Array
    rotation: Array
    velocity: Array
    rate: Array
    height: float
    joints: Mapping[str, float]
    speeds: Mapping[str, float]


@dataclass(frozen=True)
class DriveCommand:
    """The driver's command: forward speed m/s, yaw_rate rad/s about the vertical, and height m of the origin over the ground."""

    speed: float
    yaw_rate: float
    height: float


Controller = Callable[[RobotState, DriveCommand], Any]


@dataclass(frozen=True, eq=False)
class CheckedController:
    """The controller of a robot with `count` actuators. name: module:function."""

    name: str
    function: Controller
    count: int

    @staticmethod
    def of(name: str, count: int) -> CheckedController:
        """Raises ValueError where there is no such function, and for a robot without actuators."""
        if not count:
            raise ValueError(f"controller {name}: the robot has no actuators, which it could set")
        return CheckedController(name, load_function(name, "controller"), count)

    def controls(self, state: RobotState, command: DriveCommand) -> Array:
        """Controls (count,), in the order of the file. Raises ValueError for another result, and where the function fails."""
        try:
            found = np.asarray(self.function(state, command), dtype=np.float64)
        # The function is user code, which may raise anything.
        except Exception as error:
            told = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
            raise ValueError(f"controller {self.name} failed at {state.time:.3f} s ({told})") from error
        if found.shape != (self.count,) or not np.isfinite(found).all():
            raise ValueError(f"controller {self.name} gave {str(found.tolist())[:80]} at {state.time:.3f} s, needs {self.count} finite numbers")
        return found
