"""WILDTRACK (Chavdarova et al. 2018) as MultiviewX and GMVD have it: metres, OpenCV's cameras, cells of a grid. Written and read side by side.

Pixels are those of OpenCV: the first one's centre is (0, 0). Boxes give the first and the last pixel, both within. Frames and views count from 0,
files of cameras from 1. positionID = gx + columns · gy, and the cell's point is origin + cell · (gx, gy).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.geometry import Array, Ints, Pose, frozen
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Tsai
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json

CELL = 0.025
"""m, of both datasets."""
HIDDEN = (-1, -1, -1, -1)
LARGEST = 2**53
SAMPLES = 40
"""Points along each side of the image at which a distortion is fitted."""
_EDGES = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True, eq=False)
class Region:
    """The ground as cells: origin (2,) m of the first, columns along x and rows along y, cell m. Raises ValueError for a region without cells."""

    origin: Array
    columns: int
    rows: int
    cell: float = CELL

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", frozen(self.origin, (2,), "origin"))
        if self.columns < 1 or self.rows < 1 or not self.cell > 0:
            raise ValueError(f"region is {self.columns} x {self.rows} cells of {self.cell} m, needs at least 1 x 1 and more than 0 m")

    @staticmethod
    def around(points: Array, margin: float = 1.0) -> Region:
        """In whole metres around points (n, 2) m, with this margin."""
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        low, high = np.floor(low - margin), np.ceil(high + margin)
        columns, rows = np.round((high - low) / CELL).astype(int)
        return Region(low, int(columns), int(rows))

    def positions(self, points: Array) -> Ints:
        """(n, 2) m → (n,) ids of the nearest cells' points. Raises ValueError for a point outside."""
        cells = np.rint((np.asarray(points)[:, :2] - self.origin) / self.cell).astype(np.int64)
        bad = (cells < 0).any(axis=1) | (cells >= [self.columns, self.rows]).any(axis=1)
        if bad.any():
            point = np.asarray(points)[int(np.argmax(bad))].tolist()
            raise ValueError(f"point {point} m is outside the region of {self.columns} x {self.rows} cells")
        return np.asarray(cells[:, 0] + self.columns * cells[:, 1])

    def points(self, positions: Ints) -> Array:
        """(n,) ids → (n, 2) m."""
        gy, gx = np.divmod(positions, self.columns)
        return np.asarray(self.origin + self.cell * np.column_stack([gx, gy]))


@dataclass(frozen=True, eq=False)
class WildtrackPosition:
    """Somebody in a frame: person id; position, the id of a cell; boxes (views, 4) xmin, ymin, xmax, ymax px, all −1 in views that do not show
    the person; feet (3,) m, the place itself, or None.
    """

    person: int
    position: int
    boxes: Ints
    feet: Array | None = None


def write_positions(path: Path, people: Iterable[WildtrackPosition]) -> None:
    """The annotation of one frame. Raises ValueError for an id that other readers cannot keep."""
    out = []
    for one in people:
        if not 0 <= one.person < LARGEST:
            raise ValueError(f"personID is {one.person}, needs 0 to less than 2^53")
        views = [{"viewNum": k} | dict(zip(_EDGES, box, strict=True)) for k, box in enumerate(one.boxes.tolist())]
        entry: dict[str, Any] = {"personID": one.person, "positionID": one.position, "views": views}
        out.append(entry if one.feet is None else entry | {"feet": one.feet.tolist()})
    write_text(path, json.dumps(out, indent=1, allow_nan=False) + "\n")


def read_positions(path: Path) -> list[WildtrackPosition]:
    """Raises ValueError with the file's name where a field is missing or views are not numbered from 0 on."""
    out = []
    try:
        for entry in read_json(path):
            views = sorted(entry["views"], key=lambda view: int(view["viewNum"]))
            if [view["viewNum"] for view in views] != list(range(len(views))):
                raise ValueError(f"person {entry['personID']}: views are not numbered from 0 to {len(views) - 1}")
            boxes = np.array([[view[name] for name in _EDGES] for view in views], dtype=np.int64).reshape(-1, 4)
            feet = np.array(entry["feet"], dtype=np.float64) if "feet" in entry else None
            out.append(WildtrackPosition(int(entry["personID"]), int(entry["positionID"]), boxes, feet))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return out


