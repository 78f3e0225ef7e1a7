"""Cameras whose calibrations are swapped get their own before anything else is refined; one that has moved is put right; right ones stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import walked_room
from tracker.calibration import Known, calibrate
from tracker.calibration.body import angles_of, rotation_of
from tracker.calibration.refinement import unswapped
from tracker.geometry import Pose


def test_swapped_cameras_get_their_own_calibration() -> None:
    room = replace(walked_room(frames=60), truth=None)
    cameras = {**room.cameras, "C1": room.cameras["C2"], "C2": room.cameras["C1"]}
    mended, told = unswapped(replace(room, cameras=cameras))
    assert all(mended.cameras[name] is camera for name, camera in room.cameras.items())
    assert len(told) == 1
    assert "C1 and C2 are swapped" in told[0]
    assert unswapped(room) == (room, [])


def test_a_known_height_is_believed_before_the_given_one() -> None:
    room = replace(walked_room(frames=40), truth=None).choose(["C1"])
    found = calibrate(room, Known(heights={"C1": 2.64}, refine=True))
    assert found.cameras["C1"].pose.translation[2] == pytest.approx(2.64, rel=0.01)
    assert [line.startswith("C1: height is +10.") for line in found.changes] == [True]


@pytest.mark.soak
def test_a_camera_without_pose_is_placed_among_given_ones() -> None:
    room = walked_room(frames=120)
    mixed = replace(room, truth=None, cameras={**room.cameras, "C4": room.cameras["C4"].without_pose()})
    found = calibrate(mixed, Known(refine=True))
    assert not found.problems
    assert all(line.startswith("C4: ") for line in found.changes)
    np.testing.assert_allclose(found.cameras["C4"].pose.translation, room.cameras["C4"].pose.translation, atol=0.1)


def test_a_camera_without_tracklets_keeps_its_calibration_with_a_problem() -> None:
    room = replace(walked_room(frames=40), truth=None).choose(["C1"])
    rare = {frame: boxes for frame, boxes in room.detections["C1"].items() if frame % 20 == 0}
    found = calibrate(replace(room, detections={"C1": rare}), Known(refine=True))
    assert found.problems == ("too few boxes of people who can be told apart",)
    assert found.cameras["C1"] is room.cameras["C1"]
    assert not found.moved_frame


@pytest.mark.soak
@pytest.mark.parametrize("degrees", [0.0, 3.0])
def test_a_camera_that_has_moved_is_put_right_and_no_other(degrees: float) -> None:
    room = replace(walked_room(frames=240), truth=None)
    right = room.cameras["C2"]
    pitch, roll, yaw = angles_of(right.pose.rotation)
    tilted = replace(right, pose=Pose(rotation_of(pitch + np.radians(degrees), roll, yaw), right.pose.translation))
    found = calibrate(replace(room, cameras={**room.cameras, "C2": tilted}), Known(refine=True))
    assert not found.problems
    assert all(found.cameras[name] is camera for name, camera in room.cameras.items() if name != "C2")
    if not degrees:
        assert not found.changes
        assert found.cameras["C2"] is tilted
        return
    assert all(line.startswith("C2: ") for line in found.changes)
    assert np.degrees(np.abs(np.array(angles_of(found.cameras["C2"].pose.rotation)) - [pitch, roll, yaw]).max()) < 0.3
