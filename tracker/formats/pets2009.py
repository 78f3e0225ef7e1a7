"""PETS 2009: cameras (Tsai's model, XML), truth in the image of View_001 (CVML, XML), detections (MOT15 text).

The cameras' files are in mm and radians, ours in metres: R = Rz Ry Rx, optical = R · world + t. The annotations count frames from 0, the
detections from 1. Both give boxes in pixels whose centres lie at whole numbers.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.cameras import OPTICAL_FROM_CAMERA, Camera, Tsai
from tracker.formats.cvml import Annotations, read_annotations, write_annotations
from tracker.formats.markup import parse
from tracker.formats.motchallenge import Ints, number, read_mot15
from tracker.geometry import Array, Pose
from tracker.ground import Ground

__all__ = ["Annotations", "ground_truth", "read_annotations", "read_camera", "read_detections", "write_annotations", "write_camera"]

MM = 1e-3
# A sight line that runs longer than this over the site has missed the ground.
LONGEST_SIGHT = 500.0
# Of the image may lie beyond the fold of the distortion; in View_007 it is 0.5 %, in the left corners.
FOLDED_SHARE = 0.01


def read_camera(path: str | os.PathLike[str]) -> tuple[str, Tsai, Pose]:
    """A calibration file → the camera's name, its Tsai model and T_world_camera (metres; x forward, y left, z up).

    Raises ValueError naming file, line and field where one is missing, is no finite number, or cannot be a camera's, and where more
    than FOLDED_SHARE of the image lies where the distortion cannot be inverted.
    """
    camera = parse(path, "Camera")
    geometry, intrinsic, extrinsic = camera.find("Geometry"), camera.find("Intrinsic"), camera.find("Extrinsic")
    try:
        model = Tsai(
            width=geometry.whole("width"),
            height=geometry.whole("height"),
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


def _check_fold(path: str | os.PathLike[str], line: int, model: Tsai) -> None:
    u, v = np.meshgrid(np.arange(model.width), np.arange(model.height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    folded = model.folded(pixels)
    if folded.mean() > FOLDED_SHARE:
        u0, v0 = pixels[folded][np.argmin(np.hypot(*(pixels[folded] - [model.cx, model.cy]).T))]
        raise ValueError(
            f"{path}:line {line}: field Intrinsic.kappa1 is {model.kappa1:g}: beyond {model.fold:.3g} mm from the axis, from pixel ({u0}, {v0})"
            f" on, the distortion cannot be inverted in {folded.mean():.1%} of the image, needs at most {FOLDED_SHARE:.0%}"
        )


def write_camera(path: str | os.PathLike[str], name: str, camera: Tsai, T_world_camera: Pose) -> None:
    """The file that read_camera reads. dx and dpx are the same, as of a camera that samples each of its elements once (ncx = nfx)."""
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
    """rx, ry, rz with R = Rz Ry Rx. Where ry is a right angle only the sum of the others is given; what is returned has that sum."""
    ry = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    rz = np.arctan2(R[1, 0], R[0, 0])
    # Against rz as it came out, so that its own arbitrariness near the right angle is made up for.
    c, s = np.cos(rz), np.sin(rz)
    rx = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(rx), float(ry), float(rz)


def read_detections(path: str | os.PathLike[str]) -> dict[int, tuple[Array, Array]]:
    """A MOT15 file → frame (from 1, as the file has it: index = frame − 1) → boxes (n, 4) left, top, width, height px, confidence (n,).

    Frames without detections are not there. Raises ValueError naming file and line (see motchallenge.read_mot15), or frame where a
    detection has no box.
    """
    rows = read_mot15(path)
    if not rows.boxed.all():
        raise ValueError(f"{path}: frame {rows.frame[np.argmin(rows.boxed)]} has a detection without a box, needs width and height")
    return {frame: (rows.box[k], rows.confidence[k]) for frame, k in rows.by_frame().items()}


def ground_truth(annotations: Annotations, camera: Camera, T_world_camera: Pose, ground: Ground) -> dict[int, tuple[Ints, Array]]:
    """Where the annotated people stand: frame → ids (m,) and feet (m, 3) m, the middle of the box's lower edge cast to the ground.

    Raises ValueError naming frame and id where that line of sight does not meet the ground.
    """
    out: dict[int, tuple[Ints, Array]] = {}
    for frame, (ids, boxes) in annotations.items():
        pixels = np.stack([boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3]], axis=1)
        directions = camera.bearings_from_pixels(pixels) @ T_world_camera.rotation.T
        origins = np.broadcast_to(T_world_camera.translation, directions.shape)
        feet, hit = ground.intersect(origins, directions, LONGEST_SIGHT)
        if not hit.all():
            raise ValueError(f"frame {frame}: the feet of id {ids[np.argmin(hit)]} are not on the ground, need to be below the horizon")
        out[frame] = ids, feet
    return out
