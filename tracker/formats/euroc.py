"""EuRoC MAV data (ASL): tables of images, of an IMU and of the true state with times in nanoseconds, and a sensor.yaml for each sensor.

Burri et al. 2016, "The EuRoC micro aerial vehicle datasets". Numbers are written so that reading gives the same float64.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.camera_parameters import OPTICAL, PANORAMAS, CameraParameters, ExportedView, camera_notes
from tracker.formats.camera_parameters import faces as cube_faces
from tracker.formats.exported_sequence import PNG, RecordedSequence
from tracker.geometry import Array, Pose, quaternion_from_rotation
from tracker.io.atomic import write_text
from tracker.types import Mount

IMAGES = ("timestamp [ns]", "filename")
IMU = ("timestamp [ns]", *(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"))
STATE = (
    "timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz"), *(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"),
    *(f"b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"), *(f"b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)  # fmt: skip
"""Columns of the three tables. The first line of a table is `#` and their names."""


def sensor_yaml(kind: str, comment: str, T_body_sensor: Pose, fields: dict[str, str | float | Sequence[float]]) -> str:
    """The text of a sensor.yaml. kind: camera, imu or visual-inertial. fields: the other fields, in order."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = T_body_sensor.rotation, T_body_sensor.translation
    numbers = ", ".join(repr(float(x) + 0.0) for x in matrix.ravel())
    lines = [f"sensor_type: {kind}", f"comment: {comment}", "T_BS:", "  cols: 4", "  rows: 4", f"  data: [{numbers}]"]
    for name, value in fields.items():
        shown = value if isinstance(value, str) else repr(value) if isinstance(value, float | int) else f"[{', '.join(map(repr, value))}]"
        lines.append(f"{name}: {shown}")
    return "\n".join(lines) + "\n"


def write_table(path: Path, columns: Sequence[str], stamps: Sequence[int], rows: Iterable[str]) -> None:
    """Write a table. stamps: times [ns]. rows: the text after each time."""
    lines = [f"#{','.join(columns)}", *(f"{stamp},{row}" for stamp, row in zip(stamps, rows, strict=True))]
    write_text(path, "".join(f"{line}\n" for line in lines))


def _texts(numbers: Array) -> Iterable[str]:
    return (",".join(repr(float(x)) for x in row) for row in numbers)


HALF_MICROSECOND = 5e-7
"""s: tolerance for times in tables, which are rounded to 9 digits. A sample at the time of a frame belongs to that frame."""
README = f"""
    SEQUENCE/ROBOT/mav0/body.yaml                              which robot this is
    SEQUENCE/ROBOT/mav0/cam0/data.csv                          time [ns] and name of each image, frames from 0; cam1 and so on are further cameras
    SEQUENCE/ROBOT/mav0/cam0/data/TIME.png                     images, RGB, 8 bit
    SEQUENCE/ROBOT/mav0/cam0/sensor.yaml                       calibration
    SEQUENCE/ROBOT/mav0/imu0/data.csv, sensor.yaml             samples of the IMU and its noise, where the sequence has one
    SEQUENCE/ROBOT/mav0/state_groundtruth_estimate0/data.csv   true states of the robot's body
    SEQUENCE/ROBOT/mav0/state_groundtruth_estimate0/sensor.yaml

A robot that moves is one MAV. Fixed cameras do not move and are left out. Times are nanoseconds: --epoch (0 where it was not given) · 10⁹ +
frame · period, frames from 0. Where the sequence's clocks have errors (generate --clock), images have the times of their camera's clock, and the
IMU those of its robot's clock; states have true times.
R is pilsim's world (right-handed, z up, metres), B and S are the robot's body (x forward, y left, z up).

sensor.yaml of a camera: T_BS, row by row, maps points of the camera's optical frame (x right, y down, z ahead) to the body's [metres].
resolution: width, height [px]. intrinsics: fx, fy, cx, cy [px]; the first pixel's centre is (0, 0). camera_model pinhole with distortion_model
radial-tangential (k1, k2, p1, p2, k3 as OpenCV has them; EuRoC's own files have four, and k3 is left out where it is 0) or equidistant (k1 to k4,
OpenCV's fisheye), or a panorama: equirectangular or cylindrical, which SLAM systems for pinholes do not read. With --faces panoramas are given as
pinholes of 90° in place of it: cam0 ahead, cam1 left, cam2 back, cam3 right, cam4 up, cam5 down, each with its exact T_BS.
{PANORAMAS}
state_groundtruth_estimate0: p_RS_R [m] and q_RS (w, x, y, z) are T_world_body. v_RS_R [m/s]: the difference of the places of the frames after and
before, over their times; one-sided in the first and last frame. b_w [rad/s] and b_a [m/s²] are the true biases of the IMU's last sample, 0 without
one. imu0: angular velocity w [rad/s] and specific force a [m/s²], about +9.81 along up at rest, along the axes of the body. A sample is the mean
over the time since the sample before. sensor.yaml has the true densities of noise and random walk in the units of EuRoC.
"""


