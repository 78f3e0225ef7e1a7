"""Export to WILDTRACK in the variant of MultiviewX and GMVD: fixed cameras, ground positions of people, and detections.

rectangles.pom belongs to the probabilistic occupancy map (Fleuret et al. 2008): the box of a person at each grid cell in each camera.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from tracker.formats.exported_sequence import OPENCV_CORNER, PNG, RecordedSequence
from tracker.formats.wildtrack.files import HIDDEN, GroundGrid, WildtrackPosition, opencv_camera, write_calibration, write_config, write_positions
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Pinhole
from tracker.io.mot15 import write_mot15
from tracker.recordings import RecordingCamera

README = """
    SEQUENCE/Image_subsets/C1/0000.png               images, RGB, frames from 0, cameras from 1
    SEQUENCE/annotations_positions/00000.json        who stands where, a file a frame, frames from 0
    SEQUENCE/calibrations/intrinsic/intr_Camera1.xml camera_matrix [px], distortion_coefficients (k1, k2, p1, p2, k3), as OpenCV has them
    SEQUENCE/calibrations/extrinsic/extr_Camera1.xml rvec [rad], tvec [m] from the world to the camera (x right, y down, z forward)
    SEQUENCE/config.json                             as GMVD's: img_shape [height, width] px, grid_shape [rows along y, columns along x],
                                                     grid_cell [m], origin [x, y] m of cell 0, region_size [y, x] m; rate [1/s] is ours
    SEQUENCE/detections/C1.txt                       ours: what the simulated detector reported

Annotations: personID: pilsim's, the same in all views and at all times. positionID = gx + columns · gy counts the points of a grid along x first;
x = origin x + grid_cell · gx, y = origin y + grid_cell · gy: the place to 12.5 mm. feet (ours): x, y, z [m], the ground under the middle of the body,
in pilsim's world (right-handed, z up). views: viewNum from 0 (view 0 is C1), xmin, ymin, xmax, ymax [px]: the first and the last column and row
of the whole body, as if nothing were before it, the part in the image; the first pixel is 0. All are −1 in a view that does not show the person.
Who is in no view is left out.

detections: MOT15, frames from 1 (frame k is annotation k − 1): frame, −1, left, top, width, height [px], confidence, −1, −1, −1. The first
pixel has its centre at (0, 0), so that a box of it has left −0.5 and width 1. `pilsim track SEQUENCE` reads this folder with them.

SEQUENCE/rectangles.pom, only where it was asked for (--rectangles): "RECTANGLE camera cell left top right bottom" [px], the first and the last column
and row, or "RECTANGLE camera cell notvisible": what a cylinder of 1.75 m and 0.25 m radius that stands on the ground of that cell covers of the
image, as if nothing were before it. camera from 0 (0 is C1), cell is positionID.

