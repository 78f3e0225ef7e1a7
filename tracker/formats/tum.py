"""TUM trajectories: lines `timestamp tx ty tz qx qy qz qw` in seconds and metres, quaternion xyzw; `#` begins a comment."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from tracker.formats.euroc import moving_cameras
from tracker.formats.exported_sequence import RecordedSequence
from tracker.geometry import Array, Pose, quaternion_from_rotation
from tracker.io.atomic import write_text
from tracker.types.sequence import dead_reckoning

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def write_tum(path: str | os.PathLike[str], times: Sequence[float] | Array, poses: Sequence[Pose]) -> None:
    """Write times (n,) s and n poses T_world_body atomically."""
    lines = ["# " + " ".join(COLUMNS) + "\n"]
    for time, pose in zip(times, poses, strict=True):
        w, x, y, z = quaternion_from_rotation(pose.rotation)
        lines.append(" ".join(repr(float(value)) for value in (time, *pose.translation, x, y, z, w)) + "\n")
    write_text(Path(path), "".join(lines))


README = """
    SEQUENCE/ROBOT.txt           true poses of the robot's body
    SEQUENCE/ROBOT_odometry.txt  what odometry alone makes of its start pose: an estimate to begin with
    SEQUENCE/CAMERA_camera.txt   true poses of the camera, of those that move

A line is `timestamp tx ty tz qx qy qz qw`: seconds from the first frame (frame · period, frames from 0), metres, and a unit quaternion, w last.
It is T_world_body: it maps points of the body (x forward, y left, z up) to pilsim's world (right-handed, z up, its own origin). `#` begins a
comment. `evo_ape tum SEQUENCE/robot_0.txt SEQUENCE/robot_0_odometry.txt` gives the error of position. Fixed cameras do not move and have no file.
"""


def export_tum(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write trajectories of all moving robots. Raises ValueError where a sequence has none."""
    for recording in recordings:
        robots = moving_cameras(recording, "tum")
        folder = out / recording.name
        folder.mkdir(parents=True)
        times = [k * recording.setup.period for k in recording.frames()]
        odometry_poses = dead_reckoning(recording.sequence)
        for robot in robots:
            write_tum(folder / f"{robot}.txt", times, [t.T_world_robot[robot] for t in recording.truth])
            poses = [pose for pose in odometry_poses.get(robot, []) if pose is not None]
            if len(poses) == len(times):
                write_tum(folder / f"{robot}_odometry.txt", times, poses)
        for camera, mount in recording.setup.mounts.items():
            if mount.robot in robots:
                poses = [t.T_world_robot[mount.robot] @ mount.T_body_camera for t in recording.truth]
                write_tum(folder / f"{camera.removesuffix('_camera')}_camera.txt", times, poses)
    return []