def export_euroc(out: Path, recordings: Iterable[RecordedSequence], epoch: int = 0, faces: bool = False) -> list[str]:
    """Write the robots of all sequences. Returns notes on camera names, missing images and fitted distortions.

    epoch: time of frame 0 in whole seconds. faces: panoramas as pinhole images of cube faces.
    Raises ValueError where a sequence has no robot that moves.
    """
    notes = []
    for recording in recordings:
        mounts = moving_cameras(recording, "euroc")
        stamps = recording.stamps(epoch)
        pictured: list[tuple[Path, ExportedView, list[int]]] = []
        for robot, cameras in mounts.items():
            folder = out / recording.name / robot / "mav0"
            folder.mkdir(parents=True)
            write_text(folder / "body.yaml", f"comment: {robot} of {recording.name}\n")
            _write_states(folder / "state_groundtruth_estimate0", recording, robot, stamps)
            _write_imu(folder / "imu0", recording, robot, epoch)
            shown: list[tuple[Mount, ExportedView]] = []
            for name, mount in cameras.items():
                shown += [(mount, view) for view in (cube_faces(name, mount.camera) if faces else [ExportedView(name, name, mount.camera)])]
            for number, (mount, view) in enumerate(shown):
                sensor = folder / f"cam{number}"
                sensor.mkdir()
                write_text(sensor / "sensor.yaml", camera_yaml(view, mount.T_body_camera @ view.T_camera_view @ OPTICAL, recording.rate))
                if recording.has_images(view.source):
                    times = recording.clock_stamps(view.source, epoch)
                    write_table(sensor / "data.csv", IMAGES, times, [f"{time}{PNG}" for time in times])
                    (sensor / "data").mkdir()
                    pictured.append((sensor / "data", view, times))
            notes.append(f"{recording.name}, {robot}: " + ", ".join(f"cam{k} is {view.name}" for k, (_, view) in enumerate(shown)) + ".")
        for frame in recording.frames():
            for folder, view, times in pictured:
                (folder / f"{times[frame]}{PNG}").write_bytes(view.image(recording, frame, PNG))
        notes += camera_notes(recording, (name for cameras in mounts.values() for name in cameras), "they are left out")
    return notes


def moving_cameras(recording: RecordedSequence, form: str) -> dict[str, dict[str, Mount]]:
    """Robot that moves → its cameras. Raises ValueError where no robot moves."""
    out = {robot: {name: m for name, m in recording.setup.mounts.items() if m.robot == robot} for robot in recording.setup.moving_robots}
    if not out:
        raise ValueError(f"{recording.folder}: has no robot that moves, which {form} needs")
    return out


def camera_yaml(view: ExportedView, T_body_optical: Pose, rate: float) -> str:
    """The text of a camera's sensor.yaml."""
    p = CameraParameters.of(view.camera)
    model, distortion, numbers = p.model, "none", p.distortion
    if p.model == "pinhole":
        distortion, numbers = "radial-tangential", p.distortion if p.distortion[4] else p.distortion[:4]
    elif p.model == "fisheye":
        model, distortion = "pinhole", "equidistant"
    return sensor_yaml(
        "camera",
        view.name,
        T_body_optical,
        {
            "rate_hz": rate,
            "resolution": [view.camera.width, view.camera.height],
            "camera_model": model,
            "intrinsics": list(p.intrinsics),
            "distortion_model": distortion,
            "distortion_coefficients": list(numbers),
        },
    )


def velocities(poses: list[Pose], stamps: list[int]) -> Array:
    """(n, 3) m/s in the world: central differences of the places, one-sided at both ends; 0 for a single pose. stamps: ns."""
    places = np.array([pose.translation for pose in poses])
    return np.gradient(places, np.array(stamps) * 1e-9 - stamps[0] * 1e-9, axis=0) if len(poses) > 1 else np.zeros_like(places)


def _write_states(folder: Path, recording: RecordedSequence, robot: str, stamps: list[int]) -> None:
    folder.mkdir()
    poses = recording.true_poses(robot)
    biases = np.zeros((len(poses), 6))
    if (samples := recording.imu.get(robot)) is not None and len(samples.time):
        times = recording.setup.period * np.arange(len(poses)) + HALF_MICROSECOND
        last = np.maximum(np.searchsorted(samples.time, times, side="right") - 1, 0)
        biases = np.hstack([samples.gyro_bias[last], samples.force_bias[last]])
    places = np.array([[*pose.translation, *quaternion_from_rotation(pose.rotation)] for pose in poses]).reshape(-1, 7)
    write_table(folder / "data.csv", STATE, stamps, _texts(np.hstack([places, velocities(poses, stamps), biases])))
    write_text(folder / "sensor.yaml", sensor_yaml("visual-inertial", "true states of the body", Pose.identity(), {"rate_hz": recording.rate}))


def _write_imu(folder: Path, recording: RecordedSequence, robot: str, epoch: int) -> None:
    """Write the samples of the robot's IMU, if there are any."""
    if (samples := recording.imu.get(robot)) is None:
        return
    folder.mkdir()
    stamps = recording.nanoseconds(samples.stamp, epoch, robot)
    write_table(folder / "data.csv", IMU, stamps, _texts(np.hstack([samples.gyro, samples.force])))
    noise = recording.imu_noise(robot)
    fields: dict[str, str | float | Sequence[float]] = {
        "rate_hz": noise.rate,
        "gyroscope_noise_density": noise.gyro_noise,
        "gyroscope_random_walk": noise.gyro_walk,
        "accelerometer_noise_density": noise.force_noise,
        "accelerometer_random_walk": noise.force_walk,
    }
    write_text(folder / "sensor.yaml", sensor_yaml("imu", f"IMU of {robot}", noise.T_body_imu, fields))
