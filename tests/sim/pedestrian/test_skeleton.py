import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.pedestrian import gait, leg_kinematics, skeleton
from sim.pedestrian.foot_contact import ANKLE, HEEL, PIVOT
from sim.pedestrian.gait import Bodies, Footing
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from sim.pedestrian.skeleton import HIP_ABOVE_SEAT, LIMBS, SittingManner, sitting_poses, trunk_size, with_sitters
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


PAIR = np.array([1.7, 1.8])


def bodies(speed: float) -> Bodies:
    """Two people two metres apart, facing along x, the second one to the left of the first."""
    return Bodies(np.array([[0.0, 0.0], [0.5, 2.0]]), np.full((2, 2), [speed, 0.0]), np.zeros(2), PAIR)


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
    poses = skeleton.limb_poses(PAIR, gait.stand(here.position, here.heading, PAIR), here.position, here.heading, ground)
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


SIZES = np.array([1.15, 1.35, 1.55, 1.72, 1.95])
SEATS = np.column_stack([np.arange(5.0), 0.3 * np.arange(5.0), np.full(5, 0.47), np.linspace(-3, 3, 5)])


def test_sitters_sit_with_limbs_of_their_lengths() -> None:
    ground, size = Heightfield.flat([[-3, -3], [9, 9]], 0.1), trunk_size(SIZES)
    poses = sitting_poses(SIZES, SEATS, ground)
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
    top = joint["nose"][:, 2] + 0.08 * SIZES
    assert (top[2:] - SEATS[2:, 2]) / SIZES[2:] == pytest.approx(0.52, abs=0.03)


def test_only_sitters_change() -> None:
    ground = Heightfield.flat([[-3, -3], [9, 9]], 0.1)
    position, heading = SEATS[:, :2], SEATS[:, 3]
    standing = skeleton.limb_poses(SIZES, gait.stand(position, heading, SIZES), position, heading, ground)
    both = with_sitters(standing, np.array([1, 3]), sitting_poses(SIZES[[1, 3]], SEATS[[1, 3]], ground))
    np.testing.assert_array_equal(both.joints[[0, 2, 4]], standing.joints[[0, 2, 4]])
    assert (both.joints[[1, 3], 0, 2] < standing.joints[[1, 3], 0, 2] - 0.1).all()


def test_another_manner_moves_the_upper_body_alone() -> None:
    ground = Heightfield.flat([[-3, -3], [9, 9]], 0.1)
    usual, again = sitting_poses(SIZES, SEATS, ground), sitting_poses(SIZES, SEATS, ground, SittingManner.usual(5))
    np.testing.assert_array_equal(usual.joints, again.joints)
    other = sitting_poses(SIZES, SEATS, ground, SittingManner.drawn(5, np.random.default_rng(0)))
    lower = [k for k, name in enumerate(KEYPOINT_NAMES) if name.split("_")[-1] in ("hip", "knee", "ankle")]
    np.testing.assert_allclose(other.joints[:, lower], usual.joints[:, lower], atol=1e-9)
    moved = np.linalg.norm(other.joints - usual.joints, axis=2)[:, [k for k in range(17) if k not in lower]]
    assert moved.max() > 0.1
    assert (other.joints[:, 0, 2] > SEATS[:, 2] + 0.25).all()
