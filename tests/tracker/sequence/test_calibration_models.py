"""Cameras of every model come back from the calibration of a sequence."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.tracker.geometry.random_cameras import MAKERS, random_camera
from tracker.geometry import Pose
from tracker.geometry.ground import Flat
from tracker.sequence.calibration import calibration_of, setup_from
from tracker.types import Mount, Setup, Start


@pytest.mark.parametrize("model", MAKERS)
def test_cameras_come_back_from_json(model: str) -> None:
    cameras = {f"C{seed}": random_camera(model, seed) for seed in range(5)}
    mounts = {name: Mount(camera, Pose.identity(), name) for name, camera in cameras.items()}
    setup = Setup(mounts, Flat(), {name: Start(Pose.identity(), np.zeros((6, 6))) for name in mounts}, 0.25)
    again = setup_from(json.loads(json.dumps(calibration_of(setup))), Flat(), None)
    assert {name: mount.camera for name, mount in again.mounts.items()} == cameras


def test_a_distortion_that_is_no_list_is_refused() -> None:
    mounts = {"C": Mount(random_camera("pinhole", 0), Pose.identity(), "C")}
    calibration = calibration_of(Setup(mounts, Flat(), {"C": Start(Pose.identity(), np.zeros((6, 6)))}, 0.25))
    calibration["cameras"]["C"]["distortion"] = 3.0
    with pytest.raises(TypeError):
        setup_from(calibration, Flat(), None)
