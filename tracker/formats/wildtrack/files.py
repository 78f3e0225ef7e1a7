"""WILDTRACK (Chavdarova et al. 2018) in the variant of MultiviewX and GMVD: positions on a ground grid, OpenCV calibrations; writer and reader.

Pixels are those of OpenCV: the centre of the first pixel is (0, 0). A box gives its first and last pixel in each direction, both included.
Frames and views count from 0, camera files from 1. positionID = gx + columns · gy. The point of a cell is origin + cell · (gx, gy), metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.geometry import Array, Ints, Pose, set_array
from tracker.geometry.cameras import Camera, Pinhole
from tracker.geometry.tsai import opencv_intrinsics
from tracker.io.json_files import LARGEST_ID, JsonObject, read_json, write_json
from tracker.io.text_files import parse_number
from tracker.io.xml_files import parse
from tracker.recordings import RecordingCamera
from tracker.recordings.camera_json import intrinsics

CELL = 0.025
"""m: cell size in both datasets."""
HIDDEN = (-1, -1, -1, -1)
"""Box of a person in a view that does not show the person."""
_EDGES = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True, eq=False)
class GroundGrid:
    """A grid on the ground: origin (2,) m of the first point, columns along x, rows along y, cell size m. Raises ValueError without cells."""

    origin: Array
    columns: int
    rows: int
    cell: float = CELL

    def __post_init__(self) -> None:
        set_array(self, "origin", (2,))
        if self.columns < 1 or self.rows < 1 or not self.cell > 0:
            raise ValueError(f"region is {self.columns} x {self.rows} cells of {self.cell} m, needs at least 1 x 1 and more than 0 m")

    @staticmethod
    def around(points: Array) -> GroundGrid:
        """The grid around points (n, 2) m with a margin of 1 m, its bounds rounded outwards to whole metres."""
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        low, high = np.floor(low - 1.0), np.ceil(high + 1.0)
        columns, rows = np.round((high - low) / CELL).astype(int)
        return GroundGrid(low, int(columns), int(rows))

    def positions(self, points: Array) -> Ints:
        """(n, 2) m → positionIDs (n,) of the nearest grid points. Raises ValueError for a point outside."""
        cells = np.rint((np.asarray(points)[:, :2] - self.origin) / self.cell).astype(np.int64)
        bad = (cells < 0).any(axis=1) | (cells >= [self.columns, self.rows]).any(axis=1)
        if bad.any():
            point = np.asarray(points)[int(np.argmax(bad))].tolist()
            raise ValueError(f"point {point} m is outside the region of {self.columns} x {self.rows} cells")
        return np.asarray(cells[:, 0] + self.columns * cells[:, 1])

    def points(self, positions: Ints) -> Array:
        """positionIDs (n,) → grid points (n, 2) m."""
        gy, gx = np.divmod(positions, self.columns)
        return np.asarray(self.origin + self.cell * np.column_stack([gx, gy]))


@dataclass(frozen=True, eq=False)
class WildtrackPosition:
    """A person in a frame: person id; position, a positionID; feet (3,) m, the exact position, or None.

    boxes (views, 4): xmin, ymin, xmax, ymax px, HIDDEN in views that do not show the person.
    """

    person: int
    position: int
    boxes: Ints
    feet: Array | None = None


def write_positions(path: Path, people: Iterable[WildtrackPosition]) -> None:
    """Write the annotation of one frame. Raises ValueError for an id of 2^53 or more."""
    entries = []
    for one in people:
        if not 0 <= one.person <= LARGEST_ID:
            raise ValueError(f"personID is {one.person}, needs 0 to less than 2^53")
        views = [{"viewNum": k} | dict(zip(_EDGES, box, strict=True)) for k, box in enumerate(one.boxes.tolist())]
        entry: dict[str, Any] = {"personID": one.person, "positionID": one.position, "views": views}
        entries.append(entry if one.feet is None else entry | {"feet": one.feet.tolist()})
    write_json(path, entries, indent=1)


def read_positions(path: Path) -> list[WildtrackPosition]:
    """Read the annotation of one frame. A person without `views` has boxes (0, 4).

    Raises ValueError with the path for missing or wrong fields, and views not numbered from 0.
    """
    out = list[WildtrackPosition]()
    for person in JsonObject({"people": read_json(path)}, str(path)).objects("people"):
        views = sorted(person.objects("views") if "views" in person.values else [], key=lambda view: view.whole("viewNum"))
        if [view.whole("viewNum") for view in views] != list(range(len(views))):
            raise ValueError(f"{person.where}: views are not numbered from 0 to {len(views) - 1}")
        edges = [[view.whole(name, -LARGEST_ID) for name in _EDGES] for view in views]
        feet = person.array("feet", (3,)) if "feet" in person.values else None
        boxes = np.array(edges, dtype=np.int64).reshape(-1, 4)
        out.append(WildtrackPosition(person.whole("personID", -LARGEST_ID), person.whole("positionID", -LARGEST_ID), boxes, feet))
    return out


def opencv_camera(camera: Camera, T_world_camera: Pose) -> tuple[RecordingCamera, float]:
    """The same camera as OpenCV's pinhole, or the best approximation of a Tsai camera with distortion, and its largest error over the image, px.

    Raises ValueError for a camera that is no pinhole, and for a distortion that folds within the image.
    """
    K, distortion, error = opencv_intrinsics(camera)
    lens = Pinhole(camera.width, camera.height, K[0, 0], K[1, 1], K[0, 2], K[1, 2], tuple(distortion.tolist()))
    return RecordingCamera(lens, T_world_camera), error


def write_calibration(folder: Path, name: str, camera: RecordingCamera) -> None:
    """Write intrinsic/intr_NAME.xml and extrinsic/extr_NAME.xml of a pinhole in `folder` with OpenCV's FileStorage."""
    assert isinstance(camera.camera, Pinhole)
    (R, t), distortion = camera.opencv_extrinsics, np.array([camera.camera.distortion])
    _store(folder / "intrinsic" / f"intr_{name}.xml", {"camera_matrix": camera.camera.matrix, "distortion_coefficients": distortion})
    _store(folder / "extrinsic" / f"extr_{name}.xml", {"rvec": np.asarray(cv2.Rodrigues(R)[0]), "tvec": t[:, None]})


