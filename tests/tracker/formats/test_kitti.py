"""KITTI odometry export: evo reads the poses; images and projections agree with the sequence."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.formats.scene import FRAMES, RATE
from tracker.formats.camera_parameters import FACES, Resampling, face_camera, straight
from tracker.formats.kitti import projection
from tracker.geometry import Pose
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Pinhole
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_views

Exported = Callable[[str], Path]


def test_evo_reads_the_true_poses(sequence: Path, exported: Exported) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    root = exported("kitti") / "plaza"
    read = file_interface.read_kitti_poses_file(str(root / "poses" / "00.txt"))
    first = file_interface.read_kitti_poses_file(str(root / "sequences" / "00" / "first_pose.txt")).poses_se3[0]
    assert read.num_poses == FRAMES
    assert_allclose(read.poses_se3[0], np.eye(4), atol=1e-12)
    views = read_views(sequence)
    for k, pose in enumerate(read.poses_se3):
        truth = views[k, "robot_0_camera"].T_world_camera
        assert_allclose((first @ pose)[:3, 3], truth.translation, atol=1e-6)
        assert_allclose((first @ pose)[:3, :3], truth.rotation @ OPTICAL_FROM_CAMERA.T, atol=1e-6)
    assert_allclose(np.loadtxt(root / "sequences" / "00" / "times.txt"), np.arange(FRAMES) / RATE, atol=1e-9)


def test_images_are_the_front_view_and_agree_with_the_projection(sequence: Path, exported: Exported) -> None:
    source = read_sequence(sequence)
    folder = exported("kitti") / "plaza" / "sequences" / "00"
    camera = source.setup.mounts["robot_0_camera"].camera
    rows = {line.split(":")[0]: np.array(line.split()[1:], dtype=float).reshape(3, 4) for line in (folder / "calib.txt").read_text().splitlines()}
    assert list(rows) == ["P0", "P1", "P2", "P3", "Tr"]
    target = face_camera(camera)  # type: ignore[arg-type]
    T_camera_body = Pose(rows["Tr"][:, :3], rows["Tr"][:, 3])
    for k, tick in enumerate(source.ticks):
        image = cv2.imread(str(folder / "image_0" / f"{k:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert image.shape == (target.height, target.width)
        panorama = next(v.image for v in tick.views if v.camera == "robot_0_camera")
        assert panorama is not None
        gray = cv2.cvtColor(panorama, cv2.COLOR_RGB2GRAY)
        difference = np.abs(image.astype(float) - Resampling(camera, target, FACES["front"]).image(gray))
        assert difference.max() <= 1
        body = (source.truth or ())[k].T_world_robot["robot_0"]
        ahead = body.apply([[5.0, 0.3, 0.2], [3.0, -2.0, 1.0]])
        pixel = (rows["P0"] @ np.column_stack([T_camera_body.apply(body.inverse().apply(ahead)), np.ones(2)]).T).T
        mount = source.setup.mounts["robot_0_camera"]
        expected, inside = target.pixels_from_bearings((body @ mount.T_body_camera).inverse().apply(ahead))
        assert inside.all()
        assert_allclose(pixel[:, :2] / pixel[:, 2:], expected, atol=1e-6)


def test_a_second_camera_has_the_baseline_in_its_projection() -> None:
    """A camera 0.54 m to the right of the first: P1 has −fx · 0.54 in its last column (Geiger et al. 2013, eq. 3)."""
    view = straight("right", Pinhole(1242, 375, 718.0, 718.0, 607.0, 185.0))
    P1 = projection(view, Pose(np.eye(3), np.array([-0.54, 0.0, 0.0])))
    assert_allclose(P1, [[718, 0, 607, -718 * 0.54], [0, 718, 185, 0], [0, 0, 1, 0]])
