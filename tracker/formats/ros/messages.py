"""Values of the project as fields of ROS 2 messages. Lengths are metres; quaternions of ROS are xyzw; the first pixel's centre is (0, 0)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from tracker.formats.camera_parameters import CameraParameters
from tracker.geometry import Array, Pose, quaternion_from_rotation, skew, tangent_basis
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera
from tracker.geometry.ground import Grid
from tracker.types import RobotDetections, Start

Message = dict[str, Any]
GRAVITY = 9.81
"""m/s²: specific force of a body at rest."""

DISTORTION_MODELS = {"pinhole": "plumb_bob", "fisheye": "equidistant", "equirectangular": "equirectangular", "cylindrical": "cylindrical"}
"""Model of CameraParameters → distortion_model of CameraInfo. ROS defines the first two, pilsim the others."""


def time_message(stamp: int) -> Message:
    """Nanoseconds as Time or Duration."""
    return {"sec": stamp // 10**9, "nanosec": stamp % 10**9}


def header(stamp: int, frame: str) -> Message:
    """Header: time [ns], and the coordinate frame of the message's values."""
    return {"stamp": time_message(stamp), "frame_id": frame}


def vector(values: Array) -> Message:
    """(3,) as Point or Vector3."""
    x, y, z = values.tolist()
    return {"x": x, "y": y, "z": z}


def quaternion(rotation: Array) -> Message:
    """Rotation (3, 3) as Quaternion."""
    w, x, y, z = quaternion_from_rotation(rotation).tolist()
    return {"x": x, "y": y, "z": z, "w": w}


def pose_message(pose: Pose) -> Message:
    """Pose: T_frame_child."""
    return {"position": vector(pose.translation), "orientation": quaternion(pose.rotation)}


def transform(parent: str, child: str, T_parent_child: Pose, stamp: int) -> Message:
    """TransformStamped: it maps points of `child` to `parent`."""
    value = {"translation": vector(T_parent_child.translation), "rotation": quaternion(T_parent_child.rotation)}
    return {"header": header(stamp, parent), "child_frame_id": child, "transform": value}


def compressed_image(data: bytes, suffix: str, stamp: int, frame: str) -> Message:
    """CompressedImage of the bytes of a file. suffix: .jpg or .png."""
    return {"header": header(stamp, frame), "format": "jpeg" if suffix == ".jpg" else "png", "data": data}


def camera_info(camera: Camera, stamp: int, frame: str) -> Message:
    """CameraInfo. A panorama has K and P of zeros, which ROS reads as "no pinhole", and d = [fx, fy, cx, cy] of its model."""
    p = CameraParameters.of(camera)
    message: Message = {"header": header(stamp, frame), "height": camera.height, "width": camera.width}
    message["distortion_model"] = DISTORTION_MODELS[p.model]
    message["r"] = np.eye(3).ravel().tolist()
    if p.model not in ("pinhole", "fisheye"):
        return message | {"d": list(p.intrinsics), "k": [0.0] * 9, "p": [0.0] * 12}
    K = np.array([[p.fx, 0.0, p.cx], [0.0, p.fy, p.cy], [0.0, 0.0, 1.0]])
    return message | {"d": list(p.distortion), "k": K.ravel().tolist(), "p": np.column_stack([K, np.zeros(3)]).ravel().tolist()}


def odometry_message(pose: Pose, covariance: Array, tangent: Array, tangent_covariance: Array, where: tuple[int, str, str]) -> Message:
    """Odometry. pose: T_frame_child. covariance (6, 6): of position along and rotation about the axes of the frame.

    tangent (6,): velocities of the child's frame [m/s, rad/s] along its own axes, and their covariance (6, 6). where: time [ns], frame, child.
    """
    stamp, frame, child = where
    twist = {"linear": vector(tangent[:3]), "angular": vector(tangent[3:])}
    return {
        "header": header(stamp, frame),
        "child_frame_id": child,
        "pose": {"pose": pose_message(pose), "covariance": covariance.ravel().tolist()},
        "twist": {"twist": twist, "covariance": tangent_covariance.ravel().tolist()},
    }


def composed_covariance(covariance: Array, step: Pose, noise: Array) -> Array:
    """Covariance (6, 6) of the right tangent of T ∘ step, from that of T and the step's `noise` (6, 6).

    With T ⊕ ξ = T · Exp(ξ) and Exp of R³ × SO(3): ξ' = F ξ + η, F = [[Rᵀ, −Rᵀ [t]×], [0, Rᵀ]] for the step's R and t.
    """
    F = np.zeros((6, 6))
    F[:3, :3] = F[3:, 3:] = step.rotation.T
    F[:3, 3:] = -step.rotation.T @ skew(step.translation)
    return np.asarray(F @ covariance @ F.T + noise)


def fixed_axes(covariance: Array, rotation: Array) -> Array:
    """Covariance (6, 6) of a right tangent → that along and about the axes of the parent frame. rotation (3, 3): of the pose."""
    R = np.kron(np.eye(2), rotation)
    return np.asarray(R @ covariance @ R.T)


