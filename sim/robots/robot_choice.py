"""The text of `--robot`: which robots drive in place of rovers, how they move, and where their cameras and IMUs are."""

from __future__ import annotations

from dataclasses import dataclass

ROVER = "rover"
BASE, THRUST, WHEELS, CONTROLLED = "base", "thrust", "wheels", "controller"
MOTIONS = (WHEELS, BASE, THRUST)
"""Kinds of motion that can be specified: wheels; a base that follows the path, with its legs in a gait; flight by thrust."""


@dataclass(frozen=True)
class RobotChoice:
    """One robot of `--robot`: a name or file, and its options.

    motion: one of MOTIONS, or "" to guess. camera, imu: name of a camera or site, or "". controller: module:function that sets its controls, or "".
    """

    source: str
    motion: str = ""
    camera: str = ""
    imu: str = ""
    controller: str = ""


def parse_robots(text: str) -> tuple[RobotChoice, ...]:
    """The choices of a text `NAME|FILE.xml[:motion=…][:camera=…][:imu=…][:controller=MODULE:FUNCTION],…`. Raises ValueError for an unknown word."""
    return tuple(_choice(one.strip()) for one in text.split(","))


def _choice(text: str) -> RobotChoice:
    source, *words = text.split(":")
    told: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals and "controller" in told and ":" not in told["controller"]:
            told["controller"] += f":{word}"
        else:
            told[name] = value
    if not source or set(told) - {"motion", "camera", "imu", "controller"} or not all(told.values()):
        raise ValueError(f"robot is {text[:60]!r}, needs NAME or FILE.xml, then :motion=…, :camera=…, :imu=… or :controller=MODULE:FUNCTION")
    if told.get("motion", BASE) not in MOTIONS:
        raise ValueError(f"robot {source} has motion={told['motion'][:20]}, needs one of {', '.join(MOTIONS)}")
    if "motion" in told and "controller" in told:
        raise ValueError(f"robot {source} has motion and controller, needs one of them")
    return RobotChoice(source, **told)
