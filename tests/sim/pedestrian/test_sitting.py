"""Bodies of people who sit: on the seat, feet on the ground or hanging, limbs of their lengths."""

import numpy as np
import pytest

from sim.pedestrian import gait, skeleton
from sim.pedestrian.foot_contact import ANKLE
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from sim.pedestrian.skeleton import HIP_ABOVE_SEAT, sitting_poses, trunk_size, with_sitters
from tracker.types import KEYPOINT_NAMES
from worlds.terrain.heightfield import Heightfield

STATURE = np.array([1.15, 1.35, 1.55, 1.72, 1.95])
SEATS = np.column_stack([np.arange(5.0), 0.3 * np.arange(5.0), np.full(5, 0.47), np.linspace(-3, 3, 5)])


def test_sitters_sit_with_limbs_of_their_lengths() -> None:
    ground, size = Heightfield.flat([[-3, -3], [9, 9]], 0.1), trunk_size(STATURE)
    poses = sitting_poses(STATURE, SEATS, ground)
    joint = {name: poses.joints[:, k] for k, name in enumerate(KEYPOINT_NAMES)}
    hips = 0.5 * (joint["left_hip"] + joint["right_hip"])
    np.testing.assert_allclose(hips, np.column_stack([SEATS[:, :2], SEATS[:, 2] + HIP_ABOVE_SEAT * size]), atol=1e-9)
    forward = np.stack([np.cos(SEATS[:, 3]), np.sin(SEATS[:, 3])], axis=1)
    for side in ("left", "right"):
        hip, knee, ankle = (joint[f"{side}_{part}"] for part in ("hip", "knee", "ankle"))
        assert np.linalg.norm(knee - hip, axis=1) == pytest.approx(THIGH * size, rel=0.01)
        assert np.linalg.norm(ankle - knee, axis=1) == pytest.approx(SHIN * size, rel=0.01)
        assert (((knee - hip)[:, :2] * forward).sum(axis=1) > 0.8 * THIGH * size).all()
        # The tall stand on their soles; feet of the small hang.
        assert ankle[2:, 2] == pytest.approx(ANKLE * size[2:], abs=0.03)
        assert (ankle[:, 2] > ANKLE * size - 0.005).all()
    assert ankle[0, 2] > 0.1
    # A head above a seat is as high as sitting height says: 0.52 of stature (Drillis & Contini), to the vertex.
    top = joint["nose"][:, 2] + 0.08 * STATURE
    assert (top[2:] - SEATS[2:, 2]) / STATURE[2:] == pytest.approx(0.52, abs=0.03)


def test_only_sitters_change() -> None:
    ground = Heightfield.flat([[-3, -3], [9, 9]], 0.1)
    position, heading = SEATS[:, :2], SEATS[:, 3]
    standing = skeleton.limb_poses(STATURE, gait.stand(position, heading, STATURE), position, heading, ground)
    both = with_sitters(standing, np.array([1, 3]), sitting_poses(STATURE[[1, 3]], SEATS[[1, 3]], ground))
    np.testing.assert_array_equal(both.joints[[0, 2, 4]], standing.joints[[0, 2, 4]])
    assert (both.joints[[1, 3], 0, 2] < standing.joints[[1, 3], 0, 2] - 0.1).all()
