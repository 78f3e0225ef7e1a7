"""AI City Challenge, track 1 of 2025 and 2026: calibration.json, ground_truth.json and the result file; readers and writers.

Sources, read in 2026: the result file at https://www.aicitychallenge.org/2025-track1/ and /2026-track1/. The keys of both JSON files are in the card
of the data, https://huggingface.co/datasets/nvidia/PhysicalAI-SmartSpaces, and of calibration.json also in NVIDIA's schema,
https://docs.nvidia.com/vss/system-components/calibration/calibration-schema.

The world is right-handed with z up, in metres; frames count from 0. Cameras are pinholes without distortion, their matrices those of OpenCV:
x_camera = R x_world + t with x right, y down, z ahead. `extrinsicMatrix` is [R | t] (3, 4), `cameraMatrix` is K [R | t], and `homography`
takes (x, y, 1) on the plane z = 0 to the image. The readers need `intrinsicMatrix` and `extrinsicMatrix` alone.

An object's box has its middle at `3d location`, sizes along its own axes x (width), y (length), z (height) in `3d bounding box scale`,
and pitch, roll, yaw in radians in `3d bounding box rotation`. Boxes in images are the first and the last x and y, px.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, set_array, set_ints
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.io.mot15 import number
from tracker.io.text_files import read_lines

CALIBRATION, TRUTH = "calibration.json", "ground_truth.json"
CLASSES = ("Person", "Forklift", "NovaCarter", "Transporter", "FourierGR1T2", "AgilityDigit")
"""Names of the classes by class_id, as in 2025."""
PERSON = CLASSES[0]
COLUMNS = ("scene_id", "class_id", "object_id", "frame_id", "x", "y", "z", "width", "length", "height", "yaw")
"""The columns of the result file; the first four are whole numbers."""
WHOLE = 4
LARGEST_ID = 2**53
LARGEST_FRAME = 1_000_000
LARGEST = 1e7
"""Metres, pixels or radians: numbers beyond are refused."""
LARGEST_TRUTH = 1 << 29
"""Bytes; scenes of 9000 frames have about 300 MB."""
NO_ROTATION = 1e-3
"""The most that R Rᵀ may differ from the identity."""
MAX_CAMERAS = 1000
_DECIMALS = 6
_VECTORS = ("3d location", "3d bounding box scale", "3d bounding box rotation")
_VISIBLE = "2d bounding box visible"
_CAMERA_NAME = re.compile(r"[^\s/\\,=:]{1,100}")


@dataclass(frozen=True, eq=False)
class AiCityCamera:
    """A camera: name; K (3, 3) px; R (3, 3) and t (3,) m with x_camera = R x_world + t; size of the image px; rate frames/s.

    Raises ValueError for a K that is no upper triangle without skew, an R that is no rotation, and for sizes or rates out of bounds.
    """

    name: str
    K: Array
    R: Array
    t: Array
    width: int
    height: int
    rate: float

    def __post_init__(self) -> None:
        for key, shape in (("K", (3, 3)), ("R", (3, 3)), ("t", (3,))):
            set_array(self, key, shape)
        if not _CAMERA_NAME.fullmatch(self.name):
            raise ValueError(f"id is {self.name[:40]!r}, needs a name without blanks and any of / \\ , = :")
        if np.abs(self.K[[0, 1, 2, 2], [1, 0, 0, 1]]).max() > 1e-6 or self.K[2, 2] != 1 or not (self.K[[0, 1], [0, 1]] > 0).all():
            raise ValueError(f"intrinsicMatrix is {self.K.tolist()}, needs [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0")
        off = float(np.abs(self.R @ self.R.T - np.eye(3)).max())
        if not off <= NO_ROTATION or np.linalg.det(self.R) < 0:
            raise ValueError(f"extrinsicMatrix: its first three columns differ from a rotation by {off:.2g}, needs at most {NO_ROTATION}, no mirror")
        # Files have rounded numbers.
        u, _, v = np.linalg.svd(self.R)
        object.__setattr__(self, "R", u @ v)
        if not 1 <= self.width <= 100_000 or not 1 <= self.height <= 100_000:
            raise ValueError(f"frameWidth and frameHeight are {self.width} x {self.height}, need 1 to 100000")
        if not 0 < self.rate <= 1e4:
            raise ValueError(f"fps is {self.rate}, needs more than 0 and at most 10000")

    @property
    def projection(self) -> Array:
        """K [R | t] (3, 4)."""
        return np.asarray(self.K @ np.column_stack([self.R, self.t]))


@dataclass(frozen=True, eq=False)
class AiCityObject:
    """An object in a frame: kind, a name of a class; id; centre (3,) m; size (3,) m; rotation (3,) pitch, roll, yaw rad.

    visible: camera → (4,) first x, first y, last x, last y px of what is seen. The bounds are checked where a file is read.
    """

    kind: str
    id: int
    centre: Array
    size: Array
    rotation: Array
    visible: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class AiCityRows:
    """The rows of a result file: scene, category (class_id), id and frame (n,), centre (n, 3) m, size (n, 3) m, yaw (n,) rad.

    Raises ValueError for a negative number of the first four or a size that is not above 0, and for an object twice in a frame.
    """

    scene: Ints
    category: Ints
    id: Ints
    frame: Ints
    centre: Array
    size: Array
    yaw: Array

    def __post_init__(self) -> None:
        n = len(self.scene)
        for name in ("scene", "category", "id", "frame"):
            set_ints(self, name, (n,))
        for name, shape in (("centre", (n, 3)), ("size", (n, 3)), ("yaw", (n,))):
            set_array(self, name, shape)
        fault = self._fault()
        if fault is not None:
            raise ValueError(f"row {fault[0]}: {fault[1]}")

    def __len__(self) -> int:
        return len(self.scene)

    @property
    def boxes(self) -> Array:
        """Boxes (n, 7): x, y, z, width, length, height, yaw."""
        return np.column_stack([self.centre, self.size, self.yaw])

    def _fault(self) -> tuple[int, str] | None:
        """The first invalid row, from 0, and the reason."""
        whole = np.column_stack([self.scene, self.category, self.id, self.frame])
        largest = np.array([LARGEST_ID, LARGEST_ID, LARGEST_ID, LARGEST_FRAME])
        bad = np.argwhere((whole < 0) | (whole >= largest))
        faults = [(int(r), f"{COLUMNS[c]} is {whole[r, c]}, needs 0 to less than {largest[c]}") for r, c in bad[:1]]
        small = np.argwhere(self.size <= 0)
        faults += [(int(r), f"{COLUMNS[7 + c]} is {self.size[r, c]:g}, needs more than 0") for r, c in small[:1]]
        _, first, which = np.unique(whole, axis=0, return_index=True, return_inverse=True)
        again = np.flatnonzero(first[which.ravel()] != np.arange(len(whole)))
        faults += [(int(r), f"frame {whole[r, 3]} holds object {whole[r, 2]} of class {whole[r, 1]} twice") for r in again[:1]]
        return min(faults, default=None)


def read_calibration(path: Path) -> list[AiCityCamera]:
    """Read the cameras of a calibration.json; sensors of another type are left out.

    Raises ValueError with file and field for missing or invalid fields, a name that stands twice, and for a file without cameras.
    """
    content = read_json(path)
    sensors = content.get("sensors") if isinstance(content, dict) else None
    if not isinstance(sensors, list) or len(sensors) > MAX_CAMERAS:
        raise ValueError(f"{path}: sensors is missing, needs a list of at most {MAX_CAMERAS} cameras")
    out = [
        _camera(sensor, f"{path}: sensors[{k}]")
        for k, sensor in enumerate(sensors)
        if not isinstance(sensor, dict) or sensor.get("type", "camera") == "camera"
    ]
    names = [camera.name for camera in out]
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: sensors name {max(names, key=names.count)!r} twice, needs each once")
    if not out:
        raise ValueError(f"{path}: sensors holds no camera, needs at least one")
    return out


def _camera(sensor: Any, where: str) -> AiCityCamera:
    if not isinstance(sensor, dict) or not isinstance(sensor.get("id"), str):
        raise ValueError(f"{where}: id is missing, needs an object with the name of the camera in it")
    where = f"{where} ({sensor['id'][:40]})"
    listed = sensor.get("attributes")
    if not isinstance(listed, list) or not all(isinstance(one, dict) and isinstance(one.get("name"), str) for one in listed):
        raise ValueError(f"{where}.attributes: needs a list of objects with name and value")
    attributes = {one["name"]: one.get("value") for one in listed}
    width, height, rate = (_attribute(attributes, name, where) for name in ("frameWidth", "frameHeight", "fps"))
    if width != round(width) or height != round(height):
        raise ValueError(f"{where}.attributes: frameWidth and frameHeight are {width} x {height}, need whole numbers")
    K = _numbers(sensor.get("intrinsicMatrix"), (3, 3), f"{where}.intrinsicMatrix")
    extrinsic = _numbers(sensor.get("extrinsicMatrix"), (3, 4), f"{where}.extrinsicMatrix")
    try:
        return AiCityCamera(sensor["id"], K, extrinsic[:, :3], extrinsic[:, 3], int(width), int(height), rate)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _attribute(attributes: Mapping[str, Any], name: str, where: str) -> float:
    """The number of an attribute, which files have as a number or as text."""
    value = attributes.get(name)
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError
        found = float(value)
        if not abs(found) < LARGEST:
            raise ValueError
    except (ValueError, OverflowError):
        raise ValueError(f"{where}.attributes: {name} is {str(value)[:40]}, needs a number") from None
    return found


def _numbers(value: Any, shape: tuple[int, ...], where: str) -> Array:
    """A JSON value as an array of finite numbers of this shape."""
    try:
        array = np.array(value)
    except (ValueError, OverflowError):
        array = np.zeros(0, dtype=object)
    if not _bounded(array, shape):
        needed = " x ".join(map(str, shape))
        raise ValueError(f"{where} is {str(value)[:80]}, needs {needed} numbers below {LARGEST:g}")
    return array.astype(np.float64)


def write_calibration(path: Path, cameras: Sequence[AiCityCamera]) -> None:
    """Write calibration.json. There is no plan of the scene: scaleFactor is 1 and translationToGlobalCoordinates is 0."""
    sensors = []
    for camera in cameras:
        place, homography = -camera.R.T @ camera.t, camera.projection[:, [0, 1, 3]]
        attributes = {"fps": number(camera.rate), "frameWidth": str(camera.width), "frameHeight": str(camera.height)}
        sensors.append(
            {
                "type": "camera",
                "id": camera.name,
                "coordinates": {"x": float(place[0]), "y": float(place[1]), "z": float(place[2])},
                "scaleFactor": 1.0,
                "translationToGlobalCoordinates": {"x": 0.0, "y": 0.0},
                "attributes": [{"name": name, "value": value} for name, value in attributes.items()],
                "intrinsicMatrix": camera.K.tolist(),
                "extrinsicMatrix": np.column_stack([camera.R, camera.t]).tolist(),
                "cameraMatrix": camera.projection.tolist(),
                "homography": (homography / (homography[2, 2] or 1.0)).tolist(),
            }
        )
    write_text(path, json.dumps({"calibrationType": "cartesian", "sensors": sensors}, indent=1, allow_nan=False) + "\n")


def read_ground_truth(path: Path) -> dict[int, list[AiCityObject]]:
    """Read ground_truth.json: frame from 0 → its objects, of all classes.

    Raises ValueError with file, frame and field for missing or invalid fields, and for an object of a class twice in a frame.
    """
    content = read_json(path, LARGEST_TRUTH)
    if not isinstance(content, dict):
        raise ValueError(f"{path}: is a {type(content).__name__}, needs an object with an entry for each frame")
    out: dict[int, list[AiCityObject]] = {}
    for key, objects in content.items():
        if not re.fullmatch("[0-9]{1,7}", key) or int(key) >= LARGEST_FRAME:
            raise ValueError(f"{path}: frame is {key[:40]!r}, needs a whole number from 0 to less than {LARGEST_FRAME}")
        if int(key) in out:
            raise ValueError(f"{path}: frame {int(key)} stands twice")
        if not isinstance(objects, list):
            raise ValueError(f"{path}: frame {key} is a {type(objects).__name__}, needs a list of objects")
        out[int(key)] = _objects(objects, f"{path}: frame {key}")
        named = {(one.kind, one.id) for one in out[int(key)]}
        if len(named) < len(objects):
            raise ValueError(f"{path}: frame {key} holds an object id of a class twice, needs each once")
    return dict(sorted(out.items()))


def _objects(entries: list[Any], where: str) -> list[AiCityObject]:
    """The objects of a frame. One array for all of them is several times as fast; where it cannot be made, the invalid object is looked for."""
    try:
        table = np.array([[entry[key] for key in _VECTORS] for entry in entries])
        edges = np.array([box for entry in entries for box in entry.get(_VISIBLE, {}).values()])
        valid = (
            all(isinstance(entry["object type"], str) and type(entry["object id"]) is int for entry in entries)
            and all(0 <= entry["object id"] < LARGEST_ID for entry in entries)
            and _bounded(table, (len(entries), 3, 3))
            and _bounded(edges, (len(edges), 4))
            and not (len(entries) and (table[:, 1] <= 0).any())
            and not (len(edges) and (edges[:, 2:] < edges[:, :2]).any())
        )
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        valid = False
    if not valid:
        return [_object(entry, f"{where}: object {k}") for k, entry in enumerate(entries)]
    vectors, rows = table.astype(np.float64), iter(edges.astype(np.float64))
    out = []
    for entry, (centre, size, rotation) in zip(entries, vectors, strict=True):
        boxes = {camera: next(rows) for camera in entry.get(_VISIBLE, {})}
        out.append(AiCityObject(entry["object type"], entry["object id"], centre, size, rotation, boxes))
    return out


def _bounded(array: NDArray[Any], shape: tuple[int, ...]) -> bool:
    """Whether an array holds finite numbers below LARGEST and has this shape; without any number its shape does not matter."""
    if not np.prod(shape):
        return array.size == 0
    return array.dtype.kind in "iuf" and array.shape == shape and bool((np.abs(array.astype(np.float64)) < LARGEST).all())


def _object(entry: Any, where: str) -> AiCityObject:
    if not isinstance(entry, dict):
        raise ValueError(f"{where} is a {type(entry).__name__}, needs an object")
    kind, identity, visible = entry.get("object type"), entry.get("object id"), entry.get(_VISIBLE, {})
    if not isinstance(kind, str):
        raise ValueError(f"{where}: object type is {str(kind)[:40]}, needs the name of a class")
    if isinstance(identity, bool) or not isinstance(identity, int) or not 0 <= identity < LARGEST_ID:
        raise ValueError(f"{where}: object id is {str(identity)[:40]}, needs a whole number from 0 to less than 2^53")
    centre, size, rotation = (_numbers(entry.get(key), (3,), f"{where}: {key}") for key in _VECTORS)
    if not (size > 0).all():
        raise ValueError(f"{where}: 3d bounding box scale is {size.tolist()}, needs sizes above 0")
    if not isinstance(visible, dict):
        raise ValueError(f"{where}: 2d bounding box visible is a {type(visible).__name__}, needs an object with a box for each camera")
    boxes = {camera: _numbers(box, (4,), f"{where}: 2d bounding box visible: {camera[:40]}") for camera, box in visible.items()}
    for camera, box in boxes.items():
        if (box[2:] < box[:2]).any():
            raise ValueError(f"{where}: 2d bounding box visible: {camera[:40]} is {box.tolist()}, needs the first x and y before the last")
    return AiCityObject(kind, identity, centre, size, rotation, boxes)


def write_ground_truth(path: Path, truth: Mapping[int, Iterable[AiCityObject]]) -> None:
    """Write ground_truth.json: frame from 0 → its objects. Raises ValueError for a number that is not finite."""
    frames = {
        str(frame): [
            {
                "object type": one.kind,
                "object id": int(one.id),
                "3d location": np.asarray(one.centre).tolist(),
                "3d bounding box scale": np.asarray(one.size).tolist(),
                "3d bounding box rotation": np.asarray(one.rotation).tolist(),
                "2d bounding box visible": {camera: np.asarray(box).tolist() for camera, box in one.visible.items()},
            }
            for one in objects
        ]
        for frame, objects in sorted(truth.items())
    }
    write_text(path, json.dumps(frames, allow_nan=False) + "\n")


def read_results(path: Path) -> AiCityRows:
    """Read a result file: eleven numbers a line, separated by blanks. Blank lines are skipped.

    Raises ValueError with file and line for another number of values, a value that is no number of its kind, and as AiCityRows.
    """
    try:
        lines = [(k, line.split()) for k, line in read_lines(path)]
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    table = np.array([_row(cells, f"{path}:{k}") for k, cells in lines]).reshape(-1, len(COLUMNS))
    scene, category, identity, frame = table[:, :WHOLE].astype(np.int64).T
    try:
        return AiCityRows(scene, category, identity, frame, table[:, 4:7], table[:, 7:10], table[:, 10])
    except ValueError as error:
        row, reason = str(error).removeprefix("row ").split(": ", 1)
        raise ValueError(f"{path}:{lines[int(row)][0]}: {reason}") from None


def _row(cells: list[str], where: str) -> list[float]:
    if len(cells) != len(COLUMNS):
        raise ValueError(f"{where}: {len(cells)} values, needs {len(COLUMNS)}: {' '.join(COLUMNS)}")
    out = []
    for column, (name, cell) in enumerate(zip(COLUMNS, cells, strict=True)):
        try:
            value = float(cell)
        except ValueError:
            value = float("nan")
        if column < WHOLE and not (abs(value) < LARGEST_ID and value == round(value)):
            raise ValueError(f"{where}: {name} is {cell[:40]!r}, needs a whole number below 2^53")
        if not abs(value) < (LARGEST_ID if column < WHOLE else LARGEST):
            raise ValueError(f"{where}: {name} is {cell[:40]!r}, needs a number below {LARGEST:g}")
        out.append(value)
    return out


def write_results(path: Path, rows: AiCityRows) -> None:
    """Write a result file, sorted by scene, frame, class and object; metres and radians to 1e-6."""
    values = np.round(rows.boxes, _DECIMALS)
    lines = []
    for k in np.lexsort((rows.id, rows.category, rows.frame, rows.scene)):
        whole = rows.scene[k], rows.category[k], rows.id[k], rows.frame[k]
        lines.append(" ".join([*map(str, whole), *(number(value) for value in values[k].tolist())]) + "\n")
    write_text(path, "".join(lines))
