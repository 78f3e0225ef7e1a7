"""PETS 2009: camera calibrations (XML, Tsai's model), annotations (XML, CVML), detections (MOT15 text), and the site (site.json).

Camera files are in mm and radians: R = Rz Ry Rx, optical = R · world + t. All values here are in metres.
Annotations are those of PETS 2009 and CAVIAR: boxes by their centres in the image of one camera, frames from 0. Detections count frames from 1.
Pixels are those of the calibration: pixel centres lie at whole numbers.

site.json lies beside the annotations. It holds what PETS 2009 does not record: frame rate, tracking area, ground and occluding pillars. Its fields:
rate [1/s]; area [[x, y], [x, y]] m, the lowest and the highest corner; terrain, the name of a file of heights, or null for the plane z = 0.
The field pillars may be missing: [[x, y, radius, low, high], ...] m, upright cylinders that occlude people.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.formats.motchallenge import number, place_of_row, read_mot15
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Tsai
from tracker.geometry.ground import Flat, Ground
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.io.terrain_file import read_terrain
from tracker.io.text_files import shown
from tracker.io.time_order import say_repeated
from tracker.io.xml_files import Element, parse

MM = 1e-3
"""m."""

MAX_RANGE = 500.0
"""m: a ray longer than this does not meet the ground."""

LARGEST, SMALLEST = 1e9, 1e-9
"""Bounds of the numbers of a camera and of a box in their units. Beyond them squares and cubes are no numbers."""
_ABOVE_ZERO = ("dpx", "dpy", "focal", "sx")

FOLD_SAMPLES = 1 << 22
"""Most pixels in which the distortion is tested."""

MAX_RATE, MIN_RATE = 1e4, 1e-4
"""Frames per second. A period beyond these bounds overflows what the tracker computes from it."""

MAX_FRAME = 200_000
"""Highest number of a frame. Sequences hold a value for each frame up to the last, about 1 kB, also where nobody is."""

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
    """rx, ry, rz with R = Rz Ry Rx. Where ry is a right angle, only the sum of rx and rz is determined."""
    ry = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    rz = np.arctan2(R[1, 0], R[0, 0])
    # rx is computed relative to this rz, so that their sum is right even near the singularity, where rz is arbitrary.
    c, s = np.cos(rz), np.sin(rz)
    rx = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return float(rx), float(ry), float(rz)


def read_detections(path: str | os.PathLike[str]) -> dict[int, tuple[Array, Array]]:
    """Read a MOT15 file: frame (from 1) → boxes (n, 4) left, top, width, height px and confidence (n,).

    Frames without detections have no entry. Raises ValueError as motchallenge.read_mot15, and with the frame of a detection without a box.
    """
    rows = read_mot15(path)
    if not rows.has_box.all():
        row = int(np.argmin(rows.has_box))
        raise ValueError(f"{place_of_row(path, row)}: frame {rows.frame[row]} has a detection without a box, needs width and height")
    large = np.abs(rows.box).max(axis=1, initial=0.0)
    if len(rows) and large.max() > LARGEST:
        raise ValueError(f"{place_of_row(path, int(np.argmax(large)))}: box is {rows.box[np.argmax(large)].tolist()}, needs pixels up to {LARGEST:g}")
    if len(rows) and rows.frame.max() > MAX_FRAME:
        raise ValueError(f"{place_of_row(path, int(np.argmax(rows.frame)))}: frame is {rows.frame.max()}, needs at most {MAX_FRAME}")
    return {frame: (rows.box[k], rows.confidence[k]) for frame, k in rows.by_frame().items()}


def ground_truth(annotations: Annotations, camera: Camera, T_world_camera: Pose, ground: Ground) -> dict[int, tuple[Ints, Array]]:
    """Ground positions of the annotated people: frame → ids (m,) and feet (m, 3) m.

    The feet are the middle of the lower edge of the box, projected to the ground.
    Raises ValueError with frame and id where that ray does not meet the ground.
    """
    out: dict[int, tuple[Ints, Array]] = {}
    for frame, (ids, boxes) in annotations.items():
        pixels = np.stack([boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3]], axis=1)
        directions = camera.bearings_from_pixels(pixels) @ T_world_camera.rotation.T
        origins = np.broadcast_to(T_world_camera.translation, directions.shape)
        feet, hit = ground.intersect(origins, directions, MAX_RANGE)
        if not hit.all():
            raise ValueError(f"frame {frame}: the feet of id {ids[np.argmin(hit)]} are not on the ground, need to be below the horizon")
        out[frame] = ids, feet
    return out


Annotations = dict[int, tuple[Ints, Array]]


def read_annotations(path: str | os.PathLike[str]) -> Annotations:
    """Read a CVML file: frame (from 0) → ids (m,) and boxes (m, 4) left, top, width, height px. Frames without people have empty entries.

    The centre of a box is xc, yc, or x, y in the older CAVIAR files.
    A frame or an object that stands twice with the same content counts once; their number is logged.
    Raises ValueError with file, line and field where they differ, for an invalid number, and for a size not above 0.
    """
    out: Annotations = {}
    repeated = 0
    for frame in parse(path, "dataset").find_all("frame"):
        number = frame.integer("number")
        if not 0 <= number <= MAX_FRAME:
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} is {'below 0' if number < 0 else f'above {MAX_FRAME}'}")
        boxes: dict[int, list[float]] = {}
        for item in (o for group in frame.find_all("objectlist") for o in group.find_all("object")):
            person, box = item.integer("id"), _box(item.find("box"))
            repeated += person in boxes
            if boxes.setdefault(person, box) != box:
                raise ValueError(f"{path}:line {item.line}: field object.id {person} occurs twice in frame {number}, with two boxes")
        one = np.array(list(boxes), dtype=np.int64), np.array(list(boxes.values())).reshape(-1, 4)
        repeated += number in out
        if not all(map(np.array_equal, out.setdefault(number, one), one)):
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} occurs twice, with other boxes")
    say_repeated(path, repeated, "element")
    return dict(sorted(out.items()))


def _box(box: Element) -> list[float]:
    w, h = box.number("w"), box.number("h")
    for name, size in (("w", w), ("h", h)):
        if not size > 0:
            raise ValueError(f"{box.where}:line {box.line}: field box.{name} is {size}, needs more than 0")
    x, y = box.number("xc", "x"), box.number("yc", "y")
    if max(abs(x), abs(y), w, h) > LARGEST:
        raise ValueError(f"{box.where}:line {box.line}: field box is {x:g}, {y:g}, {w:g}, {h:g}, needs pixels up to {LARGEST:g}")
    return [x - w / 2, y - h / 2, w, h]


def write_annotations(path: Path, name: str, annotations: Annotations) -> None:
    """Write a CVML file; read_annotations reads it. Raises ValueError with frame and id for a size that is not above 0."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<dataset name={quoteattr(name)}>"]
    for frame, (ids, boxes) in sorted(annotations.items()):
        lines += [f'  <frame number="{frame}">', "    <objectlist>"]
        for person, (left, top, w, h) in zip(ids.tolist(), np.asarray(boxes).tolist(), strict=True):
            if not (w > 0 and h > 0):
                raise ValueError(f"frame {frame}: the box of id {person} is {w} x {h} px, needs more than 0")
            size, centre = f'h="{number(h)}" w="{number(w)}"', f'xc="{number(left + w / 2)}" yc="{number(top + h / 2)}"'
            lines.append(f'      <object id="{person}"><box {size} {centre}/></object>')
        lines += ["    </objectlist>", "  </frame>"]
    write_text(path, "\n".join([*lines, "</dataset>", ""]))


