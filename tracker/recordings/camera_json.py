"""The entry of a camera in recording.json, and the RecordingCamera that it describes.

    {"model": "pinhole", "width": 1920, "height": 1080, "K": (3, 3) px, "distortion": [k1, k2, p1, p2, k3], "R": (3, 3), "t": [x, y, z] m}
    {"model": "fisheye", ... "K", "distortion": [k1, k2, k3, k4]}                        as OpenCV's fisheye model
    {"model": "equirectangular", ...}                                                    width = 2 height
    {"model": "cylindrical", ... "horizon": row of the horizon, "focal": px}             v = horizon + focal · tan(−elevation)
    {"model": "tsai", ... "focal", "kappa1", "cx", "cy", "sx", "dpx", "dpy"}             as PETS 2009 has them: mm, 1/mm², px

x_camera = R x_world + t with optical axes: x right, y down, z ahead, as OpenCV has them. A panorama looks ahead in its middle.
A camera of unknown pose has neither R nor t; a camera of unknown model has only width and height. `pilsim calibrate` finds what is missing.
A camera on a robot has "robot": NAME, and x_camera = R x_robot + t with the robot's axes x ahead, y left, z up. A lens may lack "distortion".
It may have "own_body": ["0011…", …], rows of 0 and 1 over all directions, as in an equirectangular image. 1: the camera sees its own robot.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.geometry.camera_protocol import MAX_SIDE
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai
from tracker.io.json_files import JsonObject
from tracker.recordings.recording import RecordingCamera
from tracker.sequence.calibration import own_body_entry, own_body_from

ROUNDED = 1e-3
"""Largest |R Rᵀ − 1| of a rotation with rounded digits. The nearest rotation is taken."""
EXACT = 1e-12
"""|R Rᵀ − 1| up to which a rotation is taken as it is."""
SKEW = 1e-3
"""px: largest skew that is taken for 0."""
LEAST = 1e-12
"""Least size of a nonzero number of a camera model. Powers of smaller numbers overflow."""
MATRIX = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] px with fx, fy above 0"
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
OPTIONAL = ("robot", "own_body", "offset_s", "rate")
"""Fields that a camera may have; the last two are of its clock (clocks.py)."""
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
"""Names of these models in other programs, for the error message."""


def camera_from(entry: Any, where: str) -> RecordingCamera:
    """The camera of an entry. Raises ValueError in one line that begins with `where`, for instance "recording.json: cameras.C1"."""
    fields = JsonObject(entry, where)
    if not {"R", "t", "robot"} & set(entry):
        return _uncalibrated(fields)
    model = _model(fields)
    _check_keys(fields, model, ("R", "t"))
    robot = fields.text("robot", r".*\S.*", "the name of a robot") if fields.values.get("robot") is not None else None
    R = rotation(fields.array("R", (3, 3), meaning="a rotation from world to camera, which cv2.Rodrigues makes of a vector"), f"{where}: R")
    camera = RecordingCamera.of_opencv(_camera(fields, model), R, fields.array("t", (3,), meaning="x, y, z in metres"), robot)
    return replace(camera, own_body=own_body_from(entry, f"{where}: own_body"))


def _uncalibrated(fields: JsonObject) -> RecordingCamera:
    """A camera without a pose. The model of a pinhole without "K" is guessed from the image size."""
    model = _model(fields) if "model" in fields.values else "pinhole"
    if model != "pinhole" or "K" in fields.values:
        _check_keys(fields, model, ())
        camera = _camera(fields, model)
        return RecordingCamera.uncalibrated(camera.width, camera.height, camera)
    if "distortion" in fields.values:
        raise ValueError(f"{fields.where}: distortion belongs to K, which is missing")
    _check_keys(JsonObject({"K": None, **fields.values}, fields.where), model, ())
    return RecordingCamera.uncalibrated(fields.whole("width", 1, MAX_SIDE), fields.whole("height", 1, MAX_SIDE))


def camera_to(camera: RecordingCamera) -> dict[str, Any]:
    """The entry of a camera, JSON values only; camera_from reads the same camera. Raises ValueError for a camera of another class."""
    if "K" in camera.unknown:
        return {"width": camera.camera.width, "height": camera.camera.height}
    if "pose" in camera.unknown:
        return _entry(camera.camera)
    R, t = camera.opencv_extrinsics
    entry = _entry(camera.camera) | {"R": R.tolist(), "t": t.tolist()} | own_body_entry(camera.own_body)
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


def _model(fields: JsonObject) -> str:
    model = fields.values.get("model")
    if isinstance(model, str) and model in FIELDS:
        return model
    known = SYNONYMS | {name: name for name in FIELDS}
    near = get_close_matches(model.lower(), known, n=1) if isinstance(model, str) and len(model) < 100 else []
    raise fields.refused("model", ", ".join(FIELDS) + (f" (is {known[near[0]]} meant?)" if near else ""))


def _check_keys(fields: JsonObject, model: str, pose: tuple[str, ...]) -> None:
    """Raises ValueError for unknown and for missing keys."""
    needed = ("width", "height", *FIELDS[model], *pose)
    known = ("model", *needed, *(("distortion",) if model in DISTORTION else ()), *OPTIONAL)
    if unknown := [key for key in fields.values if key not in known]:
        near = get_close_matches(unknown[0], known, n=1, cutoff=0.5)
        hint = f" (is {near[0]} meant?)" if near else ""
        raise ValueError(f"{fields.where}: field {unknown[0][:40]!r} is unknown in the model {model}, needs {', '.join(known)}{hint}")
    if missing := [key for key in needed if key not in fields.values]:
        raise ValueError(f"{fields.where}: {missing[0]} is missing, the model {model} needs {', '.join(needed)}")


def _camera(fields: JsonObject, model: str) -> Camera:
    """The model of the camera. Errors of its class, on distortion for instance, are raised with the place of the entry."""
    arguments: dict[str, Any] = {name: fields.whole(name, 1, MAX_SIDE) for name in ("width", "height")}
    if model in DISTORTION:
        arguments |= intrinsics(fields.array("K", (3, 3), meaning=MATRIX), f"{fields.where}: K")
        if fields.values.get("distortion") is not None:
            names = DISTORTION[model]
            arguments["distortion"] = tuple(fields.array("distortion", (len(names),), meaning=f"{', '.join(names)} of the model {model}").tolist())
    else:
        arguments |= {name: fields.number(name) for name in FIELDS[model]}
        if small := [name for name in FIELDS[model] if 0 < abs(arguments[name]) < LEAST]:
            raise fields.refused(small[0], f"0 or at least {LEAST:g} in size")
    try:
        return CLASSES[model](**arguments)
    except ValueError as error:
        raise ValueError(f"{fields.where}: {error}") from None


def intrinsics(K: Array, where: str) -> dict[str, float]:
    """fx, fy, cx, cy px of a camera matrix (3, 3). Raises ValueError that begins with `where` for another one."""
    if max(abs(K[0, 1]), abs(K[1, 0])) > SKEW or not np.allclose(K[2], [0.0, 0.0, 1.0], rtol=0.0, atol=1e-9) or not min(K[0, 0], K[1, 1]) > 0:
        raise ValueError(f"{where} is {K.tolist()}, needs {MATRIX}")
    return {"fx": float(K[0, 0]), "fy": float(K[1, 1]), "cx": float(K[0, 2]), "cy": float(K[1, 2])}


def rotation(R: Array, where: str) -> Array:
    """A rotation (3, 3); rounding errors up to ROUNDED are corrected by the nearest rotation. Raises ValueError that begins with `where`."""
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