The tools for this format take the ground for the plane z = 0.
"""

HEIGHT, RADIUS = 1.75, 0.25
"""m: of the upright cylinder that models a person."""
CORNERS = 8
"""Points around each end of the cylinder."""
MIN_DEPTH = 0.2
"""m: a cylinder with a point of smaller depth is not visible."""
CELLS_AT_ONCE = 50_000
"""Cells that are projected together, to bound the memory."""


def export_wildtrack(out: Path, recordings: Iterable[RecordedSequence], rectangles: bool = False) -> list[str]:
    """Write the sequences. The notes map C1 and so on to cameras, and give calibration errors and the heights of people.

    rectangles: also write rectangles.pom, with a line for each camera and cell.
    Raises ValueError where a sequence has no fixed camera, fixed cameras of different image sizes, or one that is no pinhole.
    """
    notes = []
    for recording in recordings:
        fixed = recording.require_fixed("wildtrack")
        sizes = {(view.camera.height, view.camera.width) for view in fixed.values()}
        if len(sizes) > 1:
            raise ValueError(f"{recording.folder}: fixed cameras have {len(sizes)} sizes of image, wildtrack needs one")
        root, camera_notes = out / recording.name, []
        cameras = []
        for number, (camera, view) in enumerate(fixed.items(), 1):
            try:
                calibrated, error = opencv_camera(view.camera, view.pose)
            except ValueError as fault:
                raise ValueError(f"{recording.folder}: {camera}: {fault}, which wildtrack can hold") from None
            cameras.append(calibrated)
            write_calibration(root / "calibrations", f"Camera{number}", calibrated)
            distorted = isinstance(calibrated.camera, Pinhole) and any(calibrated.camera.distortion)
            fitted = f" (its distortion is fitted to {error:.2g} px)" if error and distorted else ""
            camera_notes.append(f"C{number} is {camera}{fitted}")
            (root / "Image_subsets" / f"C{number}").mkdir(parents=True)
        _write_detections(root / "detections", recording)
        feet = np.concatenate([t.feet for t in recording.truth]).reshape(-1, 3)
        grid = GroundGrid.around(feet[:, :2])
        write_config(root / "config.json", grid, len(fixed), len(recording.truth), next(iter(sizes)), recording.rate)
        if rectangles:
            write_rectangles(root / "rectangles.pom", grid, cameras, recording.sequence.setup.ground.height_at)
        (root / "annotations_positions").mkdir()
        for k in recording.frames():
            write_positions(root / "annotations_positions" / f"{k:05d}.json", positions_in_frame(recording, k, grid))
            for number, camera in enumerate(fixed, 1):
                (root / "Image_subsets" / f"C{number}" / f"{k:04d}.png").write_bytes(recording.image(k, camera, PNG))
        height = float(np.abs(feet[:, 2]).max(initial=0.0))
        notes.append(f"{recording.name}: {', '.join(camera_notes)}. People stand at most {height:.2f} m above or below z = 0.")
    return notes


def _write_detections(folder: Path, recording: RecordedSequence) -> None:
    """Write C1.txt and so on, in the order of the fixed cameras."""
    folder.mkdir()
    for number, camera in enumerate(recording.fixed, 1):
        write_mot15(folder / f"C{number}.txt", recording.detection_rows(camera, OPENCV_CORNER))


def positions_in_frame(recording: RecordedSequence, frame: int, grid: GroundGrid) -> list[WildtrackPosition]:
    """People in the image of a fixed camera, occluded or not, in the order of the truth."""
    truth = recording.truth[frame]
    shown: dict[int, dict[int, tuple[int, ...]]] = {}
    for number, camera in enumerate(recording.fixed):
        boxes = recording.views[frame, camera].boxes
        for person, (left, top, right, bottom) in zip(boxes.person.tolist(), boxes.full.tolist(), strict=True):
            edges = np.floor([left, top]).tolist() + (np.ceil([right, bottom]) - 1).tolist()
            shown.setdefault(person, {})[number] = tuple(int(edge) for edge in edges)
    position = grid.positions(truth.feet)
    positions = []
    for k, person in enumerate(truth.person_id.tolist()):
        if person in shown:
            edges_of_views = [shown[person].get(number, HIDDEN) for number in range(len(recording.fixed))]
            positions.append(WildtrackPosition(person, int(position[k]), np.array(edges_of_views, dtype=np.int64), truth.feet[k]))
    return positions


def rectangles(camera: RecordingCamera, feet: Array) -> Ints:
    """Boxes (n, 4) px of people at feet (n, 3) m: left, top, right, bottom, clipped to the image.

    All four are −1 for people outside the image.
    """
    around = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ring = RADIUS * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    body = np.concatenate([ring, ring + np.array([0.0, 0.0, HEIGHT])])
    points = camera.pose.inverse().apply((feet[:, None] + body).reshape(-1, 3))
    pixels = camera.camera.pixels_from_bearings(points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9))[0]
    pixels = np.where(points[:, :1] > MIN_DEPTH, pixels, np.nan).reshape(len(feet), len(body), 2)
    last = np.array([camera.camera.width, camera.camera.height]) - 1
    low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1))
    # Comparisons with NaN, from points without a pixel, are false, so such people are hidden.
    shown = (high >= 0).all(axis=1) & (low <= last).all(axis=1)
    boxes = np.tile(np.array(HIDDEN, dtype=np.int64), (len(feet), 1))
    boxes[shown] = np.concatenate([np.clip(low[shown], 0, last), np.clip(high[shown], 0, last)], axis=1)
    return boxes


def write_rectangles(path: Path, grid: GroundGrid, cameras: Sequence[RecordingCamera], ground: Callable[[Array], Array]) -> None:
    """Write a line for each camera and cell, about 30 bytes each. ground: x, y (n, 2) m → heights (n,) m."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        for number, camera in enumerate(cameras):
            for first in range(0, grid.columns * grid.rows, CELLS_AT_ONCE):
                cells = np.arange(first, min(first + CELLS_AT_ONCE, grid.columns * grid.rows))
                positions = grid.points(cells)
                found = rectangles(camera, np.column_stack([positions, ground(positions)]))
                file.writelines(_lines(number, cells, found))


def _lines(camera: int, cells: Ints, found: Ints) -> Iterable[str]:
    for cell, (left, top, right, bottom) in zip(cells.tolist(), found.tolist(), strict=True):
        yield f"RECTANGLE {camera} {cell} notvisible\n" if left < 0 else f"RECTANGLE {camera} {cell} {left} {top} {right} {bottom}\n"
