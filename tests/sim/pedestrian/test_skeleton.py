import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.pedestrian import gait, leg_kinematics, skeleton
from sim.pedestrian.foot_contact import ANKLE, HEEL, PIVOT
from sim.pedestrian.gait import Bodies, Footing
from sim.pedestrian.skeleton import LIMBS
from tracker.geometry import rotation_z
from tracker.types import KEYPOINT_NAMES
from worlds.terrain.heightfield import Heightfield

DT = 1 / 18
STATURE = np.array([1.55, 1.72, 1.95])
SPEED = np.array([0.6, 1.2, 1.6])


def rough(relief: float) -> Heightfield:
    ground = Heightfield.flat([[-12, -6], [12, 6]], 0.1)
    x, y = ground.nodes[..., 0], ground.nodes[..., 1]
    return ground.with_heights(relief * np.sin(1.7 * x) * np.cos(1.3 * y) + 4 * relief * np.clip(x, 0, 4))


def walk(ground: Heightfield, seconds: float = 10.0):
    """Poses, footings and positions of three people who walk and stop at the end."""
    position, heading = np.column_stack([np.full(3, -8.0), [-3.0, 0.0, 3.0]]), np.zeros(3)
    footing = gait.stand(position, heading, STATURE)
    for k in range(round(seconds / DT)):
        t = k * DT
        heading = heading + 0.3 * np.sin(0.5 * t) * DT
        velocity = (SPEED * np.clip(min(t, seconds - 1 - t), 0, 1))[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        position = position + velocity * DT
        footing = gait.walk(footing, Bodies(position, velocity, heading, STATURE), DT)
        yield skeleton.limb_poses(STATURE, footing, position, heading, ground), footing, position


def soles(poses: skeleton.Poses) -> tuple[np.ndarray, np.ndarray]:
    """Heel and ball of the shoes (m, 2, 3) m."""
    shoes = [LIMBS.index("left_shoe"), LIMBS.index("right_shoe")]
    R = Rotation.from_quat(poses.quaternion[:, shoes].reshape(-1, 4), scalar_first=True).as_matrix().reshape(-1, 2, 3, 3)
    size = STATURE[:, None, None]
    ankle = poses.position[:, shoes]
    return ankle + R @ np.array([-HEEL, 0.0, -ANKLE]) * size, ankle + R @ np.array([PIVOT, 0.0, -ANKLE]) * size


@pytest.mark.parametrize("relief", [0.0, 0.08])
def test_standing_feet_neither_slide_nor_leave_the_ground(relief):
    ground, last = rough(relief), None
    for poses, footing, _ in walk(ground):
        ends = soles(poses)
        gap = np.minimum(*(end[..., 2] - ground.height_at(end.reshape(-1, 3)).reshape(-1, 2) for end in ends))
        assert np.abs(gap[footing.standing]).max() < 0.02
        assert gap.min() > -0.02
        if last is not None:
            both = footing.standing & last[1]
            slide = np.minimum(*(np.linalg.norm(now - then, axis=2) for now, then in zip(ends, last[0], strict=True)))
            assert slide[both].max(initial=0) < 0.003
        last = ends, footing.standing


@pytest.mark.parametrize("relief", [0.0, 0.08])
def test_limbs_keep_their_lengths(relief):
    joint = {name: k for k, name in enumerate(KEYPOINT_NAMES)}
    links = [
        ("hip", "knee", leg_kinematics.THIGH),
        ("knee", "ankle", leg_kinematics.SHIN),
        ("shoulder", "elbow", skeleton.UPPER_ARM),
        ("elbow", "wrist", skeleton.FOREARM),
    ]
    for poses, _, _ in walk(rough(relief)):
        for side in ("left", "right"):
            for a, b, share in links:
                length = np.linalg.norm(poses.joints[:, joint[f"{side}_{a}"]] - poses.joints[:, joint[f"{side}_{b}"]], axis=1)
                np.testing.assert_allclose(length, share * STATURE, atol=1e-9)


def test_joints_are_at_plausible_heights():
    ground = rough(0.08)
    bounds = {
        "nose": (0.85, 1.0),
        "shoulder": (0.70, 0.88),
        "elbow": (0.50, 0.80),
        "wrist": (0.36, 0.75),
        "hip": (0.40, 0.60),
        "knee": (0.16, 0.42),
        "ankle": (-0.05, 0.28),
    }
    for poses, _, position in walk(ground):
        height = (poses.joints[..., 2] - ground.height_at(position)[:, None]) / STATURE[:, None]
        for k, name in enumerate(KEYPOINT_NAMES):
            low, high = bounds.get(name.split("_")[-1], (0.85, 1.0))
            assert height[:, k].min() > low, name
            assert height[:, k].max() < high, name


def test_hips_rise_and_fall_as_in_human_gait():
    z = np.array([poses.position[:, 0, 2] for poses, *_ in walk(rough(0.0))])[60:140]
    assert (np.ptp(z, axis=0) < 0.07).all()
    assert (np.ptp(z, axis=0) > 0.005).all()


def test_poses_turn_and_move_with_the_person():
    flat, turn = rough(0.0), rotation_z(0.7)
    shift = np.array([1.0, -2.0])
    for _poses, footing, position in walk(flat, 3.0):
        heading = np.full(3, 0.1)
        here = skeleton.limb_poses(STATURE, footing, position, heading, flat)
        moved = Footing(
            footing.phase,
            footing.planted @ turn[:2, :2].T + shift,
            footing.planted_yaw + 0.7,
            footing.lifted @ turn[:2, :2].T + shift,
            footing.lifted_yaw + 0.7,
        )
        there = skeleton.limb_poses(STATURE, moved, position @ turn[:2, :2].T + shift, heading + 0.7, flat)
        np.testing.assert_allclose(there.joints, here.joints @ turn.T + [*shift, 0.0], atol=1e-9)


def test_left_and_right_are_alike():
    flat, mirror = rough(0.0), np.array([1.0, -1.0])
    swapped = [0] + [k + 1 if k % 2 else k - 1 for k in range(1, len(KEYPOINT_NAMES))]
    for _poses, footing, position in walk(flat, 3.0):
        heading = np.full(3, 0.1)
        here = skeleton.limb_poses(STATURE, footing, position, heading, flat)
        image = Footing(
            np.mod(footing.phase + 0.5, 1),
            footing.planted[:, ::-1] * mirror,
            -footing.planted_yaw[:, ::-1],
            footing.lifted[:, ::-1] * mirror,
            -footing.lifted_yaw[:, ::-1],
        )
        there = skeleton.limb_poses(STATURE, image, position * mirror, -heading, flat)
        np.testing.assert_allclose(there.joints[:, swapped], here.joints * [1, -1, 1], atol=1e-9)


def test_statures_are_those_of_adults():
    heights = skeleton.statures(np.random.default_rng(1), 2000)
    assert heights.min() >= 1.5
    assert heights.max() <= 2.0
    assert abs(heights.mean() - 1.72) < 0.01
    np.testing.assert_array_equal(heights[:1], skeleton.statures(np.random.default_rng(1), 2000)[:1])


def test_children_are_small_and_have_large_heads():
    heights = skeleton.statures(np.random.default_rng(1), 2000, 0.3)
    children = heights < 1.5
    assert 0.25 < children.mean() < 0.35
    assert heights.min() >= 1.1
    sizes = np.array([1.1, 1.3, 1.5, 1.8])
    assert (np.diff(skeleton.head_size(sizes) / sizes) <= 1e-12).all()
    np.testing.assert_allclose(skeleton.head_size(sizes[2:]), sizes[2:])
    # Shoulders and what is above them make up the stature.
    above = (1 - skeleton.SHOULDER_HEIGHT) * skeleton.head_size(sizes)
    np.testing.assert_allclose(skeleton.SHOULDER_HEIGHT * skeleton.trunk_size(sizes) + above, sizes)
