"""Reading WILDTRACK, MultiviewX, GMVD and the export `wildtrack` of pilsim as a recording. All have one layout:

    calibrations/extrinsic/extr_NAME.xml     rvec [rad], tvec from the world to the camera (x right, y down, z ahead).
    calibrations/intrinsic/intr_NAME.xml     camera_matrix [px], distortion_coefficients; WILDTRACK: intrinsic_zero, intrinsic_original.
    annotations_positions/00000.json         grid points of people, one file per frame.
    Image_subsets/C1/0000.png                optional: images.
    detections/C1.txt                        optional: MOT15, frames from 1, boxes in pixels; the first pixel's centre is (0, 0).
    config.json                              GMVD and pilsim: the grid in metres, and the size of the images.

WILDTRACK is recognized by its camera names: C1 to C4 are CVLab1 to CVLab4, C5 to C7 are IDIAP1 to IDIAP3. Its unit is the centimetre, and its
files are every fifth frame of videos. The grid is 480 points of 2.5 cm along x, from −3 m, by 1440 along y, from −9 m. The other sets name
cameras Camera1, Camera2 and so on (C1, C2, …), in metres. Without config.json they are read as MultiviewX: 1000 by 640 points from (0, 0).
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.formats.wildtrack.files import GroundGrid, read_calibration, read_ground_grid, read_positions
from tracker.geometry import Array, Ints
from tracker.geometry.camera_protocol import MAX_SIDE
from tracker.io.image_files import NO_PICTURE, PICTURES, image_size
from tracker.io.json_files import JsonObject, read_json
from tracker.io.picture_folders import say_left_out, visible_files
from tracker.io.resume import checksums
from tracker.io.time_order import say
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.folder import read_boxes
from tracker.recordings.images import ImageFiles
from tracker.recordings.recording import MAX_FRAMES
from tracker.sequence.calibration import MAX_RATE, MIN_RATE

WILDTRACK_CAMERAS = ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3")
WILDTRACK_GRID = GroundGrid(np.array([-3.0, -9.0]), 480, 1440)
MULTIVIEWX_GRID = GroundGrid(np.zeros(2), 1000, 640)
RATE = 2.0
"""Annotated frames per second of WILDTRACK and MultiviewX."""
SIZE = (1080, 1920)
"""Height and width, px, of the images of both."""
LEAST_HEIGHT = 0.1
"""m above the ground: a lower camera indicates a wrong unit."""
MOST_DISTANCE = 10.0
"""Distance of a camera from the middle of the grid over the grid's diagonal. A greater one indicates a wrong unit."""
GRID_SAMPLES = 60
"""Points along each side of the grid for the check that cameras see it."""
INTRINSICS = ("intrinsic_zero", "intrinsic", "intrinsic_original")
"""Folders of intrinsics; the first existing one is read. WILDTRACK's pictures have no distortion, its videos that of intrinsic_original."""


@dataclass(frozen=True, eq=False)
class WildtrackLayout:
    """How a folder is read. name: of the data set. cameras: camera → NAME in its files. unit of translations, m. rate 1/s. step of file numbers."""

    name: str
    cameras: dict[str, str]
    unit: float
    grid: GroundGrid
    rate: float
    step: int
    size: tuple[int, int] | None

    @property
    def area(self) -> Array:
        """The lowest and highest x, y (2, 2) m of the grid's region."""
        return np.array([self.grid.origin, self.grid.origin + self.grid.cell * np.array([self.grid.columns, self.grid.rows])])


def is_wildtrack(path: Path) -> bool:
    """Whether a folder has calibrations/extrinsic/extr_*.xml."""
    return any((path / "calibrations" / "extrinsic").glob("extr_*.xml"))