def start_message(start: Start, stamp: int, frame: str) -> Message:
    """PoseWithCovarianceStamped of a robot's start; the covariance is along and about the axes of the frame."""
    covariance = fixed_axes(start.covariance, start.T_world_robot.rotation)
    return {"header": header(stamp, frame), "pose": {"pose": pose_message(start.T_world_robot), "covariance": covariance.ravel().tolist()}}


def up_message(up: Array, sigma: float, stamp: int, frame: str) -> Message:
    """Imu of a direction of up (3,) with its error [rad], as the specific force at rest. It has no orientation and no angular velocity."""
    message = imu_message(np.zeros(3), up * GRAVITY, (0.0, sigma * GRAVITY), stamp, frame)
    # −1 in the first entry: the value is unknown (sensor_msgs/Imu).
    return message | {"angular_velocity_covariance": [-1.0] + [0.0] * 8}


def map_message(layers: dict[str, Grid], stamp: int, frame: str) -> Message:
    """GridMap of height maps on one grid. Its first cell has the highest x and y, and x falls along the rows of memory."""
    grid = next(iter(layers.values()))
    (rows, columns), step = grid.heights.shape, grid.spacing
    centre = np.append(grid.origin + np.array([columns - 1, rows - 1]) * step / 2, 0.0)
    dimensions = [
        {"label": "column_index", "size": rows, "stride": rows * columns},
        {"label": "row_index", "size": columns, "stride": columns},
    ]
    return {
        "header": header(stamp, frame),
        "info": {"resolution": step, "length_x": columns * step, "length_y": rows * step, "pose": {"position": vector(centre)}},
        "layers": list(layers),
        "basic_layers": list(layers)[:1],
        "data": [{"layout": {"dim": dimensions}, "data": layer.heights[::-1, ::-1].ravel()} for layer in layers.values()],
    }


def imu_message(rate: Array, force: Array, sigma: tuple[float, float], stamp: int, frame: str) -> Message:
    """Imu: angular velocity (3,) rad/s and specific force (3,) m/s². sigma: white noise of a sample, rad/s and m/s². It has no orientation."""
    spread = [(s * s * np.eye(3)).ravel().tolist() for s in sigma]
    return {
        "header": header(stamp, frame),
        "orientation": {"w": 1.0},
        # −1 in the first entry: the orientation is unknown (sensor_msgs/Imu).
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "angular_velocity": vector(rate),
        "angular_velocity_covariance": spread[0],
        "linear_acceleration": vector(force),
        "linear_acceleration_covariance": spread[1],
    }


def wheels_message(names: Iterable[str], angles: Array, stamp: int, frame: str) -> Message:
    """JointState: total angle of each wheel, rad."""
    return {"header": header(stamp, frame), "name": list(names), "position": angles.tolist()}


def detections_message(boxes: Array, scores: Array, ids: Iterable[str], top: Message, directions: list[Message] | None = None) -> Message:
    """Detection2DArray of people. boxes (n, 4): left, top, width, height px from the image's corner. scores (n,). ids: n texts.

    top: header of the message. directions: PoseWithCovariance of each box, as direction_messages makes them.
    """
    detections = [
        {
            "header": top,
            "results": [{"hypothesis": {"class_id": "person", "score": score}, "pose": pose}],
            "bbox": {"center": {"position": {"x": left + width / 2 - 0.5, "y": up + height / 2 - 0.5}}, "size_x": width, "size_y": height},
            "id": name,
        }
        for (left, up, width, height), score, name, pose in zip(boxes.tolist(), scores.tolist(), ids, directions or [{}] * len(boxes), strict=True)
    ]
    return {"header": top, "detections": detections}


def direction_messages(bearing: Array, covariance: Array) -> list[Message]:
    """PoseWithCovariance of directions (n, 3) of unit length in the camera's frame, x ahead; covariance (n, 2, 2) rad² in their tangent planes.

    Positions and their covariances are along the axes of the optical frame.
    """
    basis = tangent_basis(bearing) @ OPTICAL_FROM_CAMERA.T
    out = []
    for place, spread in zip(bearing @ OPTICAL_FROM_CAMERA.T, np.swapaxes(basis, 1, 2) @ covariance @ basis, strict=True):
        full = np.zeros((6, 6))
        full[:3, :3] = spread
        out.append({"pose": {"position": vector(place)}, "covariance": full.ravel().tolist()})
    return out


def robots_message(seen: RobotDetections, pixels: Array, top: Message) -> Message:
    """Detection2DArray of other robots: points without a size at `pixels` (n, 2), and directions. top: header of the message."""
    message = detections_message(
        np.column_stack([pixels, np.zeros_like(pixels)]), np.ones(len(seen)), seen.robot, top, direction_messages(seen.bearing, seen.covariance)
    )
    for detection in message["detections"]:
        detection["results"][0]["hypothesis"]["class_id"] = "robot"
    return message
