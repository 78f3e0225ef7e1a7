"""AI City Challenge, track 1 of 2025 and 2026: calibration.json, ground_truth.json and the result file; readers and writers.

Sources, read in 2026: https://www.aicitychallenge.org/2025-track1/ and /2026-track1/ describe the result file. The data card,
https://huggingface.co/datasets/nvidia/PhysicalAI-SmartSpaces, has the keys of both JSON files. Those of calibration.json are also in NVIDIA's schema,
https://docs.nvidia.com/vss/system-components/calibration/calibration-schema.

The world is right-handed with z up, in metres; frames count from 0. Cameras are pinholes without distortion, with OpenCV's matrices:
x_camera = R x_world + t with x right, y down, z ahead. `extrinsicMatrix` is [R | t] (3, 4), `cameraMatrix` is K [R | t], and `homography`
maps (x, y, 1) on the plane z = 0 to the image. Of the matrices, the readers use only `intrinsicMatrix` and `extrinsicMatrix`.

An object's box has its middle at `3d location`. `3d bounding box scale` has its sizes along its own axes x (width), y (length), z (height), and
`3d bounding box rotation` has pitch, roll and yaw in radians. Boxes in images are the first and the last x and y, px.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, set_array, set_ints
from tracker.geometry.camera_protocol import MAX_SIDE
from tracker.geometry.lenses import Pinhole
from tracker.io.atomic import write_text
from tracker.io.csv_tables import check_rows, faults_at_lines, read_rows
from tracker.io.json_files import JsonObject, read_json, write_json
from tracker.io.mot15 import number
from tracker.recordings import RecordingCamera
from tracker.recordings.camera_json import MATRIX, intrinsics, rotation
from tracker.recordings.folder import CAMERA_NAME, MAX_CAMERAS
from tracker.sequence.calibration import MAX_RATE, MIN_RATE

CALIBRATION, TRUTH = "calibration.json", "ground_truth.json"
CLASSES = ("Person", "Forklift", "NovaCarter", "Transporter", "FourierGR1T2", "AgilityDigit")
"""Names of the classes by class_id, as in 2025."""
PERSON = CLASSES[0]
NUMBERS = ("fps", "frameWidth", "frameHeight")
"""Attributes of a sensor that are read."""
COLUMNS = ("scene_id", "class_id", "object_id", "frame_id", "x", "y", "z", "width", "length", "height", "yaw")
"""The columns of the result file; the first four are whole numbers."""
WHOLE = 4
LARGEST_ID = 2**53
LARGEST_FRAME = 1_000_000
LARGEST = 1e7
"""Metres, pixels or radians: numbers of at least this size are refused."""
LARGEST_TRUTH = 1 << 29
"""Bytes; scenes of 9000 frames have about 300 MB."""
_DECIMALS = 6
_VECTORS = ("3d location", "3d bounding box scale", "3d bounding box rotation")
_VISIBLE = "2d bounding box visible"


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

    Raises ValueError for a negative value of the first four, a size not above 0, and an object twice in a frame.
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
        whole = zip(COLUMNS, (self.scene, self.category, self.id, self.frame), (LARGEST_ID, LARGEST_ID, LARGEST_ID, LARGEST_FRAME), strict=False)
        rules = [(name, values, (values < 0) | (values >= most), f"0 to less than {most}") for name, values, most in whole]
        sizes = zip(COLUMNS[7:10], self.size.T, strict=True)
        rules += [(name, values, ~((values > 0) & (values < LARGEST)), f"more than 0, less than {LARGEST:g}") for name, values in sizes]
        check_rows(*rules, keys=np.column_stack([self.frame, self.id, self.category, self.scene]))

    def __len__(self) -> int:
        return len(self.scene)

    @property
    def boxes(self) -> Array:
        """Boxes (n, 7): x, y, z, width, length, height, yaw."""
        return np.column_stack([self.centre, self.size, self.yaw])


def read_calibration(path: Path) -> tuple[float, dict[str, RecordingCamera]]:
    """The rate, frames/s, and the cameras of a calibration.json; sensors of another type are left out.

    Raises ValueError with file and field for missing or invalid fields, a repeated name, different rates, and for a file without cameras.
    """
    cameras, rates = dict[str, RecordingCamera](), dict[float, str]()
    for sensor in JsonObject(read_json(path), str(path)).objects("sensors")[:MAX_CAMERAS]:
        if sensor.values.get("type", "camera") != "camera":
            continue
        name = sensor.text("id", CAMERA_NAME, "a name without blanks and any of / \\ , = :")
        if name in cameras:
            raise ValueError(f"{path}: sensors name {name!r} twice, needs each once")
        attributes = _attributes(sensor)
        rates[attributes.number("fps", MIN_RATE, MAX_RATE)] = name
        lens = intrinsics(sensor.array("intrinsicMatrix", (3, 3), meaning=MATRIX), f"{sensor.where}: intrinsicMatrix")
        extrinsic = sensor.array("extrinsicMatrix", (3, 4), -LARGEST, LARGEST, "[R | t]")
        try:
            size = attributes.whole("frameWidth", 1, MAX_SIDE), attributes.whole("frameHeight", 1, MAX_SIDE)
            model = Pinhole(*size, lens["fx"], lens["fy"], lens["cx"], lens["cy"])
        except ValueError as error:
            raise ValueError(str(error) if str(error).startswith(str(path)) else f"{sensor.where}: {error}") from None
        cameras[name] = RecordingCamera.of_opencv(model, rotation(extrinsic[:, :3], f"{sensor.where}: extrinsicMatrix"), extrinsic[:, 3])
    if len(rates) != 1:
        fault = f"fps is {' and '.join(f'{rate:g}' for rate in sorted(rates))}, needs the same of all" if rates else "sensors holds no camera"
        raise ValueError(f"{path}: {fault} cameras" if rates else f"{path}: {fault}, needs at least one")
    return next(iter(rates)), cameras


def _attributes(sensor: JsonObject) -> JsonObject:
    """The NUMBERS among the attributes of a sensor. Files hold them as numbers or as text; other attributes may hold any text."""
    out = dict[str, Any]()
    for one in sensor.objects("attributes"):
        value, name = one.values.get("value"), one.values.get("name")
        if name not in NUMBERS:
            continue
        try:
            out[name] = float(value) if isinstance(value, str) else value
        except ValueError:
            raise ValueError(f"{one.where}: {str(value)[:40]!r} is the value of {name}, needs a number") from None
    return JsonObject(out, f"{sensor.where}: attributes")


def write_calibration(path: Path, rate: float, cameras: Mapping[str, RecordingCamera]) -> None:
    """Write calibration.json of pinholes. There is no plan of the scene: scaleFactor is 1 and translationToGlobalCoordinates is 0."""
    sensors = []
    for name, camera in cameras.items():
        assert isinstance(camera.camera, Pinhole)
        lens, (R, t) = camera.camera, camera.opencv_extrinsics
        projection = lens.matrix @ np.column_stack([R, t])
        place, homography = -R.T @ t, projection[:, [0, 1, 3]]
        attributes = {"fps": number(rate), "frameWidth": str(lens.width), "frameHeight": str(lens.height)}
        sensors.append(
            {
                "type": "camera",
                "id": name,
                "coordinates": {"x": float(place[0]), "y": float(place[1]), "z": float(place[2])},
                "scaleFactor": 1.0,
                "translationToGlobalCoordinates": {"x": 0.0, "y": 0.0},
                "attributes": [{"name": name, "value": value} for name, value in attributes.items()],
                "intrinsicMatrix": lens.matrix.tolist(),
                "extrinsicMatrix": np.column_stack([R, t]).tolist(),
                "cameraMatrix": projection.tolist(),
                "homography": (homography / (homography[2, 2] or 1.0)).tolist(),
            }
        )
    write_json(path, {"calibrationType": "cartesian", "sensors": sensors}, indent=1)


def read_ground_truth(path: Path) -> dict[int, list[AiCityObject]]:
    """Read ground_truth.json: frame from 0 → its objects, of all classes.

    Raises ValueError with file, frame and field for missing or invalid fields, and for an object of a class twice in a frame.
    """
    content, out = JsonObject(read_json(path, LARGEST_TRUTH), str(path)), dict[int, list[AiCityObject]]()
    for key, objects in content.values.items():
        if not re.fullmatch("[0-9]{1,7}", key) or int(key) >= LARGEST_FRAME or int(key) in out:
            raise ValueError(f"{path}: frame is {key[:40]!r}, needs each whole number once, from 0 to less than {LARGEST_FRAME}")
        if not isinstance(objects, list):
            raise ValueError(f"{path}: frame {key} is a {type(objects).__name__}, needs a list of objects")
        out[int(key)] = _objects(objects, f"{path}: frame {key}")
        named = {(one.kind, one.id) for one in out[int(key)]}
        if len(named) < len(objects):
            raise ValueError(f"{path}: frame {key} holds an object id of a class twice, needs each once")
    return dict(sorted(out.items()))


def _objects(entries: list[Any], where: str) -> list[AiCityObject]:
    """The objects of a frame. One array for all objects is several times as fast as one per object. An invalid object is searched for afterwards."""
    try:
        vectors = _numbers([[entry[key] for key in _VECTORS] for entry in entries], (len(entries), 3, 3))
        boxes = [box for entry in entries for box in entry.get(_VISIBLE, {}).values()]
        edges = iter(_numbers(boxes, (len(boxes), 4)))
        out = []
        for entry, (centre, size, turn) in zip(entries, vectors, strict=True):
            seen = {camera: next(edges) for camera in entry.get(_VISIBLE, {})}
            ordered = all((box[2:] >= box[:2]).all() for box in seen.values())
            kind, identity = entry["object type"], entry["object id"]
            if not (isinstance(kind, str) and type(identity) is int and 0 <= identity < LARGEST_ID and (size > 0).all() and ordered):
                raise ValueError
            out.append(AiCityObject(kind, identity, centre, size, turn, seen))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise _fault(entries, where) from None
    return out


def _numbers(values: list[Any], shape: tuple[int, ...]) -> Array:
    """Finite numbers of this shape, below LARGEST in size. Raises ValueError for others."""
    array: NDArray[Any] = np.array(values) if values else np.zeros(shape)
    if array.shape != shape or array.dtype.kind not in "iuf" or not (np.abs(array.astype(np.float64)) < LARGEST).all():
        raise ValueError
    return array.astype(np.float64)


def _fault(entries: list[Any], where: str) -> ValueError:
    """The error of the first invalid object of a frame."""
    try:
        for k, entry in enumerate(entries):
            one = JsonObject(entry, f"{where}: object {k}")
            one.a("object type", str), one.whole("object id", 0, LARGEST_ID - 1)
            for key in _VECTORS:
                one.array(key, (3,), 1e-300 if key == _VECTORS[1] else -LARGEST, LARGEST)
            seen = JsonObject(one.values.get(_VISIBLE, {}), f"{one.where}: {_VISIBLE}")
            for camera in seen.values:
                if (np.diff(seen.array(camera, (4,), -LARGEST, LARGEST).reshape(2, 2), axis=0) < 0).any():
                    return seen.refused(camera, "the first x and y before the last")
    except ValueError as error:
        return error
    return ValueError(f"{where}: cannot be read, needs objects")


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
    write_json(path, frames)


def read_results(path: Path) -> AiCityRows:
    """Read a result file: eleven numbers a line, separated by blanks. Blank lines are skipped.

    Raises ValueError with file and line for another number of values, an invalid value, and as AiCityRows.
    """
    lines, table = read_rows(path, COLUMNS, COLUMNS[:WHOLE], separator=None)
    scene, category, identity, frame = table[:, :WHOLE].astype(np.int64).T
    with faults_at_lines(path, lines):
        return AiCityRows(scene, category, identity, frame, table[:, 4:7], table[:, 7:10], table[:, 10])


def write_results(path: Path, rows: AiCityRows) -> None:
    """Write a result file, sorted by scene, frame, class and object; metres and radians to 1e-6."""
    values = np.round(rows.boxes, _DECIMALS)
    lines = []
    for k in np.lexsort((rows.id, rows.category, rows.frame, rows.scene)):
        whole = rows.scene[k], rows.category[k], rows.id[k], rows.frame[k]
        lines.append(" ".join([*map(str, whole), *(number(value) for value in values[k].tolist())]) + "\n")
    write_text(path, "".join(lines))
