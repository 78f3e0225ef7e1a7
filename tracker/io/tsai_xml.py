"""XML calibrations of Tsai's camera model, the format of PETS 2009; reader and writer. Sequences of pilsim hold them for fixed Tsai cameras.

Files are in mm and radians: R = Rz Ry Rx, optical = R · world + t. All values here are in metres.
Pixels are those of the calibration: pixel centres lie at whole numbers.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Tsai
from tracker.io.mot15 import number
from tracker.io.xml_files import Element, parse

MM = 1e-3
"""m."""
LARGEST, SMALLEST = 1e9, 1e-9
"""Bounds of the numbers of a camera in their units. They keep products and powers finite."""
_ABOVE_ZERO = ("dpx", "dpy", "focal", "sx")
FOLD_SAMPLES = 1 << 22
"""Most pixels at which the distortion is tested."""
MAX_FOLDED_SHARE = 0.01
"""Largest share of the image that may lie where the distortion has no inverse. In View_007 it is 0.5 %, in the left corners."""


def read_camera(path: str | os.PathLike[str]) -> tuple[str, Tsai, Pose]:
    """Read a calibration file → name of the camera, its Tsai model and T_world_camera (metres; x forward, y left, z up).

    Raises ValueError with file, line and field where a field is missing, is no finite number, or is invalid.
    Raises ValueError where the distortion has no inverse in more than MAX_FOLDED_SHARE of the image.
    """
    camera = parse(path, "Camera")
    geometry, intrinsic, extrinsic = camera.find("Geometry"), camera.find("Intrinsic"), camera.find("Extrinsic")
    for element, names in ((geometry, ("dpx", "dpy")), (intrinsic, ("focal", "kappa1", "cx", "cy", "sx")), (extrinsic, ("tx", "ty", "tz"))):
        for name in names:
            _check_size(element, name)
    try:
        model = Tsai(
            width=geometry.integer("width"),
            height=geometry.integer("height"),
            focal=intrinsic.number("focal"),
            kappa1=intrinsic.number("kappa1"),
            cx=intrinsic.number("cx"),
            cy=intrinsic.number("cy"),
            sx=intrinsic.number("sx"),
            dpx=geometry.number("dpx"),
            dpy=geometry.number("dpy"),
        )
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(f"{path}:") else f"{path}: field {error}") from None
    _check_fold(path, intrinsic.line, model)
    rx, ry, rz = (extrinsic.number(name) for name in ("rx", "ry", "rz"))
    t = np.array([extrinsic.number(name) for name in ("tx", "ty", "tz")]) * MM
    R = _rotation(rx, ry, rz)
    return camera.text("name"), model, Pose(R.T @ OPTICAL_FROM_CAMERA, -R.T @ t)


def _check_size(element: Element, name: str) -> None:
    """Raises ValueError with file and line for a number out of LARGEST and SMALLEST."""
    value = element.number(name)
    if abs(value) > LARGEST or (name in _ABOVE_ZERO and 0 < value < SMALLEST):
        raise ValueError(f"{element.where}:line {element.line}: field {element.tag}.{name} is {value:g}, needs {SMALLEST:g} to {LARGEST:g}")


def _check_fold(path: str | os.PathLike[str], line: int, model: Tsai) -> None:
    # Of a large image only some pixels are tested, evenly spread, to bound memory and time.
    step = max(1, int(np.ceil(np.sqrt(model.width * model.height / FOLD_SAMPLES))))
    u, v = np.meshgrid(np.arange(0, model.width, step), np.arange(0, model.height, step))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    folded = model.folded(pixels)
    if folded.mean() > MAX_FOLDED_SHARE:
        u0, v0 = pixels[folded][np.argmin(np.hypot(*(pixels[folded] - [model.cx, model.cy]).T))]
        raise ValueError(
            f"{path}:line {line}: field Intrinsic.kappa1 is {model.kappa1:g}: beyond {model.fold:.3g} mm from the axis, from pixel ({u0}, {v0})"
            f" on, the distortion cannot be inverted in {folded.mean():.1%} of the image, needs at most {MAX_FOLDED_SHARE:.0%}"
        )


def write_camera(path: str | os.PathLike[str], name: str, camera: Tsai, T_world_camera: Pose) -> None:
    """Write a calibration file; read_camera reads it. dx equals dpx, as in a camera that samples each sensor element once (ncx = nfx)."""
    rx, ry, rz = _angles(OPTICAL_FROM_CAMERA @ T_world_camera.rotation.T)
    t = -OPTICAL_FROM_CAMERA @ T_world_camera.rotation.T @ T_world_camera.translation / MM
    c = camera
    geometry = {"width": c.width, "height": c.height, "ncx": c.width, "nfx": c.width, "dx": c.dpx, "dy": c.dpy, "dpx": c.dpx, "dpy": c.dpy}
    intrinsic = {"focal": c.focal, "kappa1": c.kappa1, "cx": c.cx, "cy": c.cy, "sx": c.sx}
    extrinsic = {"tx": t[0], "ty": t[1], "tz": t[2], "rx": rx, "ry": ry, "rz": rz}
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', f"<Camera name={quoteattr(name)}>"]
    for tag, values in (("Geometry", geometry), ("Intrinsic", intrinsic), ("Extrinsic", extrinsic)):
        lines.append(f"  <{tag} " + " ".join(f'{key}="{number(float(value))}"' for key, value in values.items()) + "/>")
    Path(path).write_text("\n".join([*lines, "</Camera>", ""]), encoding="utf-8")


def _rotation(rx: float, ry: float, rz: float) -> Array:
    """R_optical_world = Rz Ry Rx."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([rx, ry, rz]), np.sin([rx, ry, rz])
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


def _angles(R: Array) -> tuple[float, float, float]:
    """rx, ry, rz with R = Rz Ry Rx. Where ry is ±π/2, only the sum or the difference of rx and rz is determined."""
    ry = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    rz = np.arctan2(R[1, 0], R[0, 0])
    # rx is computed relative to this rz, so that R is right even near the singularity, where rz is arbitrary.
    c, s = np.cos(rz), np.sin(rz)
    rx = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(rx), float(ry), float(rz)