def read_wildtrack(path: Path) -> Recording:
    """Read a folder of one of the data sets.

    Frames without a file of annotations keep their numbers and have no people. Detections and images may be absent.
    Raises ValueError with file and field for missing or invalid content, for people outside the grid, and for calibrations of a wrong unit.
    """
    layout = wildtrack_layout(path)
    folder = next((name for name in INTRINSICS if (path / "calibrations" / name).is_dir()), None)
    if folder is None:
        raise ValueError(f"{path / 'calibrations'}: has none of {', '.join(INTRINSICS)}, needs one with intr_NAME.xml of each camera")
    size = layout.size or _image_size(path, layout) or SIZE
    cameras = {}
    for name, stem in layout.cameras.items():
        cameras[name] = read_calibration(path / "calibrations", stem, size, folder, layout.unit)
        _check_unit(cameras[name], layout, path / "calibrations" / "extrinsic" / f"extr_{stem}.xml")
    _check_views(cameras, layout, path / "calibrations")
    truth, annotations = _truth(path, layout)
    files = sorted((path / "detections").glob("[!.]*.txt"))
    pictures = path / "Image_subsets"
    others = [one for one in pictures.iterdir() if one.name not in cameras and not one.name.startswith(".")] if pictures.is_dir() else []
    say_left_out(pictures, others, f"belong to no camera of {', '.join(cameras)}")
    for file in files:
        if file.stem not in cameras:
            raise ValueError(f"{file}: is of camera {file.stem!r}, needs one of {', '.join(cameras)}")
    read = [*(path / "calibrations" / "extrinsic" / f"extr_{stem}.xml" for stem in layout.cameras.values()), *files]
    sums = checksums(path, read) | {"annotations_positions": annotations}
    return Recording(
        layout.rate,
        cameras,
        {file.stem: read_boxes(file) for file in files},
        truth,
        area=layout.area,
        images={name: images for name in cameras if (images := _images(path / "Image_subsets" / name, layout.step)).files},
        source={"source": layout.name, "cameras": list(cameras), "intrinsics": folder, "files": sums},
    )


def wildtrack_layout(path: Path) -> WildtrackLayout:
    """Recognize the data set of a folder. Raises ValueError for unknown names of cameras, and for an invalid config.json."""
    folder, config = path / "calibrations" / "extrinsic", path / "config.json"
    names = [file.stem.removeprefix("extr_") for file in sorted(folder.glob("extr_*.xml"))]
    if names and set(names) <= set(WILDTRACK_CAMERAS):
        cameras = {f"C{k}": name for k, name in enumerate(WILDTRACK_CAMERAS, 1) if name in names}
        return WildtrackLayout("WILDTRACK", cameras, 0.01, WILDTRACK_GRID, RATE, 5, SIZE)
    numbers = {int(match[1]): name for name in names if (match := re.fullmatch(r"Camera0*(\d{1,4})", name))}
    if not names or len(numbers) != len(names):
        other = next((name for name in names if name not in numbers.values()), "")
        raise ValueError(
            f"{folder}: has {f'extr_{other}.xml' if other else 'no cameras'}, needs extr_CVLab1.xml to extr_IDIAP3.xml (WILDTRACK)"
            " or extr_Camera1.xml, extr_Camera2.xml and so on (MultiviewX, GMVD, pilsim)"
        )
    cameras = {f"C{number}": numbers[number] for number in sorted(numbers)}
    if not config.is_file():
        return WildtrackLayout("MultiviewX", cameras, 1.0, MULTIVIEWX_GRID, RATE, 1, None)
    content = JsonObject(read_json(config), str(config))
    name, size, rate = str(content.values.get("Dataset", "GMVD"))[:80], None, RATE
    if name != "MultiviewX" or "rate" in content.values:
        rate = content.number("rate", MIN_RATE, MAX_RATE, "annotated frames per second, a field of pilsim, as GMVD does not tell it")
    if "img_shape" in content.values:
        height, width = content.array("img_shape", (2,), 1, MAX_SIDE, "height and width in pixels").astype(int).tolist()
        size = height, width
    return WildtrackLayout(name, cameras, 1.0, read_ground_grid(config), rate, 1, size)


def _check_unit(camera: RecordingCamera, layout: WildtrackLayout, file: Path) -> None:
    """Raises ValueError for a camera whose place indicates another unit of its translation."""
    place, (low, high) = camera.pose.translation, layout.area
    diagonal, away = float(np.linalg.norm(high - low)), float(np.linalg.norm(place[:2] - (low + high) / 2))
    unit = "centimetres" if layout.unit == 0.01 else "metres"
    if not LEAST_HEIGHT < place[2] < MOST_DISTANCE * diagonal or away > MOST_DISTANCE * diagonal:
        x, y, z = place.round(3) + 0.0
        raise ValueError(
            f"{file}: rvec and tvec put the camera at ({x:g}, {y:g}, {z:g}) m, needs a place {LEAST_HEIGHT:g} m or more above the ground"
            f" and within {MOST_DISTANCE * diagonal:.0f} m of the grid; the unit of {layout.name} is {unit}, and x_camera = R x_world + t"
        )


