"""Ground points of boxes: hidden feet, ambiguous distances, and which boxes initiate tracks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.detections.cross_view import AMBIGUOUS_SIGMA, AMBIGUOUS_SIGMA_KNOWN, group_across_views
from tracker.detections.ground_points import FEET_HIDDEN, FusionParameters, GroundDetections, project_to_ground
from tracker.geometry import Pose, bearing_from_angles
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.types import Detections, Mount, Setup, Start

EYE = 1.5
PARAMETERS = FusionParameters(ahead=0.0)


def seen(
    people: list[tuple[float, float]],
    wall: float | None = None,
    ground: Ground | None = None,
    occluders: Grid | None = None,
    parameters: FusionParameters = PARAMETERS,
    feet: bool = True,
) -> GroundDetections:
    """Whole boxes of people 1.7 m tall at (azimuth rad, distance m) from a panorama; a wall of 0.5 m stands `wall` m ahead of it. Another ground
    than the plane makes them end elsewhere than at it.
    """
    azimuth, distance = np.array(people).T
    low, high = -np.arctan2(EYE, distance), np.arctan2(1.7 - EYE, distance)
    extent, n = np.stack([0.5 / distance, high - low], axis=1), len(people)
    boxes = Detections(
        bearing_from_angles(azimuth, (low + high) / 2), extent, np.full(n, 0.9), np.tile(1e-6 * np.eye(2), (n, 1, 1)), np.zeros((n, 0))
    )
    boxes = replace(boxes, feet_seen=np.full(n, feet))
    if wall is not None:
        heights = np.zeros((201, 801))
        heights[:, 400 + round(wall / 0.1)] = 0.5
        occluders = Grid(heights, np.array([-40.0, -10.0]), 0.1)
    mount = Mount(Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, EYE])), "r")
    setup = Setup({"r": mount}, ground or Flat(), {"r": Start(Pose.identity(), np.zeros((6, 6)))}, 1 / 6, occluders=occluders)
    return project_to_ground(setup, "r", boxes, (Pose.identity(), np.zeros((6, 6))), parameters)


def initiating(feet: GroundDetections) -> set[int]:
    return {row for group in group_across_views([feet], [np.ones(len(feet), dtype=bool)], (1.4, 2.3), PARAMETERS) for _, row in group.members}


def test_a_box_over_a_corner_of_another_leaves_its_feet_visible_and_one_over_all_of_it_does_not() -> None:
    corner, whole = seen([(0.0, 6.0), (0.1, 4.0)]), seen([(0.0, 6.0), (0.0, 4.0)])
    assert corner.feet_hidden[0] == FEET_HIDDEN[0]
    assert corner.ambiguous.tolist() == [False, False]
    assert corner.point[0, 0] == pytest.approx(6.0, abs=0.01)
    # The upper edge and usual statures tell the distance, from the lower edge on.
    assert whole.ambiguous.tolist() == [True, False]
    assert whole.spread[0, 0, 0] > 10 * corner.spread[0, 0, 0]
    assert abs(whole.point[0, 0] - 6.0) < 2 * np.sqrt(whole.spread[0, 0, 0])
    assert initiating(corner) == initiating(whole) == {0, 1}


@pytest.mark.parametrize("occluders", [None, Grid(np.zeros((201, 801)), np.array([-40.0, -10.0]), 0.1)])
def test_feet_that_a_detector_calls_hidden_are_no_feet(occluders: Grid | None) -> None:
    """The box is alone in the image. Its feet, if they were seen, would be 6 m away; else statures tell the distance."""
    shown, hidden = (seen([(0.0, 6.0)], occluders=occluders, feet=feet) for feet in (True, False))
    assert (shown.ambiguous[0], hidden.ambiguous[0]) == (False, True)
    assert hidden.spread[0, 0, 0] > 4 * shown.spread[0, 0, 0]
    assert abs(hidden.point[0, 0] - 6.0) < 2 * np.sqrt(hidden.spread[0, 0, 0])


def test_feet_just_above_a_wall_may_be_visible_or_hidden() -> None:
    # The line of sight to the feet passes the wall's top by less than a pixel: the feet are there, or behind the wall and hidden.
    feet = seen([(0.0, 5.0)], wall=3.3)
    assert feet.ambiguous[0]
    assert feet.occludable[0] == (feet.ranges.feet_hidden[0] > 0.5)
    assert initiating(feet) == {0}


def terrace(fall: float) -> Grid:
    """Level up to 6 m ahead, then lower by `fall` m."""
    heights = np.zeros((201, 801))
    heights[:, 461:] = -fall
    return Grid(heights, np.array([-40.0, -10.0]), 0.1)


@pytest.mark.parametrize("fall", [0.0, 0.1, 0.8])
def test_a_box_that_ends_at_a_lip_of_the_ground_may_end_above_the_feet(fall: float) -> None:
    """Well before the lip the feet are at the lower edge. At the lip they may be a little beyond, but a person far beyond would be a giant."""
    before, at_lip = (seen([(0.0, d)], ground=terrace(fall), occluders=terrace(fall)) for d in (4.0, 6.09))
    assert not before.ambiguous[0]
    assert before.point[0, 0] == pytest.approx(4.0, abs=0.01)
    assert at_lip.ambiguous[0] == (fall > 0)
    assert at_lip.point[0, 0] == pytest.approx(6.09, abs=0.5)


def test_occluders_of_feet_are_distinguished() -> None:
    assert seen([(0.0, 10.0)], wall=6.6).ambiguous.all()
    people = seen([(0.0, 10.0), (0.0, 6.0)])
    assert people.occludable[0]
    assert people.ambiguous.tolist() == [True, False]
    assert not people.cut.any()


def test_people_stand_behind_the_soles_at_which_their_boxes_end() -> None:
    """By 0.06 m, away from the camera and on the ground."""
    (x, y, z), ground = seen([(0.5, 6.0)]).point[0], terrace(0.0)
    behind = seen([(0.5, 6.0)], ground=ground, parameters=FusionParameters(ahead=0.06))
    np.testing.assert_allclose(behind.point[0], np.array([x, y, z]) * 6.06 / 6.0, atol=1e-9)
    np.testing.assert_allclose(EYE / -behind.direction[0, 2] * behind.direction[0, :2], behind.point[0, :2], atol=1e-9)


def test_uncertain_boxes_initiate_tracks_where_the_world_is_known() -> None:
    """A far box over another one: its place is uncertain by more than 4 m. In an unknown world its feet are hidden, and it starts nobody."""
    far = seen([(0.0, 30.0), (0.0, 4.0)])
    sigma = np.sqrt(np.trace(far.spread[0]))
    assert far.ambiguous[0]
    assert AMBIGUOUS_SIGMA < sigma < AMBIGUOUS_SIGMA_KNOWN
    assert initiating(far) == {1}
    assert initiating(replace(far, known=True)) == {0, 1}
    assert initiating(replace(far, known=True, spread=5 * far.spread)) == {1}


def test_the_reach_of_ground_points_holds_the_area_of_each_fixed_camera() -> None:
    mount = Mount(Panorama(1024, 512), Pose.identity(), "far")
    start = Start(Pose(np.eye(3), np.array([90.0, 0.0, 6.0])), np.zeros((6, 6)))
    area = np.array([[-10.0, -5.0], [10.0, 5.0]])
    setup = Setup({"camera": mount}, Flat(), {"far": start}, 0.1, area)
    assert np.isclose(FusionParameters().over(setup).reach, np.hypot(100.0, 5.0))
    assert FusionParameters().over(replace(setup, area=area + np.array([85.0, 0.0]))) == FusionParameters()
    assert FusionParameters().over(replace(setup, area=None)) == FusionParameters()
