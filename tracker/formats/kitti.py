"""KITTI odometry: trajectories of 12 numbers a line, times, and calibrations of rectified cameras (Geiger et al. 2012)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.camera_parameters import OPTICAL, CameraParameters, ExportedView, camera_notes, straight
from tracker.formats.euroc import moving_cameras
from tracker.formats.exported_sequence import PNG, RecordedSequence
from tracker.geometry import Array, Pose
from tracker.io.atomic import write_text

CAMERAS = 4
"""Cameras of a calibration: P0 to P3."""


def write_poses(path: Path, poses: Iterable[Pose]) -> None:
    """Write poses, one a line: the upper three rows of the 4 × 4 matrix, row by row, in metres. Reading gives the same float64."""
    write_text(path, "".join(f"{_numbers(pose_matrix(pose))}\n" for pose in poses))


def write_times(path: Path, times: Sequence[float]) -> None:
    """Write times [s], one a line."""
    write_text(path, "".join(f"{time:.9e}\n" for time in times))


def write_calibration(path: Path, projections: Sequence[Array], transform: Pose) -> None:
    """Write P0 to P3, each (3, 4) px from points in the frame of camera 0, and Tr. Tr is the pose of the body in that frame.

    Where there are fewer than four cameras, the last is repeated, because readers need four.
    """
    filled = [projections[min(k, len(projections) - 1)] for k in range(CAMERAS)]
    lines = [f"P{k}: {_numbers(P)}\n" for k, P in enumerate(filled)]
    write_text(path, "".join(lines) + f"Tr: {_numbers(pose_matrix(transform))}\n")


def pose_matrix(pose: Pose) -> Array:
    """(3, 4): rotation and translation."""
    return np.column_stack([pose.rotation, pose.translation])


def _numbers(matrix: Array) -> str:
    return " ".join(repr(float(x) + 0.0) for x in matrix.ravel())


README = """
    SEQUENCE/sequences/00/image_0/000000.png   images, grey, 8 bit, frames from 0; image_1 and so on are further cameras of the robot
    SEQUENCE/sequences/00/times.txt            time of each frame [s] from the first
    SEQUENCE/sequences/00/calib.txt            P0 to P3 and Tr
    SEQUENCE/sequences/00/first_pose.txt       ours: pose of camera 0 of frame 0 in pilsim's world (right-handed, z up, metres), 12 numbers
    SEQUENCE/poses/00.txt                      true poses of camera 0, frames from 0, 12 numbers a line

A sequence number is a robot that moves, from 00. Fixed cameras do not move and are left out. Camera 0 is image_0's: x right, y down, z ahead.
poses: the upper three rows of the 4 × 4 matrix, row by row [metres]. It maps points in the camera of its frame to the camera of frame 0, so that
the first is the identity; first_pose.txt times it is T_world_camera.
calib.txt: P of camera k, 3 × 4, row by row [px]: its pixel, the first pixel's centre at (0, 0), is P times a point in the frame of camera 0 [metres].
Tr maps points of the robot's body (x forward, y left, z up) to camera 0; KITTI has a laser scanner there. P1 to P3 repeat the last camera where the
robot has fewer.

The format knows pinholes without distortion alone. A camera with a distortion is resampled into a pinhole of the same focal lengths. A panorama is
given as its front view: 90° by 90°, with the same centre and axes. For all of a panorama export euroc (--faces) or colmap.
`evo_traj kitti SEQUENCE/poses/00.txt` reads the poses.
"""


def export_kitti(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write the robots of all sequences. Returns notes that name them. Raises ValueError where a sequence has no robot that moves."""
    notes = []
    for recording in recordings:
        root, pictured = out / recording.name, list[tuple[Path, ExportedView]]()
        mounts = moving_cameras(recording, "kitti")
        (root / "poses").mkdir(parents=True)
        for number, (robot, cameras) in enumerate((robot, cameras) for robot, cameras in mounts.items() if cameras):
            folder = root / "sequences" / f"{number:02d}"
            folder.mkdir(parents=True)
            views = [straight(name, mount.camera) for name, mount in cameras.items()]
            seats = [mount.T_body_camera @ view.T_camera_view @ OPTICAL for mount, view in zip(cameras.values(), views, strict=True)]
            write_times(folder / "times.txt", [k * recording.setup.period for k in range(len(recording.truth))])
            projections = [projection(view, seat.inverse() @ seats[0]) for view, seat in zip(views, seats, strict=True)]
            write_calibration(folder / "calib.txt", projections, seats[0].inverse())
            poses = [pose @ seats[0] for pose in recording.true_poses(robot)]
            write_poses(folder / "first_pose.txt", poses[:1])
            write_poses(root / "poses" / f"{number:02d}.txt", [poses[0].inverse() @ pose for pose in poses])
            for k, view in enumerate(views):
                if recording.has_images(view.source):
                    (folder / f"image_{k}").mkdir()
                    pictured.append((folder / f"image_{k}", view))
            pictures = ", ".join(f"image_{k} is {view.name}" for k, view in enumerate(views))
            notes.append(f"{recording.name}: {number:02d} is {robot}; {pictures}.")
        for frame in recording.frames():
            for folder, view in pictured:
                (folder / f"{frame:06d}{PNG}").write_bytes(view.image(recording, frame, PNG, gray=True))
        notes += camera_notes(recording, (name for cameras in mounts.values() for name in cameras), "they are left out")
    return notes


def projection(view: ExportedView, T_view_first: Pose) -> Array:
    """P (3, 4) px of a view without distortion: K [R | t] from points in the optical frame of camera 0."""
    p = CameraParameters.of(view.camera)
    K = np.array([[p.fx, 0.0, p.cx], [0.0, p.fy, p.cy], [0.0, 0.0, 1.0]])
    return np.asarray(K @ np.column_stack([T_view_first.rotation, T_view_first.translation]))
