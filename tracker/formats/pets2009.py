"""PETS 2009: cameras (Tsai's model, XML), truth in the image of View_001 (CVML, XML), detections (MOT15 text).

The cameras' files are in mm and radians, ours in metres: R = Rz Ry Rx, optical = R · world + t. The annotations count frames from 0, the
detections from 1. Both give boxes in pixels whose centres lie at whole numbers.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.cameras import OPTICAL_FROM_CAMERA, Camera, Tsai
from tracker.formats.motchallenge import Ints, read_mot15
from tracker.geometry import Array, Pose
from tracker.ground import Ground

Annotations = dict[int, tuple[Ints, Array]]

MAX_BYTES = 64 * 2**20
MAX_DEPTH = 32
MM = 1e-3
# A sight line that runs longer than this over the site has missed the ground.
LONGEST_SIGHT = 500.0
# Of the image may lie beyond the fold of the distortion; in View_007 it is 0.5 %, in the left corners.
FOLDED_SHARE = 0.01


@dataclass
class _Element:
    """One element of a file, with the line that it began on."""

    tag: str
    attributes: dict[str, str]
    line: int
    where: str
    children: list[_Element] = field(default_factory=list)

    def find(self, tag: str) -> _Element:
        for child in self.children:
            if child.tag == tag:
                return child
        raise ValueError(f"{self.where}:line {self.line}: field {tag} is missing in {self.tag}")

    def every(self, tag: str) -> list[_Element]:
        return [child for child in self.children if child.tag == tag]

    def text(self, *names: str) -> str:
        """The attribute of the first of `names` (spellings of one thing) that is there."""
        for name in names:
            if name in self.attributes:
                return self.attributes[name]
        raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{names[0]} is missing")

    def number(self, *names: str) -> float:
        text = self.text(*names)
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{names[0]} is {text!r}, needs a finite number")
        return value

    def whole(self, name: str) -> int:
        value = self.number(name)
        if value != round(value):
            raise ValueError(f"{self.where}:line {self.line}: field {self.tag}.{name} is {value}, needs a whole number")
        return int(value)


def _parse(path: str | os.PathLike[str], root: str) -> _Element:
    """The file's tree. A document type or an entity is refused (they can name other files and grow without bound), and so are
    files above 64 MiB and elements nested deeper than 32.
    """
    source = Path(path)
    if source.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path}: {source.stat().st_size} bytes, needs at most {MAX_BYTES}")
    top = _Element("", {}, 1, str(path))
    stack = [top]
    parser = expat.ParserCreate()

    def refuse(*_: object) -> NoReturn:
        raise ValueError(f"{path}:line {parser.CurrentLineNumber}: holds a document type or an entity, which is refused")

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, parser.CurrentLineNumber, str(path))
        if len(stack) > MAX_DEPTH:
            raise ValueError(f"{path}:line {element.line}: field {tag} is nested deeper than {MAX_DEPTH}")
        stack[-1].children.append(element)
        stack.append(element)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    try:
        parser.Parse(source.read_bytes(), True)
    except (expat.ExpatError, LookupError, UnicodeError) as error:
        raise ValueError(f"{path}: is not XML: {error}") from None
    return top.find(root)


def read_camera(path: str | os.PathLike[str]) -> tuple[str, Tsai, Pose]:
    """A calibration file → the camera's name, its Tsai model and T_world_camera (metres; x forward, y left, z up).

    Raises ValueError naming file, line and field where one is missing, is no finite number, or cannot be a camera's, and where more
    than FOLDED_SHARE of the image lies where the distortion cannot be inverted.
    """
    camera = _parse(path, "Camera")
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
        lines.append(f"  <{tag} " + " ".join(f'{key}="{value:.15g}"' for key, value in values.items()) + "/>")
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


def read_annotations(path: str | os.PathLike[str]) -> Annotations:
    """A CVML file → frame (from 0) → ids (m,) and boxes (m, 4) left, top, width, height px; frames without people are there, empty.

    The box's centre is spelled xc, yc or, as the older CAVIAR files have it, x, y. Raises ValueError naming file, line and field: not
    XML, a frame twice, an id twice in a frame, a size that is not above 0, a number that is none.
    """
    out: Annotations = {}
    for frame in _parse(path, "dataset").every("frame"):
        number = frame.whole("number")
        if number < 0 or number in out:
            fault = "comes twice" if number in out else "is below 0"
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} {fault}")
        objects = [o for group in frame.every("objectlist") for o in group.every("object")]
        ids: list[int] = []
        for item in objects:
            ids.append(item.whole("id"))
            if ids[-1] in ids[:-1]:
                raise ValueError(f"{path}:line {item.line}: field object.id {ids[-1]} comes twice in frame {number}")
        boxes = np.array([_box(item.find("box")) for item in objects]).reshape(-1, 4)
        out[number] = np.array(ids, dtype=np.int64), boxes
    return dict(sorted(out.items()))


def _box(box: _Element) -> list[float]:
    w, h = box.number("w"), box.number("h")
    for name, size in (("w", w), ("h", h)):
        if not size > 0:
            raise ValueError(f"{box.where}:line {box.line}: field box.{name} is {size}, needs more than 0")
    return [box.number("xc", "x") - w / 2, box.number("yc", "y") - h / 2, w, h]


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