def _check_views(cameras: dict[str, RecordingCamera], layout: WildtrackLayout, folder: Path) -> None:
    """Raises ValueError where no camera sees any of the grid, which indicates rotations of another convention."""
    low, high = layout.area
    x, y = np.meshgrid(*np.linspace(low, high, GRID_SAMPLES).T)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    if not any(camera.camera.pixels_from_bearings(camera.pose.inverse().apply(points))[1].any() for camera in cameras.values()):
        raise ValueError(f"{folder}: no camera sees any point of the grid, needs rvec and tvec with x_camera = R x_world + t")


def _truth(path: Path, layout: WildtrackLayout) -> tuple[dict[int, tuple[Ints, Array]] | None, str]:
    """Frame from 0 → ids and places (k, 3) m, and a checksum of all files; None without annotations."""
    folder = path / "annotations_positions"
    files = sorted(folder.glob("*.json"))
    digest, truth = hashlib.sha256(), dict[int, tuple[Ints, Array]]()
    for file in files:
        frame = _frame(file, layout.step)
        if frame in truth:
            raise ValueError(f"{file}: frame {frame} occurs twice in {folder}")
        digest.update(file.read_bytes())
        people = read_positions(file)
        cells, seen = layout.grid.columns * layout.grid.rows, set[int]()
        for one in people:
            if one.person in seen:
                raise ValueError(f"{file}: personID {one.person} occurs twice")
            seen.add(one.person)
            if not 0 <= one.position < cells:
                raise ValueError(
                    f"{file}: person {one.person}: positionID is {one.position}, needs 0 to {cells - 1},"
                    f" a point of the grid of {layout.grid.columns} x {layout.grid.rows} ({layout.name})"
                )
        ids, positions = np.array([one.person for one in people], dtype=np.int64), np.array([one.position for one in people], dtype=np.int64)
        places = np.column_stack([layout.grid.points(positions), np.zeros(len(people))])
        for k, one in enumerate(people):
            if one.feet is not None:
                places[k] = _feet(one.feet, places[k], layout.grid.cell, f"{file}: person {one.person}")
        truth[frame] = ids, places
    if missing := sorted(set(range(max(truth, default=-1))) - set(truth)):
        named = ", ".join(f"{layout.step * frame:0{len(files[0].stem)}d}.json" for frame in missing[:3])
        say(f"{folder}: {named}{' and more' * (len(missing) > 3)} missing, so {len(missing)} of {max(truth) + 1} frames have nobody in the truth")
    return truth if files else None, digest.hexdigest()


def _feet(feet: Array, place: Array, cell: float, where: str) -> Array:
    """The exact place of a person, a field of pilsim. Raises ValueError where it is farther than a cell from its positionID."""
    if np.abs(feet[:2] - place[:2]).max() > cell:
        raise ValueError(f"{where}: feet is {feet.tolist()}, needs x, y, z within {cell:g} m of its positionID at {place[:2].tolist()}")
    return feet


def _frame(file: Path, step: int) -> int:
    """The frame, from 0, of a numbered file. Raises ValueError where its name is no number or is between two frames."""
    if not re.fullmatch(r"[0-9]{1,12}", file.stem):
        raise ValueError(f"{file}: its name is no number, needs that of a frame")
    frame, rest = divmod(int(file.stem), step)
    if rest:
        raise ValueError(f"{file}: number is {int(file.stem)}, needs a multiple of {step}, as frame k (from 1) is file {step} (k - 1)")
    if frame >= MAX_FRAMES:
        raise ValueError(f"{file}: frame is {frame}, needs less than {MAX_FRAMES}")
    return frame


def _images(folder: Path, step: int) -> ImageFiles:
    return ImageFiles({_frame(file, step): file for file in _pictures(folder)})


def _pictures(folder: Path) -> list[Path]:
    return visible_files(folder, PICTURES) if folder.is_dir() else []


def _image_size(path: Path, layout: WildtrackLayout) -> tuple[int, int] | None:
    """Height and width of the first image, None without images."""
    first = next((file for name in layout.cameras for file in _pictures(path / "Image_subsets" / name)), None)
    if first is None:
        return None
    size = image_size(first.read_bytes())
    if size is None:
        raise ValueError(f"{first}: {NO_PICTURE}")
    return size
