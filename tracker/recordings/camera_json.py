"""A camera of recording.json: its entry and the RecordingCamera that it stands for.

    {"model": "pinhole", "width": 1920, "height": 1080, "K": (3, 3) px, "distortion": [k1, k2, p1, p2, k3], "R": (3, 3), "t": [x, y, z] m}
    {"model": "fisheye", ... "K", "distortion": [k1, k2, k3, k4]}                        as OpenCV's fisheye model
    {"model": "equirectangular", ...}                                                    width = 2 height
    {"model": "cylindrical", ... "horizon": row of the horizon, "focal": px}             v = horizon + focal · tan(−elevation)
    {"model": "tsai", ... "focal", "kappa1", "cx", "cy", "sx", "dpx", "dpy"}             as PETS 2009 has them: mm, 1/mm², px

x_camera = R x_world + t with optical axes: x right, y down, z ahead, as OpenCV has them. A panorama looks ahead in its middle.
A camera whose pose is not known has neither R nor t, and one of which nothing is known has width and height alone; `pilsim calibrate` finds them.
A camera on a robot has "robot": NAME, and x_camera = R x_robot + t with the robot's axes x ahead, y left, z up. A lens may lack "distortion".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from difflib import get_close_matches
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.geometry.camera_protocol import MAX_SIDE
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai
from tracker.recordings.recording import RecordingCamera

ROUNDED = 1e-3
"""Largest |R Rᵀ − 1| of a rotation with rounded digits. The nearest rotation is taken."""
EXACT = 1e-12
"""|R Rᵀ − 1| up to which a rotation is taken as it is."""
SKEW = 1e-3
"""px: largest skew that is taken for 0."""
LARGEST, LEAST = 1e9, 1e-12
"""Largest number in an entry, and least number above 0 of a camera model: beyond, powers overflow."""
POSE = ("R", "t")
FIELDS: dict[str, tuple[str, ...]] = {
    "pinhole": ("K",),
    "fisheye": ("K",),
    "equirectangular": (),
    "cylindrical": ("horizon", "focal"),
    "tsai": ("focal", "kappa1", "cx", "cy", "sx", "dpx", "dpy"),
}
"""Model → the fields that it needs beside model, width, height, R and t."""
DISTORTION = {"pinhole": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}
"""Models of OpenCV → the names of their distortion numbers."""
CLASSES: dict[str, type[Pinhole | Fisheye | Panorama | Cylinder | Tsai]] = {
    "pinhole": Pinhole,
    "fisheye": Fisheye,
    "equirectangular": Panorama,
    "cylindrical": Cylinder,
    "tsai": Tsai,
}
CLOCK = ("offset_s", "rate")
"""Optional fields of a camera's clock (clocks.py)."""
SYNONYMS = {
    "opencv": "pinhole",
    "perspective": "pinhole",
    "radtan": "pinhole",
    "plumb_bob": "pinhole",
    "equidistant": "fisheye",
    "kannala-brandt": "fisheye",
    "omnidirectional": "fisheye",
    "panorama": "equirectangular",
    "spherical": "equirectangular",
}
"""What other programs call these models, for the error message."""


def camera_from(entry: Any, where: str) -> RecordingCamera:
    """The camera of an entry. Raises ValueError in one line that begins with `where`, for instance "recording.json: cameras.C1"."""
    if not isinstance(entry, Mapping):
        raise ValueError(f"{where} is {_short(entry)}, needs an object with model, width, height, R and t")
    if "R" not in entry and "t" not in entry and "robot" not in entry:
        return _uncalibrated(entry, where)
    model = _model(entry, where)
    _check_keys(entry, model, where)
    robot = entry.get("robot")
    if robot is not None and (not isinstance(robot, str) or not robot.strip()):
        raise ValueError(f"{where}.robot is {_short(robot)}, needs the name of a robot")
    camera = _camera(entry, model, where)
    rotation, translation = _rotation(entry["R"], f"{where}.R"), _numbers(_row(entry["t"]), 3, f"{where}.t", "x, y, z in metres")
    return RecordingCamera.of_opencv(camera, rotation, translation, robot)


