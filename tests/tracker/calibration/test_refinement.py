"""Cameras whose calibrations are swapped get their own before anything else is refined; right ones stay."""

from __future__ import annotations

from dataclasses import replace

from tests.tracker.recordings.walked_room import walked_room
from tracker.calibration.refinement import unswapped


def test_swapped_cameras_get_their_own_calibration() -> None:
    room = replace(walked_room(frames=60), truth=None)
    cameras = {**room.cameras, "C1": room.cameras["C2"], "C2": room.cameras["C1"]}
    mended, told = unswapped(replace(room, cameras=cameras))
    assert all(mended.cameras[name] is camera for name, camera in room.cameras.items())
    assert len(told) == 1
    assert "C1 and C2 are swapped" in told[0]
    assert unswapped(room) == (room, [])
