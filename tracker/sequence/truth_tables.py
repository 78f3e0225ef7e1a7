"""Tables of the ground truth of single views: boxes, key points, camera poses and joints; rows for the writer, and readers.

Pixels count from the corner of the image: the centre of the first pixel is (½, ½), whatever the camera model uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints
from tracker.io.csv_tables import read_header, read_table, rows_by_frame
from tracker.sequence.calibration import pose_from, pose_row
from tracker.sequence.schema import BOXES, CAMERAS, JOINTS, KEYPOINTS, POSE, SITS, people_columns
from tracker.types import KEYPOINT_COUNT, Boxes, Keypoints, ViewTruth


def camera_row(frame: int, camera: str, view: ViewTruth) -> list[object]:
    """A row of truth/cameras.csv."""
    return [frame, camera, *pose_row(view.T_world_camera), float(view.ground), *map(float, view.normal)]


def box_rows(frame: int, camera: str, boxes: Boxes) -> Iterator[list[object]]:
    """Rows of truth/boxes.csv."""
    numbers = np.column_stack([boxes.seen, boxes.full, boxes.visible, boxes.range])
    for person, row in zip(boxes.person.tolist(), numbers.tolist(), strict=True):
        yield [frame, camera, person, *row]


def keypoint_rows(frame: int, camera: str, keypoints: Keypoints) -> Iterator[list[object]]:
    """Rows of truth/keypoints.csv, rounded to 0.01 px."""
    for person, pixels, visibility in zip(keypoints.person.tolist(), keypoints.pixels.round(2), keypoints.visibility.tolist(), strict=True):
        row: list[object] = [frame, camera, person]
        for (u, v), seen in zip(pixels.tolist(), visibility, strict=True):
            row += [u, v, seen]
        yield row


def joint_rows(frame: int, persons: Ints, joints: Array) -> Iterator[list[object]]:
    """Rows of truth/joints.csv, rounded to 0.1 mm."""
    for person, points in zip(persons.tolist(), joints.round(4), strict=True):
        yield [frame, person, *points.ravel().tolist()]


def read_boxes(folder: Path) -> dict[tuple[int, str], Boxes]:
    """Read the true boxes: (frame, camera) → boxes. Views without people have no entry. Raises ValueError with file and line."""
    table = read_table(folder / "truth" / "boxes.csv", BOXES)
    numbers = np.column_stack([table[name] for name in list(BOXES)[3:]]).reshape(-1, 10)
    return {
        key: Boxes(table["person"][rows], numbers[rows, :4], numbers[rows, 4:8], numbers[rows, 8], numbers[rows, 9])
        for key, rows in _by_view(table["frame"], table["camera"]).items()
    }


def read_keypoints(folder: Path) -> dict[tuple[int, str], Keypoints]:
    """Read the true key points: (frame, camera) → key points, as read_boxes."""
    table = read_table(folder / "truth" / "keypoints.csv", KEYPOINTS)
    numbers = np.column_stack([table[name] for name in list(KEYPOINTS)[3:]]).reshape(-1, KEYPOINT_COUNT, 3)
    return {
        key: Keypoints(table["person"][rows], numbers[rows, :, :2], numbers[rows, :, 2].astype(np.int64))
        for key, rows in _by_view(table["frame"], table["camera"]).items()
    }


def read_joints(folder: Path) -> dict[int, tuple[Ints, Array]]:
    """Read the joints: frame → ids (m,) and key points (m, 17, 3) m in the world. Frames without people have no entry. Raises as read_boxes."""
    table = read_table(folder / "truth" / "joints.csv", JOINTS)
    numbers = np.column_stack([table[name] for name in list(JOINTS)[2:]]).reshape(-1, KEYPOINT_COUNT, 3)
    frames = _by_view(table["frame"], np.full(len(table["frame"]), ""))
    return {frame: (table["person"][rows], numbers[rows]) for (frame, _), rows in frames.items()}


def read_views(folder: Path) -> dict[tuple[int, str], ViewTruth]:
    """Read the ground truth of all views: (frame, camera) → truth. Raises ValueError as read_boxes."""
    boxes, keypoints = read_boxes(folder), read_keypoints(folder)
    cameras = rows_by_frame(folder / "truth" / "cameras.csv", CAMERAS, ("camera",))
    out = {}
    for frame, rows in cameras.items():
        for row in rows:
            key = frame, str(row["camera"])
            normal = np.array([row[name] for name in ("normal_x", "normal_y", "normal_z")])
            people = boxes.get(key, Boxes.none()), keypoints.get(key, Keypoints.none())
            try:
                out[key] = ViewTruth(pose_from([row[name] for name in POSE]), row["ground"], normal, *people)
            except ValueError as error:
                raise ValueError(f"{folder / 'truth' / 'cameras.csv'}: frame {frame} of {key[1]}: {error}") from None
    return out


def people_columns_of(folder: Path, cameras: Iterable[str]) -> dict[str, type]:
    """Columns of the truth/people.csv of a sequence: with `sits` where its header ends with it. Raises ValueError where the file cannot be read."""
    return people_columns(cameras, read_header(folder / "truth" / "people.csv")[-1:] == [SITS])


def _by_view(frame: Ints, camera: NDArray[np.str_]) -> dict[tuple[int, str], NDArray[np.int64]]:
    """(frame, camera) → rows, in the order of the table."""
    found: dict[tuple[int, str], list[int]] = {}
    for row, key in enumerate(zip(frame.tolist(), camera.tolist(), strict=True)):
        found.setdefault(key, []).append(row)
    return {key: np.array(rows) for key, rows in found.items()}