def _uncalibrated(entry: Mapping[str, Any], where: str) -> RecordingCamera:
    """A camera without a pose; a model that is named without "K", where it has one, is known by the size of the image alone."""
    model = _model(entry, where) if "model" in entry else "pinhole"
    if model in DISTORTION and "K" not in entry:
        if model != "pinhole":
            raise ValueError(f"{where}.K is missing, a {model} without R and t needs its K: people do not tell it")
        _check_keys({"K": None, "R": None, "t": None, **entry}, model, where)
        if "distortion" in entry:
            raise ValueError(f"{where}.distortion belongs to K, which is missing")
        width, height = (_size(entry[name], f"{where}.{name}") for name in ("width", "height"))
        return RecordingCamera.uncalibrated(width, height)
    _check_keys({"R": None, "t": None, **entry}, model, where)
    camera = _camera(entry, model, where)
    return RecordingCamera.uncalibrated(camera.width, camera.height, camera)


def _row(t: Any) -> Any:
    """A translation as a row; OpenCV has it as a column, [[x], [y], [z]]."""
    column = isinstance(t, list) and len(t) == 3 and all(isinstance(one, list) and len(one) == 1 for one in t)
    return [one[0] for one in t] if column else t


def camera_to(camera: RecordingCamera) -> dict[str, Any]:
    """The entry of a camera, JSON values only; camera_from reads the same camera. Raises ValueError for a camera of another class."""
    if "K" in camera.unknown:
        return {"width": camera.camera.width, "height": camera.camera.height}
    if "pose" in camera.unknown:
        return _entry(camera.camera)
    rotation, translation = camera.opencv_extrinsics
    entry = _entry(camera.camera) | {"R": rotation.tolist(), "t": translation.tolist()}
    return entry if camera.robot is None else entry | {"robot": camera.robot}


def model_of(camera: Camera) -> str:
    """The name of a camera's model in recording.json. Raises ValueError for a camera of another class."""
    return str(_entry(camera)["model"])


def _entry(camera: Camera) -> dict[str, Any]:
    for model, kind in CLASSES.items():
        if isinstance(camera, Pinhole | Fisheye) and isinstance(camera, kind):
            K, distortion = camera.matrix.tolist(), list(camera.distortion)
            return {"model": model, "width": camera.width, "height": camera.height, "K": K, "distortion": distortion}
        if isinstance(camera, kind):
            return {"model": model} | asdict(camera)
    raise ValueError(f"camera is a {type(camera).__name__}, needs one of {', '.join(FIELDS)}")


def _model(entry: Mapping[str, Any], where: str) -> str:
    if "model" not in entry:
        raise ValueError(f"{where}.model is missing, needs one of {', '.join(FIELDS)}")
    model = entry["model"]
    if isinstance(model, str) and model in FIELDS:
        return model
    known = SYNONYMS | {name: name for name in FIELDS}
    near = get_close_matches(model.lower(), known, n=1) if isinstance(model, str) and len(model) < 100 else []
    hint = f" (is {known[near[0]]} meant?)" if near else ""
    raise ValueError(f"{where}.model is {_short(model)}, needs one of {', '.join(FIELDS)}{hint}")


def _check_keys(entry: Mapping[str, Any], model: str, where: str) -> None:
    """Raises ValueError for unknown and for missing keys."""
    needed = ("width", "height", *FIELDS[model], *POSE)
    known = ("model", *needed, *(("distortion",) if model in DISTORTION else ()), "robot", *CLOCK)
    if unknown := [key for key in entry if key not in known]:
        near = get_close_matches(unknown[0], known, n=1, cutoff=0.5)
        hint = f" (is {near[0]} meant?)" if near else ""
        raise ValueError(f"{where}: field {unknown[0][:40]!r} is unknown in the model {model}, needs {', '.join(known)}{hint}")
    if missing := [key for key in needed if key not in entry]:
        raise ValueError(f"{where}.{missing[0]} is missing, the model {model} needs {', '.join(needed)}")


