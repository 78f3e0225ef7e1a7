import numpy as np
import pytest

from sim.pedestrian import gait, skeleton
from sim.pedestrian.gait import Bodies
from sim.pedestrian.skeleton import LIMBS
from worlds.terrain.heightfield import Heightfield

STATURE = np.array([1.7, 1.8])


def bodies(speed: float) -> Bodies:
    """Two people two metres apart, facing along x, the second one to the left of the first."""
    return Bodies(np.array([[0.0, 0.0], [0.5, 2.0]]), np.full((2, 2), [speed, 0.0]), np.zeros(2), STATURE)


def test_standing_people_look_at_the_nearest_and_walking_people_look_ahead():
    here = bodies(0.0)
    yaw = np.zeros(2)
    for _ in range(40):
        before, yaw = yaw, skeleton.head_yaw(yaw, here, here.position, 0.05)
        assert np.abs(yaw - before).max() <= skeleton.FASTEST_TURN * 0.05 + 1e-12
    # What is behind the second one's shoulder cannot be seen.
    np.testing.assert_allclose(yaw, [0.0, 0.0], atol=1e-9)
    robot = np.array([[1.0, 1.0]])
    for _ in range(40):
        yaw = skeleton.head_yaw(yaw, here, np.concatenate([here.position, robot]), 0.05)
    assert yaw[0] == pytest.approx(np.pi / 4)
    assert yaw[1] == pytest.approx(np.arctan2(-1.0, 0.5))
    for _ in range(40):
        yaw = skeleton.head_yaw(yaw, bodies(1.2), np.concatenate([here.position, robot]), 0.05)
    np.testing.assert_array_equal(yaw, 0.0)


def test_the_face_turns_with_the_head_and_the_rest_does_not():
    here = bodies(0.0)
    ground = Heightfield.flat([[-5, -5], [5, 5]], 1.0)
    poses = skeleton.limb_poses(STATURE, gait.stand(here.position, here.heading, STATURE), here.position, here.heading, ground)
    turned = skeleton.with_head_yaw(poses, np.array([0.8, -0.5]))
    moved = np.abs(turned.joints - poses.joints).max(axis=(0, 2)) > 1e-9
    np.testing.assert_array_equal(moved, np.arange(17) < 5)
    others = [k for k, limb in enumerate(LIMBS) if limb != "head"]
    np.testing.assert_array_equal(turned.quaternion[:, others], poses.quaternion[:, others])
    head = poses.position[:, LIMBS.index("head")]
    nose = turned.joints[:, 0] - head
    np.testing.assert_allclose(np.arctan2(nose[:, 1], nose[:, 0]), [0.8, -0.5], atol=0.02)
    length = [np.linalg.norm(p.joints[:, :5] - head[:, None], axis=2) for p in (poses, turned)]
    np.testing.assert_allclose(*length)
