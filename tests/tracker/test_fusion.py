"""Boxes on the ground: what stands before the lower edge of a box says how likely the feet are in it, and who may be born."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.cameras import Panorama
from tracker.fusion import Feet, FusionParameters, combine, stand
from tracker.geometry import Pose, bearing_from_angles
from tracker.ground import Flat, Grid, Ground
from tracker.measurements import Detections, Mount, Setup, Start
from tracker.trees import MotionParameters, Sights, Tracks, sights

EYE = 1.5
RULE = FusionParameters()


def seen(people: list[tuple[float, float]], wall: float | None = None, ground: Ground | None = None) -> Feet:
    """Whole boxes of people 1.7 m tall at (azimuth rad, distance m) from a panorama; a wall of 0.5 m stands `wall` m ahead of it. Another ground
    than the plane makes them end elsewhere than at it.
    """
    azimuth, distance = np.array(people).T
    low, high = -np.arctan2(EYE, distance), np.arctan2(1.7 - EYE, distance)
    extent, n = np.stack([0.5 / distance, high - low], axis=1), len(people)
    boxes = Detections(
        bearing_from_angles(azimuth, (low + high) / 2), extent, np.full(n, 0.9), np.tile(1e-6 * np.eye(2), (n, 1, 1)), np.zeros((n, 0))
    )
    occluders = None
    if wall is not None:
        heights = np.zeros((201, 801))
        heights[:, 400 + round(wall / 0.1)] = 0.5
        occluders = Grid(heights, np.array([-40.0, -10.0]), 0.1)
    mount = Mount(Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, EYE])), "r")
    setup = Setup({"r": mount}, ground or Flat(), {"r": Start(Pose.identity(), np.zeros((6, 6)))}, 1 / 6, occluders=occluders)
    return stand(setup, "r", boxes, (Pose.identity(), np.zeros((6, 6))), RULE)


def born(feet: Feet) -> set[int]:
    return {row for group in combine([feet], [np.ones(len(feet), dtype=bool)], (1.4, 2.3), RULE) for _, row in group.members}


def test_a_box_over_a_corner_of_another_leaves_its_feet_in_sight_and_one_over_all_of_it_does_not() -> None:
    corner, whole = seen([(0.0, 6.0), (0.1, 4.0)]), seen([(0.0, 6.0), (0.0, 4.0)])
    assert (corner.lying[0], whole.lying[0]) == RULE.lying[:2]
    assert born(corner) == {0, 1}
    assert born(whole) == {1}


@pytest.mark.parametrize(("distance", "starts"), [(5.0, True), (30.0, False)])
def test_feet_just_over_a_wall_start_somebody_where_they_are_near(distance: float, starts: bool) -> None:
    # The line of sight to the feet passes the wall's top by less than the margin `edge`.
    feet = seen([(0.0, distance)], wall=round(distance * (1 - 0.51 / EYE), 1))
    assert feet.hidden[0]
    assert feet.lying[0] == RULE.lying[2]
    assert (born(feet) == {0}) is starts


def terrace(fall: float) -> Grid:
    """Level up to 6 m ahead, then lower by `fall` m."""
    heights = np.zeros((201, 801))
    heights[:, 461:] = -fall
    return Grid(heights, np.array([-40.0, -10.0]), 0.1)


@pytest.mark.parametrize("fall", [0.0, 0.1, 0.8])
def test_a_box_that_ends_at_a_lip_of_the_ground_may_end_above_the_feet(fall: float) -> None:
    """To within the margin: just before the lip, and just over it, where the line of sight goes on to the lower ground."""
    hidden = fall > RULE.fall
    alone = [seen([(0.0, d)], ground=terrace(fall)) for d in (4.0, 5.9, 6.1, 8.0)]
    assert [bool(f.hidden[0]) for f in alone] == [False, hidden, hidden, False]
    assert [f.lying[0] for f in alone] == [RULE.lying[3 if h else 0] for h in (False, hidden, hidden, False)]


def test_how_tall_a_box_looks_changes_with_the_place_as_is_said() -> None:
    heights = 0.3 * np.sin(np.linspace(0, 20, 201))[:, None] * np.cos(np.linspace(0, 60, 801))[None, :]
    ground = Grid(heights, np.array([-40.0, -10.0]), 0.1)
    feet = seen([(0.0, 6.0), (0.2, 9.0)], ground=ground)

    def look(x: float, y: float) -> Sights:
        track = replace(Tracks.none(), tree=np.ones(1, dtype=np.int64), state=np.array([[x, y, 0.0, 0.0]]), covariance=np.eye(4)[None])
        return sights(track, feet, np.zeros(2), ground, MotionParameters())

    here, step = look(7.0, 0.5), 0.1
    for axis, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        slope = (look(7.0 + dx, 0.5 + dy).height - look(7.0 - dx, 0.5 - dy).height) / (2 * step)
        np.testing.assert_allclose(here.climb[..., axis], slope, atol=2e-3)


def test_what_may_hide_feet_is_told_apart() -> None:
    assert seen([(0.0, 10.0)], wall=6.6).walled.all()
    people = seen([(0.0, 10.0), (0.0, 6.0)])
    assert people.hidden[0]
    assert not people.walled.any()
