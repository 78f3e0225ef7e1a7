"""The text of `--robot`: which robots drive in place of rovers, how they move, and where their cameras are."""

from __future__ import annotations

from dataclasses import dataclass

ROVER = "rover"
BASE, THRUST, WHEELS = "base", "thrust", "wheels"
MOTIONS = (WHEELS, BASE, THRUST)
"""Kinds of motion: wheels on fixed axles; a base that follows the path, with its legs in a gait; flight by thrust."""


@dataclass(frozen=True)
class RobotChoice:
    """One robot of `--robot`: a name or file, and what is told of it. motion: one of MOTIONS, or "" to guess. camera: of a camera or site, or ""."""

    source: str
    motion: str = ""
    camera: str = ""


def parse_robots(text: str) -> tuple[RobotChoice, ...]:
    """The choices of a text `NAME|FILE.xml[:motion=…][:camera=…],…`. Raises ValueError for an unknown word."""
    out = []
    for one in text.split(","):
        source, *words = one.strip().split(":")
        told = dict(word.partition("=")[::2] for word in words)
        unknown = set(told) - {"motion", "camera"}
        if not source or unknown or not all(told.values()):
            raise ValueError(f"robot is {one.strip()[:60]!r}, needs NAME or FILE.xml, with :motion=… or :camera=… behind it")
        if told.get("motion", BASE) not in MOTIONS:
            raise ValueError(f"robot {source} has motion={told['motion'][:20]}, needs one of {', '.join(MOTIONS)}")
        out.append(RobotChoice(source, told.get("motion", ""), told.get("camera", "")))
    return tuple(out)