def _camera(entry: Mapping[str, Any], model: str, where: str) -> Camera:
    """The model of the camera. Its own checks, of the fold for instance, are told with `where`."""
    arguments: dict[str, Any] = {name: _size(entry[name], f"{where}.{name}") for name in ("width", "height")}
    if model in DISTORTION:
        arguments |= _intrinsics(entry["K"], f"{where}.K")
        arguments["distortion"] = _distortion(entry.get("distortion"), model, f"{where}.distortion")
    else:
        arguments |= {name: _parameter(entry[name], f"{where}.{name}") for name in FIELDS[model]}
    try:
        return CLASSES[model](**arguments)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _distortion(value: Any, model: str, where: str) -> tuple[float, ...]:
    names = DISTORTION[model]
    if value is None:
        return (0.0,) * len(names)
    other = {len(numbers): f"; {len(numbers)} are the model {name}" for name, numbers in DISTORTION.items() if name != model}
    hint = other.get(len(value), "") if isinstance(value, list) else ""
    return tuple(_numbers(value, len(names), where, ", ".join(names) + hint).tolist())


def _intrinsics(value: Any, where: str) -> dict[str, float]:
    """fx, fy, cx, cy px of a camera matrix."""
    K = _matrix(value, where, "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")
    if abs(K[0, 1]) > SKEW or abs(K[1, 0]) > SKEW:
        raise ValueError(f"{where} has {K[0, 1]:g} and {K[1, 0]:g} beside its diagonal, needs 0 (no skew)")
    if not np.allclose(K[2], [0.0, 0.0, 1.0], rtol=0.0, atol=1e-9):
        raise ValueError(f"{where} has the last row {K[2].tolist()}, needs [0, 0, 1]")
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError(f"{where} has the focal lengths {K[0, 0]:g} and {K[1, 1]:g} px, needs more than 0")
    return {"fx": float(K[0, 0]), "fy": float(K[1, 1]), "cx": float(K[0, 2]), "cy": float(K[1, 2])}


def _rotation(value: Any, where: str) -> Array:
    """A rotation (3, 3); rounded digits are mended up to ROUNDED by the nearest rotation."""
    if isinstance(value, list) and len(value) == 3 and not any(isinstance(row, list) for row in value):
        raise ValueError(f"{where} is {_short(value)}, needs 3 rows of 3 numbers; cv2.Rodrigues makes them of a rotation vector")
    R = _matrix(value, where, "a rotation from world to camera")
    with np.errstate(over="ignore"):
        error, determinant = float(np.abs(R @ R.T - np.eye(3)).max()), float(np.linalg.det(R))
    if not error <= ROUNDED:
        raise ValueError(
            f"{where} is no rotation: R Rᵀ differs from 1 by {error:.2g} and det R is {determinant:.4g}, needs at most {ROUNDED:g} and 1"
        )
    if determinant < 0:
        raise ValueError(f"{where} is a reflection, det R is {determinant:.4g}, needs 1; one of its axes points the wrong way")
    if error <= EXACT:
        return R
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def _matrix(value: Any, where: str, meaning: str) -> Array:
    rows = value if isinstance(value, list) else []
    if len(rows) != 3 or not all(isinstance(row, list) and len(row) == 3 for row in rows):
        raise ValueError(f"{where} is {_short(value)}, needs 3 rows of 3 numbers: {meaning}")
    return np.array([_numbers(row, 3, f"{where}[{k}]", meaning) for k, row in enumerate(rows)])


def _numbers(value: Any, count: int, where: str, meaning: str) -> Array:
    if not isinstance(value, list) or len(value) != count:
        got = (
            f"has {len(value)} numbers"
            if isinstance(value, list) and value and not any(isinstance(v, list) for v in value)
            else f"is {_short(value)}"
        )
        raise ValueError(f"{where} {got}, needs {count} numbers: {meaning}")
    return np.array([_number(one, f"{where}[{k}]") for k, one in enumerate(value)])


def _number(value: Any, where: str) -> float:
    try:
        number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not abs(number) <= LARGEST:
        raise ValueError(f"{where} is {_short(value)}, needs a finite number of at most {LARGEST:g} in size")
    return number


def _parameter(value: Any, where: str) -> float:
    number = _number(value, where)
    if 0 < abs(number) < LEAST:
        raise ValueError(f"{where} is {_short(value)}, needs 0 or at least {LEAST:g} in size")
    return number


def _size(value: Any, where: str) -> int:
    number = _number(value, where)
    if number != round(number) or not 1 <= number <= MAX_SIDE:
        raise ValueError(f"{where} is {_short(value)}, needs a whole number of pixels from 1 to {MAX_SIDE}")
    return int(number)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
