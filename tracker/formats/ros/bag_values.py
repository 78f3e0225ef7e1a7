"""Messages of ROS as values of the project: the inverse of messages.py, for the messages of any robot."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from tracker.geometry import Array, Ints, tangent_basis
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Cylinder, Fisheye, Panorama, Pinhole
from tracker.geometry.ground import Grid
from tracker.io.image_files import PNG, encoded, image_size

MODELS = ("panorama", "pinhole", "fisheye", "cylinder")
DISTORTION_MODELS = {
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "equirectangular": "panorama",
    "cylindrical": "cylinder",
}
"""distortion_model of CameraInfo → the model of a camera. The last two are those of our own export."""
TO_BGR: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "8UC4": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "mono8": (1, None),
    "8UC1": (1, None),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUYV),
}
"""Encoding of Image → bytes of a pixel, and OpenCV's conversion."""
PLUMB_BOB = 5
"""Number of coefficients of plumb_bob. A rational model whose other coefficients are 0 equals plumb_bob."""
CYLINDER, ADD = 3, 0
"""Marker.CYLINDER and Marker.ADD."""


def stamp_of(message: Any) -> int:
    """Time of the header [ns]. rosbags uses the same field names for ROS 1 and ROS 2."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def picture(message: Any) -> tuple[bytes, str]:
    """Image or CompressedImage → the bytes of a file and its suffix. An Image becomes a PNG. Raises ValueError for an unknown encoding."""
    form = getattr(message, "format", None)
    if form is None:
        return encoded("image.png", _pixels(message), PNG), ".png"
    data = message.data.tobytes()
    if image_size(data) is None or form.startswith(("16UC1", "32FC1", "bayer")):
        raise ValueError(f"format is {form!r}, needs JPEG or PNG of colours")
    return data, ".png" if data.startswith(b"\x89PNG") else ".jpg"


def _pixels(message: Any) -> Any:
    """(H, W, 3) BGR or (H, W) grey uint8 of an Image."""
    if message.encoding not in TO_BGR:
        raise ValueError(f"encoding is {message.encoding!r}, needs one of {', '.join(TO_BGR)}")
    (size, conversion), height, width = TO_BGR[message.encoding], message.height, message.width
    if not (height and width and message.step >= width * size and len(message.data) >= message.step * height):
        raise ValueError(f"image of {width} x {height} px has {len(message.data)} bytes in rows of {message.step}, needs {size} a pixel")
    rows = message.data[: message.step * height].reshape(height, message.step)[:, : width * size]
    pixels = np.ascontiguousarray(rows if size == 1 else rows.reshape(height, width, size))
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)


def camera_from_info(info: Any, model: str) -> Camera:
    """The camera of a CameraInfo. model: one of MODELS that overrides its distortion_model, or "". Raises ValueError for missing numbers."""
    # ROS 1 names the fields in capital letters.
    K, D = (np.asarray(getattr(info, name, getattr(info, name.lower(), ()))) for name in "KD")
    width, height = int(info.width), int(info.height)
    if not model and info.distortion_model not in DISTORTION_MODELS:
        raise ValueError(f"distortion_model is {info.distortion_model!r}, needs one of {', '.join(filter(None, DISTORTION_MODELS))}, or TOPIC=MODEL")
    model = model or DISTORTION_MODELS[info.distortion_model]
    if info.binning_x > 1 or info.binning_y > 1 or info.roi.width or info.roi.height:
        raise ValueError("images are binned or cut (binning, roi), needs whole images")
    if model == "panorama":
        return Panorama(width, height)
    if model == "cylinder":
        if len(D) != 4 or info.distortion_model != "cylindrical":
            raise ValueError("has no numbers of a cylinder, needs --calibration with horizon and focal")
        return Cylinder(width, height, horizon=float(D[3]) + 0.5, focal=float(D[1]))
    if not K.any():
        raise ValueError("K is zero, needs a calibrated camera, TOPIC=panorama, or --calibration")
    numbers = dict(zip(("fx", "fy", "cx", "cy"), map(float, K[[0, 4, 2, 5]]), strict=True))
    count = 4 if model == "fisheye" else PLUMB_BOB
    if len(D) > count and D[count:].any():
        raise ValueError(f"distortion has {len(D)} numbers, needs {count} of the model {model}")
    distortion = tuple(map(float, D[:count])) + (0.0,) * (count - len(D))
    return (Fisheye if model == "fisheye" else Pinhole)(width, height, **numbers, distortion=distortion)


def boxes_from_message(message: Any) -> tuple[Array, Array]:
    """Detection2DArray → boxes (n, 4) left, top, width, height px from the centre of the first pixel, and scores (n,), 1 where there are none."""
    boxes, scores = [], []
    for detection in message.detections:
        box = detection.bbox
        centre = getattr(box.center, "position", box.center)  # vision_msgs 4 has `position`, older versions do not
        boxes.append([centre.x - box.size_x / 2, centre.y - box.size_y / 2, box.size_x, box.size_y])
        scores.append(max((getattr(r, "hypothesis", r).score for r in detection.results), default=1.0))
    return np.array(boxes, dtype=np.float64).reshape(-1, 4), np.array(scores, dtype=np.float64)


def directions_from_message(message: Any) -> tuple[Array, Array]:
    """Detection2DArray of our own export → directions (n, 3) of unit length in the camera's frame, and covariances (n, 2, 2) rad²."""
    poses = [detection.results[0].pose for detection in message.detections]
    bearing = np.array([[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in poses]).reshape(-1, 3) @ OPTICAL_FROM_CAMERA
    spread = np.array([p.covariance for p in poses]).reshape(-1, 6, 6)[:, :3, :3]
    basis = tangent_basis(bearing) @ OPTICAL_FROM_CAMERA.T
    return bearing, np.asarray(basis @ spread @ np.swapaxes(basis, 1, 2))


def people_from_markers(message: Any) -> tuple[Ints, Array]:
    """MarkerArray of /truth/people → ids (k,) and feet (k, 3) m."""
    found = [m for m in message.markers if m.ns == "people" and m.type == CYLINDER and m.action == ADD]
    feet = [[m.pose.position.x, m.pose.position.y, m.pose.position.z - m.scale.z / 2] for m in found]
    return np.array([m.id for m in found], dtype=np.int64), np.array(feet, dtype=np.float64).reshape(-1, 3)


def grids_from_map(message: Any) -> dict[str, Grid]:
    """GridMap → layer → height map. Raises ValueError for a rotated map, and for cells without a height."""
    info, turn = message.info, message.info.pose.orientation
    if max(abs(turn.x), abs(turn.y), abs(turn.z)) > 1e-9 or message.outer_start_index or message.inner_start_index:
        raise ValueError("map is turned or begins in the middle, needs rows along y from its first cell on")
    centre = np.array([info.pose.position.x, info.pose.position.y])
    out = {}
    for layer, values in zip(message.layers, message.data, strict=True):
        rows, columns = (dimension.size for dimension in values.layout.dim)
        heights = np.asarray(values.data, dtype=np.float64).reshape(rows, columns)[::-1, ::-1]
        if not np.isfinite(heights).all():
            raise ValueError(f"layer {layer!r} has cells without a height")
        origin = centre - np.array([columns - 1, rows - 1]) * info.resolution / 2
        out[layer] = Grid(heights, origin, float(info.resolution))
    return out