def _store(path: Path, matrices: Mapping[str, Array]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, np.ascontiguousarray(matrix))
    storage.release()


def read_calibration(folder: Path, name: str, size: tuple[int, int], intrinsic: str = "intrinsic", unit: float = 1.0) -> RecordingCamera:
    """Read INTRINSIC/intr_NAME.xml and extrinsic/extr_NAME.xml in `folder`. size: height, width px. unit: of the translation in the file, m.

    Raises ValueError with file and field where a file or a matrix is missing, has another shape, or holds numbers that are not finite.
    """
    inner, outer = folder / intrinsic / f"intr_{name}.xml", folder / "extrinsic" / f"extr_{name}.xml"
    K, distortion = _stored(inner, {"camera_matrix": (3, 3), "distortion_coefficients": (5,)})
    rvec, tvec = _stored(outer, {"rvec": (3,), "tvec": (3,)})
    numbers = intrinsics(K, f"{inner}: camera_matrix")
    try:
        lens = Pinhole(size[1], size[0], **numbers, distortion=tuple(distortion.tolist()))
    except ValueError as error:
        raise ValueError(f"{inner}: {error}") from None
    return RecordingCamera.of_opencv(lens, np.asarray(cv2.Rodrigues(rvec)[0]), unit * tvec)


def _stored(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> list[Array]:
    """The matrices of a file by name and shape; vectors may be rows, columns, or plain numbers, as WILDTRACK has them.

    OpenCV's own reader is not used, because damaged files can make it write out of bounds.
    """
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    storage, out = parse(path, "opencv_storage"), []
    for name, shape in shapes.items():
        element = storage.find(name)
        where = f"{path}:line {element.line}: {name}"
        found = {child.tag: child.content for child in element.children}
        values = _numbers(found.get("data", "") if found else element.content, where)
        rows, columns = (_numbers(found.get(tag, ""), f"{where}.{tag}").tolist() for tag in ("rows", "cols")) if found else ([values.size], [1])
        if not (len(rows) == len(columns) == 1 and rows[0] * columns[0] == values.size):
            raise ValueError(f"{where} has {values.size} numbers, needs rows x cols of them")
        there = tuple(int(n) for n in (rows[0], columns[0]))
        if values.size != np.prod(shape) or (len(shape) == 2 and there != shape):
            raise ValueError(f"{where} has shape {there}, needs {' x '.join(map(str, shape))} numbers")
        out.append(values.reshape(shape))
    return out


def _numbers(text: str, where: str) -> Array:
    """Numbers between blanks. Raises ValueError for anything else, and for numbers that are not finite or too large."""
    values = np.array([parse_number(word, where) for word in text.split()], dtype=np.float64)
    if not (np.abs(values) <= LARGEST_ID).all():
        raise ValueError(f"{where} is {values.tolist()[:12]}, needs numbers of at most {LARGEST_ID}")
    return values


def write_config(path: Path, grid: GroundGrid, cameras: int, frames: int, size: tuple[int, int], rate: float | None = None) -> None:
    """Write config.json as GMVD does. size: height, width px. rate: frames per second, a field of pilsim; None to leave it out."""
    content: dict[str, Any] = {
        "Dataset": "pilsim",
        "num_cam": cameras,
        "num_frames": frames,
        "img_shape": list(size),
        "grid_shape": [grid.rows, grid.columns],
        "grid_cell": grid.cell,
        "origin": grid.origin.tolist(),
        "region_size": [grid.rows * grid.cell, grid.columns * grid.cell],
    }
    if rate is not None:
        content["rate"] = rate
    write_json(path, content, indent=1)


def read_ground_grid(path: Path) -> GroundGrid:
    """Read the ground grid of a config.json. Raises ValueError with the path for missing or invalid fields."""
    content = JsonObject(read_json(path), str(path))
    rows, columns = content.integers("grid_shape", 2)
    try:
        return GroundGrid(content.array("origin", (2,)), columns, rows, content.number("grid_cell"))
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
