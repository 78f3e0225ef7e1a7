"""Counts of boxes by the gate that stops them, and the line that explains why there are few people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.detections.test_ground_points import EYE, PARAMETERS
from tracker.datasets import synthetic_crowd
from tracker.detections.cross_view import group_across_views
from tracker.detections.ground_points import GroundDetections, project_to_ground
from tracker.detections.rejections import (
    BOXES,
    HIDDEN_FEET,
    NO_GROUND,
    NO_POSE,
    OUTSIDE,
    TOO_HIGH,
    TOO_LOW,
    USABLE,
    count_rejections,
    explain_few_people,
)
from tracker.geometry import Pose, bearing_from_angles
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import Detections, Mount, Setup, Start

MOUNT = Mount(Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, EYE])), "r")
SETUP = Setup({"r": MOUNT}, Flat(), {"r": Start(Pose.identity(), np.zeros((6, 6)))}, 1 / 6, area=np.array([[-9.0, -9.0], [9.0, 9.0]]))

ROWS = {
    NO_GROUND: (1.0, 100.0, 1.7, 0.9),
    TOO_LOW: (1.5, 5.0, 1.2, 0.9),
    TOO_HIGH: (2.0, 5.0, 2.5, 0.9),
    HIDDEN_FEET: (-1.0, 30.0, 1.7, 0.9),
    OUTSIDE: (3.0, 15.0, 1.7, 0.9),
    USABLE: (-1.0, 4.0, 1.7, 0.9),
}
"""Reason → azimuth rad and distance m of a box, height m of its upper edge there, and confidence. The last one covers the feet of another."""


def boxes(rows: list[tuple[float, float, float, float]]) -> Detections:
    azimuth, distance, height, confidence = np.array(rows).reshape(-1, 4).T
    low, high = -np.arctan2(EYE, distance), np.arctan2(height - EYE, distance)
    n = len(azimuth)
    extent = np.stack([0.5 / distance, high - low], axis=1)
    return Detections(bearing_from_angles(azimuth, (low + high) / 2), extent, confidence, np.tile(1e-6 * np.eye(2), (n, 1, 1)), np.zeros((n, 0)))


def feet(rows: list[tuple[float, float, float, float]]) -> GroundDetections:
    return project_to_ground(SETUP, "r", boxes(rows), (Pose.identity(), np.zeros((6, 6))), PARAMETERS)


def test_each_box_is_counted_by_the_first_gate_that_stops_it() -> None:
    counts = count_rejections([feet(list(ROWS.values()))], SETUP)
    assert counts == {BOXES: len(ROWS)} | dict.fromkeys(ROWS, 1)


def test_boxes_that_no_gate_stops_are_those_that_the_tracker_groups() -> None:
    """Without an area, which does not restrict where tracks begin."""
    rng = np.random.default_rng(0)
    rows = [(rng.uniform(-3, 3), rng.uniform(1, 80), rng.uniform(1.2, 2.5), rng.uniform(0, 1)) for _ in range(200)]
    view, setup = feet(rows), replace(SETUP, area=None)
    counts = count_rejections([view], setup)
    groups = group_across_views([view], [np.ones(len(view), dtype=bool)], setup.height, PARAMETERS)
    assert counts[USABLE] == len(groups) > 5
    assert counts[BOXES] == 200 == sum(counts.values()) - counts[BOXES]


def test_the_line_has_all_reasons_with_their_bounds() -> None:
    counts = {BOXES: 36} | {name: k for k, name in enumerate((NO_POSE, *ROWS), 0)}
    assert explain_few_people(counts, 0, SETUP, PARAMETERS) == (
        "no people: of 36 boxes 1 have no ground point (the lower edge is above the horizon or more than 60 m away), 2 are lower than 1.4 m,"
        " 3 are higher than 2.3 m, 4 may hide the feet, 5 are outside the area, 6 may begin a track, but are in too few frames"
    )
    assert explain_few_people(counts, 3, SETUP, PARAMETERS).startswith("few people: of 36 boxes")
    assert explain_few_people(counts, 4, SETUP, PARAMETERS) == ""


@pytest.mark.parametrize(
    ("counts", "line"),
    [
        ({BOXES: 0}, "no people: there are no boxes"),
        ({BOXES: 5, OUTSIDE: 5}, "no people: of 5 boxes 5 are outside the area"),
        ({}, ""),
    ],
)
def test_special_cases(counts: dict[str, int], line: str) -> None:
    assert explain_few_people(counts, 0, SETUP, PARAMETERS).startswith(line)
    assert bool(line) == bool(explain_few_people(counts, 0, SETUP, PARAMETERS))


def test_a_run_counts_all_boxes_of_the_input() -> None:
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(views=2), synthetic_crowd.paths(4, 8, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)
    for parameters in (Parameters(), Parameters(delay=3)):
        counters = Results.of(track(setup, ticks, parameters), {}).run["counters"]
        assert counters[BOXES] == sum(len(view.detections) for tick in ticks for view in tick.views)
        assert sum(counters.get(name, 0) for name in (NO_POSE, *ROWS)) == counters[BOXES]


def test_boxes_of_a_robot_without_a_pose_are_counted() -> None:
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(views=2), synthetic_crowd.paths(4, 3, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)
    lost = next(iter(setup.starts))
    estimates = list(track(replace(setup, starts=setup.starts | {lost: None}), ticks))
    mine = sum(len(view.detections) for tick in ticks for view in tick.views if setup.mounts[view.camera].robot == lost)
    assert estimates[-1].counters[NO_POSE] == mine > 0
