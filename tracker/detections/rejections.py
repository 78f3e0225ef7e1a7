"""Why boxes initiate no track: each box is counted once, by the first gate that stops it, and one line explains the counts.

The gates are those of the tracker of people: projection to the ground, then height and visible feet (cross_view.py), then the area.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from tracker.detections.cross_view import may_initiate
from tracker.detections.ground_points import FusionParameters, GroundDetections
from tracker.types import Setup

BOXES = "boxes"
NO_POSE = "boxes of robots that are not localized"
NO_GROUND = "boxes without a ground point"
TOO_LOW = "boxes too low"
TOO_HIGH = "boxes too high"
HIDDEN_FEET = "boxes whose feet may be hidden"
OUTSIDE = "boxes outside the area"
USABLE = "boxes that may initiate a track"

FEW = 0.1
"""People are few where the reported places are less than this share of the boxes of one camera."""


def count_rejections(views: Iterable[GroundDetections], setup: Setup) -> dict[str, int]:
    """The number of boxes, and of those that each gate stops: name → count. The last name, USABLE, counts the boxes that no gate stops."""
    counts = dict.fromkeys((BOXES, NO_GROUND, TOO_LOW, TOO_HIGH, HIDDEN_FEET, OUTSIDE, USABLE), 0)
    low, high = setup.height
    for feet in views:
        counts[BOXES] += len(feet)
        left = np.ones(len(feet), dtype=bool)
        for name, stopped in (
            (NO_GROUND, ~feet.grounded),
            (TOO_LOW, feet.height < low),
            (TOO_HIGH, feet.height > high),
            (HIDDEN_FEET, ~may_initiate(feet)),
            (OUTSIDE, ~setup.contains(feet.point)),
        ):
            counts[name] += int((left & stopped).sum())
            left &= ~stopped
        counts[USABLE] += int(left.sum())
    return counts


def explain_few_people(counters: Mapping[str, int], places: int, setup: Setup, fusion: FusionParameters) -> str:
    """One line on why there are no or few people; empty where there are enough, and for counters without the name BOXES.

    counters: as of count_rejections. places: number of reported places, over all frames.
    """
    boxes = counters.get(BOXES)
    if boxes is None or places > FEW * boxes / len(setup.mounts):
        return ""
    head = "no people" if not places else "few people"
    if not boxes:
        return f"{head}: there are no boxes" if not places else ""
    low, high = setup.height
    reasons = {
        NO_POSE: "are of robots that are not localized",
        NO_GROUND: f"have no ground point (the lower edge is above the horizon or more than {fusion.over(setup).reach:.0f} m away)",
        TOO_LOW: f"are lower than {low:g} m",
        TOO_HIGH: f"are higher than {high:g} m",
        HIDDEN_FEET: "may hide the feet",
        OUTSIDE: "are outside the area",
        USABLE: "may begin a track, but are in too few frames",
    }
    parts = [f"{counters[name]} {reason}" for name, reason in reasons.items() if counters.get(name)]
    return f"{head}: of {boxes} boxes {', '.join(parts)}"
