"""TUM export: evo reads the files and computes the same errors."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, RATE
from tracker.geometry import Pose, rotation_from_quaternion
from tracker.metrics.trajectory import score_robots
from tracker.sequence.reader import read_sequence
from tracker.types.sequence import dead_reckoning

Exported = Callable[[str], Path]


def test_evo_computes_the_same_errors(sequence: Path, exported: Exported) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    from evo.core import metrics, sync

    root = exported("tum") / "plaza"
    reference = file_interface.read_tum_trajectory_file(str(root / "robot_0.txt"))
    estimate = file_interface.read_tum_trajectory_file(str(root / "robot_0_odometry.txt"))
    reference, estimate = sync.associate_trajectories(reference, estimate)
    assert reference.num_poses == FRAMES
    source = read_sequence(sequence)
    truth = {"robot_0": [t.T_world_robot["robot_0"] for t in source.truth or ()]}
    ours = score_robots(truth, dead_reckoning(source))
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, estimate))
    assert_allclose(ape.get_statistic(metrics.StatisticsType.rmse), ours.ate_m, rtol=1e-9)
    assert ours.ate_m > 0.001
    rpe = metrics.RPE(metrics.PoseRelation.translation_part, delta=1, delta_unit=metrics.Unit.frames)
    rpe.process_data((reference, estimate))
    assert_allclose(rpe.get_statistic(metrics.StatisticsType.rmse), ours.rpe_m, rtol=1e-9)
    estimate.align(reference, correct_scale=False)
    ape.process_data((reference, estimate))
    assert_allclose(ape.get_statistic(metrics.StatisticsType.rmse), ours.ate_aligned_m, rtol=1e-6)


def read(path: Path) -> tuple[np.ndarray, list[Pose]]:
    """Times and poses; the quaternion is xyzw."""
    table = np.loadtxt(path)
    return table[:, 0], [Pose(rotation_from_quaternion(row[[7, 4, 5, 6]]), row[1:4]) for row in table]


def test_poses_equal_the_sequence(sequence: Path, exported: Exported) -> None:
    source = read_sequence(sequence)
    mount = source.setup.mounts["robot_0_camera"]
    times, poses = read(exported("tum") / "plaza" / "robot_0.txt")
    _, cameras = read(exported("tum") / "plaza" / "robot_0_camera.txt")
    assert_allclose(times, np.arange(FRAMES) / RATE)
    for truth, pose, camera in zip(source.truth or (), poses, cameras, strict=True):
        assert_array_equal(pose.translation, truth.T_world_robot["robot_0"].translation)
        assert_allclose(pose.rotation, truth.T_world_robot["robot_0"].rotation, atol=1e-12)
        assert_allclose((camera.inverse() @ pose @ mount.T_body_camera).log(), 0, atol=1e-9)
    assert sorted(p.name for p in (exported("tum") / "plaza").iterdir()) == ["robot_0.txt", "robot_0_camera.txt", "robot_0_odometry.txt"]