@dataclass(frozen=True, eq=False)
class Calibrated:
    """OpenCV's camera: matrix (3, 3) px, distortion (5,) k1, k2, p1, p2, k3; rvec (3,) rad and tvec (3,) m from the world to the optical frame."""

    matrix: Array
    distortion: Array
    rvec: Array
    tvec: Array

    def __post_init__(self) -> None:
        for name, shape in (("matrix", (3, 3)), ("distortion", (5,)), ("rvec", (3,)), ("tvec", (3,))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))

    @staticmethod
    def of(camera: Tsai, T_world_camera: Pose) -> tuple[Calibrated, float]:
        """The nearest camera of OpenCV's, and its largest error over the image, px: its distortion goes the other way round than Tsai's.

        k1, k2, k3 fit distorted = undistorted (1 + k1 r² + k2 r⁴ + k3 r⁶) to Tsai's undistorted = distorted (1 + κ1 r²) by least squares.
        """
        fx, fy = camera.focal * camera.sx / camera.dpx, camera.focal / camera.dpy
        matrix = np.array([[fx, 0.0, camera.cx], [0.0, fy, camera.cy], [0.0, 0.0, 1.0]])
        u, v = np.meshgrid(np.linspace(0, camera.width - 1, SAMPLES), np.linspace(0, camera.height - 1, SAMPLES))
        pixels = np.column_stack([u.ravel(), v.ravel()])
        optical = camera.bearings_from_pixels(pixels) @ OPTICAL_FROM_CAMERA.T
        straight = optical[:, :2] / optical[:, 2:]
        bent = (pixels - [camera.cx, camera.cy]) / [fx, fy]
        square = (straight**2).sum(axis=1)
        distortion = np.zeros(5)
        if camera.kappa1:
            columns = np.concatenate([straight[:, [axis]] * np.stack([square, square**2, square**3], axis=1) for axis in (0, 1)])
            distortion[[0, 1, 4]] = np.linalg.lstsq(columns, (bent - straight).T.ravel(), rcond=None)[0]
        rotation = OPTICAL_FROM_CAMERA @ T_world_camera.rotation.T
        rvec = np.asarray(cv2.Rodrigues(rotation)[0], dtype=np.float64).ravel()
        found = Calibrated(matrix, distortion, rvec, -rotation @ T_world_camera.translation)
        again = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), matrix, distortion)[0].reshape(-1, 2)
        return found, float(np.linalg.norm(again - pixels, axis=1).max())

    def depths(self, points: Array) -> Array:
        """(n, 3) m in the world → (n,) m before the camera, along its axis."""
        return np.asarray(points @ np.asarray(cv2.Rodrigues(self.rvec)[0])[2] + self.tvec[2])

    def pixels(self, points: Array) -> Array:
        """(n, 3) m in the world → (n, 2) px; only of use for points before the camera."""
        if not len(points):
            return np.zeros((0, 2))
        pixels, _ = cv2.projectPoints(np.asarray(points, dtype=np.float64), self.rvec, self.tvec, self.matrix, self.distortion)
        return np.asarray(pixels.reshape(-1, 2))


def write_calibration(folder: Path, name: str, camera: Calibrated) -> None:
    """intrinsic/intr_NAME.xml and extrinsic/extr_NAME.xml in `folder`, as OpenCV's FileStorage has them."""
    _store(folder / "intrinsic" / f"intr_{name}.xml", {"camera_matrix": camera.matrix, "distortion_coefficients": camera.distortion[None]})
    _store(folder / "extrinsic" / f"extr_{name}.xml", {"rvec": camera.rvec[:, None], "tvec": camera.tvec[:, None]})


def _store(path: Path, matrices: Mapping[str, Array]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, np.ascontiguousarray(matrix))
    storage.release()


def read_calibration(folder: Path, name: str) -> Calibrated:
    """Raises ValueError with the file's name where a file or a matrix is not there or has another shape."""
    intrinsic, extrinsic = folder / "intrinsic" / f"intr_{name}.xml", folder / "extrinsic" / f"extr_{name}.xml"
    matrix, distortion = _stored(intrinsic, ("camera_matrix", "distortion_coefficients"))
    rvec, tvec = _stored(extrinsic, ("rvec", "tvec"))
    try:
        return Calibrated(matrix, distortion.ravel(), rvec.ravel(), tvec.ravel())
    except ValueError as error:
        raise ValueError(f"{intrinsic} or {extrinsic}: {error}") from None


def _stored(path: Path, names: tuple[str, ...]) -> list[Array]:
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        found = [storage.getNode(name).mat() for name in names]
        storage.release()
    except (cv2.error, SystemError):  # what OpenCV's constructor throws arrives as either
        raise ValueError(f"{path}: is not a file of OpenCV's FileStorage") from None
    missing = [name for name, matrix in zip(names, found, strict=True) if matrix is None]
    if missing:
        raise ValueError(f"{path}: has no matrix {missing[0]}")
    return [np.asarray(matrix, dtype=np.float64) for matrix in found]


def write_config(path: Path, region: Region, cameras: int, frames: int, size: tuple[int, int]) -> None:
    """GMVD's config.json: size is height, width px; grid_shape rows, columns; grid_cell, origin x, y and region_size y, x in metres."""
    content = {
        "Dataset": "pilsim",
        "num_cam": cameras,
        "num_frames": frames,
        "img_shape": list(size),
        "grid_shape": [region.rows, region.columns],
        "grid_cell": region.cell,
        "origin": region.origin.tolist(),
        "region_size": [region.rows * region.cell, region.columns * region.cell],
    }
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_region(path: Path) -> Region:
    """The region of a config.json. Raises ValueError with the file's name where a field is missing or wrong."""
    content = read_json(path)
    try:
        rows, columns = content["grid_shape"]
        return Region(np.array(content["origin"], dtype=np.float64), int(columns), int(rows), float(content["grid_cell"]))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