FILE, TERRAIN = "site.json", "terrain.npz"

AREA = ((-14.0696, -14.2740), (4.9813, 1.7335))
"""m: tracking area of the cropped annotations of PETS 2009 (Milan's ground truth)."""

PILLARS = ((-13.708, -10.623, 0.07, 0.0, 2.4), (-13.708, -10.623, 0.24, 2.4, 3.03))
"""m: the lamp post of PETS 2009 and its sign, which occlude people in View_001; measured in its first frame by its calibration."""

RATE = 7.0
"""Frames per second of PETS 2009."""


@dataclass(frozen=True, eq=False)
class Site:
    """rate in frames/s; area (2, 2) m, ground, occluders and pillars (p, 5) m as in Setup."""

    rate: float
    area: Array
    ground: Ground
    occluders: Ground | None = None
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))


def read_site(folder: Path) -> Site:
    """Read site.json of a folder; without the file, the site of PETS 2009. Raises ValueError with the path for an invalid file."""
    path = folder / FILE
    if not path.is_file():
        return Site(RATE, np.array(AREA), Flat(), pillars=np.array(PILLARS))
    try:
        content = read_json(path)
        if not isinstance(content, dict):
            raise ValueError(f"{path}: is a {type(content).__name__}, needs an object with rate, area and terrain")
        rate, area, terrain = float(content["rate"]), np.array(content["area"], dtype=np.float64), content["terrain"]
    except (TypeError, KeyError, ValueError) as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: needs rate, area and terrain in JSON ({shown(str(error))})") from None
    if not MIN_RATE <= rate <= MAX_RATE:
        raise ValueError(f"{path}: rate is {rate}, needs more than 0 and at most {MAX_RATE:g}, and at least {MIN_RATE:g}")
    if area.shape != (2, 2) or not np.isfinite(area).all() or not (area[0] < area[1]).all():
        raise ValueError(f"{path}: area is {str(content['area'])[:80]}, needs two corners x, y m, the lowest first")
    pillars = _pillars(path, content.get("pillars", []))
    if terrain is None:
        return Site(rate, area, Flat(), pillars=pillars)
    if terrain != TERRAIN:
        raise ValueError(f"{path}: terrain is {str(terrain)[:80]!r}, needs {TERRAIN!r} or null")
    return Site(rate, area, *read_terrain(folder / TERRAIN), pillars=pillars)


def _pillars(path: Path, rows: Any) -> Array:
    try:
        pillars = np.array(rows, dtype=np.float64).reshape(-1, 5)
    except (ValueError, TypeError):
        pillars = np.full((1, 5), np.nan)
    if not np.isfinite(pillars).all() or not (pillars[:, 2] > 0).all() or not (pillars[:, 3] < pillars[:, 4]).all():
        raise ValueError(f"{path}: pillars is {str(rows)[:80]}, needs rows of x, y, radius, low and high in metres, radius over 0 and low under high")
    return pillars


def write_site(folder: Path, site: Site, terrain: Path | None) -> None:
    """Write site.json; read_site reads it. terrain: path of a terrain.npz with the ground, or None for z = 0."""
    if terrain is not None:
        (folder / TERRAIN).write_bytes(terrain.read_bytes())
    content = {"rate": site.rate, "area": site.area.tolist(), "terrain": TERRAIN if terrain is not None else None, "pillars": site.pillars.tolist()}
    write_text(folder / FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")
