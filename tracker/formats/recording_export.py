"""Export of a sequence of pilsim as a recording of one's own (recording.json)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from tracker.formats.exported_sequence import JPEG, PNG, RecordedSequence
from tracker.geometry import Array, Pose
from tracker.recordings import Recording, RecordingCamera, RecordingRobot
from tracker.recordings.folder import write_recording
from tracker.recordings.images import ImageFiles
from tracker.types import Odometry, RobotDetections

README = """
    SEQUENCE/recording.json               rate [1/s], area [m], ground [m, or terrain.npz], height [m], frames, and the cameras
    SEQUENCE/detections/CAMERA.txt        MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    SEQUENCE/detections/CAMERA.covariance.npy   covariance of each box [rad²] by the detector: c00, c01, c11 (azimuth, elevation), a row for each box
    SEQUENCE/robot_detections.csv         other robots that a camera sees, frames from 1, columns as companions.csv of a sequence of pilsim
    SEQUENCE/truth.txt                    MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    SEQUENCE/images/CAMERA/000001.jpg     images, frames from 1; or video/CAMERA.mp4
    SEQUENCE/robots.json                  robots that carry cameras: where they start (position [m], quaternion w, x, y, z; covariance 6 x 6)
    SEQUENCE/odometry.csv                 their motion since the frame before, frames from 1, columns as in a sequence of pilsim
    SEQUENCE/robot_truth.csv              their true poses, frames from 1

Cameras: x_camera = R x_world + t [m], x right, y down, z ahead; on a robot, x_camera = R x_robot + t with x ahead, y left, z up of the robot.
K and distortion are OpenCV's, for the first pixel's centre at (0, 0). An equirectangular or cylindrical image begins at its corner (0, 0).
World: right-handed, z up. Boxes may lie partly outside the image.

own_body of a camera on a robot: rows of 0 and 1 over all directions, as in an equirectangular image; 1 where it sees its own robot.

A recording does not hold: masks, key points, visibility in each camera, and samples of IMUs (export to EuRoC or MCAP has them).
"""


def export_recording(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write each sequence as a recording into out/NAME. Returns no notes."""
    for sequence in recordings:
        (out / sequence.name).mkdir()
        write_recording(out / sequence.name, recording_of(sequence))
    return []


def recording_of(sequence: RecordedSequence) -> Recording:
    """A sequence of pilsim as a recording. Boxes of detections are recovered from their angles."""
    setup = sequence.setup
    cameras, robots = {}, {}
    for name, mount in setup.mounts.items():
        start = setup.starts[mount.robot]
        if setup.is_fixed(mount.robot):
            assert start is not None
            cameras[name] = RecordingCamera(mount.camera, start.T_world_robot @ mount.T_body_camera)
        else:
            cameras[name] = RecordingCamera(mount.camera, mount.T_body_camera, mount.robot, own_body=mount.own_body)
    moved = list(sequence.sequence.ticks.odometry())
    for robot in setup.moving_robots:
        odometry: dict[int, Odometry] = {frame: of_frame[robot] for frame, of_frame in enumerate(moved) if robot in of_frame}
        truth: dict[int, Pose] = {t.index: t.T_world_robot[robot] for t in sequence.truth}
        robots[robot] = RecordingRobot(setup.starts[robot], odometry, truth)
    images = {name: _images(sequence, name) for name in cameras}
    seen: dict[str, dict[int, RobotDetections]] = {}
    for (frame, name), robots_seen in sequence.robot_detections.items():
        seen.setdefault(name, {})[frame] = robots_seen
    covariances: dict[str, dict[int, Array]] = {}
    for (frame, name), found in sequence.detections.items():
        covariances.setdefault(name, {})[frame] = found.covariance.reshape(-1, 4)[:, [0, 1, 3]]
    _check_images(sequence, images)
    return Recording(
        sequence.rate,
        cameras,
        {name: sequence.camera_boxes(name, mount.camera.pixel_centre - 0.5) for name, mount in setup.mounts.items()},
        {t.index: (t.person_id, t.feet) for t in sequence.truth},
        frames=len(sequence.truth),
        area=setup.area,
        ground=setup.ground,
        height=setup.height,
        occluders=setup.occluders,
        pillars=setup.pillars,
        covariances=covariances,
        robot_detections=seen,
        visible={t.index: t.visible.max(axis=1, initial=0.0) for t in sequence.truth},
        images={name: of_camera for name, of_camera in images.items() if of_camera.files},
        robots=robots,
    )


def _check_images(sequence: RecordedSequence, images: dict[str, ImageFiles]) -> None:
    """Raises ValueError for an image that differs from the manifest."""
    for frame in sequence.frames():
        for name, files in images.items():
            if frame in files.files:
                sequence.image(frame, name, files.files[frame].suffix)


def _images(sequence: RecordedSequence, camera: str) -> ImageFiles:
    frames = len(sequence.truth)
    files = {frame: sequence.folder / "images" / camera / f"{frame:06d}" for frame in range(frames)}
    return ImageFiles({k: file.with_suffix(end) for k, file in files.items() for end in (JPEG, PNG) if file.with_suffix(end).is_file()})
