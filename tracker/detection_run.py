"""Find people in the images of a source, and write their boxes: one MOT15 file for each camera, and a statement of the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.formats.motchallenge import rows_from_boxes, write_mot15
from tracker.geometry import Array, Image
from tracker.io.atomic import new_folder, write_text
from tracker.io.file_lock import folder_lock
from tracker.io.image_files import decode_image, image_size
from tracker.io.json_files import json_text, read_json
from tracker.io.progress import progress_bar
from tracker.io.resume import check_same, holds_run, json_value
from tracker.io.video_files import open_video
from tracker.person_detector.detected_ticks import sites_of
from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.pixels import MOST_PIXELS
from tracker.types import Sequence

RUN = "run.json"
PICTURES = (".jpg", ".jpeg", ".png")
VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg")
LINE = (255, 64, 0)
"""RGB of a drawn box."""


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """An image of a camera: frame from 0, camera, image (H, W, 3) RGB, and what is known of the camera's place."""

    frame: int
    camera: str
    image: Image
    site: CameraPlace


def is_pictures(path: Path) -> bool:
    """Whether `path` is a video, an image, or a folder with images or videos in it."""
    if path.is_file():
        return path.suffix.lower() in (*PICTURES, *VIDEOS)
    return path.is_dir() and any(one.suffix.lower() in (*PICTURES, *VIDEOS) for one in path.iterdir())


def frames_of_pictures(path: Path) -> Iterator[PictureFrame]:
    """The frames of a video, an image, or a folder. Images of a folder, in the order of their names, are one camera, and videos are one each.

    Raises ValueError with the path for a damaged or too large image, a video that ends early, and for sizes that change.
    """
    files = [path] if path.is_file() else sorted(one for one in path.iterdir() if one.suffix.lower() in (*PICTURES, *VIDEOS))
    images = [file for file in files if file.suffix.lower() in PICTURES]
    for index, file in enumerate(images):
        yield PictureFrame(index, path.stem, _picture(file), CameraPlace())
    for file in files:
        if file.suffix.lower() in VIDEOS:
            yield from _video(file)


def _picture(file: Path) -> Image:
    data = file.read_bytes()
    size = image_size(data)
    try:
        if size is None:
            raise ValueError("is no PNG or JPEG")
        if size[0] * size[1] > MOST_PIXELS:
            raise ValueError(f"is {size[1]} x {size[0]} px, needs at most {MOST_PIXELS} px")
        image = decode_image(data, size, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def _video(file: Path) -> Iterator[PictureFrame]:
    video, shape, index = open_video(file), None, 0
    said = round(video.get(cv2.CAP_PROP_FRAME_COUNT))
    try:
        while True:
            success, image = video.read()
            if not success:
                break
            if shape is not None and image.shape != shape:
                raise ValueError(f"{file}: frame {index} is {image.shape[1]} x {image.shape[0]} px, needs {shape[1]} x {shape[0]} as the first")
            shape = image.shape
            yield PictureFrame(index, file.stem, np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8), CameraPlace())
            index += 1
    finally:
        video.release()
    if index < said:
        raise ValueError(f"{file}: ends after {index} of the {said} frames that it names")


def frames_of_sequence(sequence: Sequence) -> Iterator[PictureFrame]:
    """The images of all cameras of a sequence, tick by tick."""
    sites = sites_of(sequence.setup)
    for tick in sequence.ticks:
        for view in tick.views:
            if view.image is not None:
                yield PictureFrame(tick.index, view.camera, view.image, sites[view.camera])


@dataclass(frozen=True, eq=False)
class DetectionRun:
    """How people are found: the detector, whether images wrap (None for what the camera says), and whether pictures with boxes are written."""

    detector: PersonDetector
    wraps: bool | None = None
    pictures: bool = False


def write_detections(frames: Iterator[PictureFrame], total: int | None, folder: Path, run: Mapping[str, Any], how: DetectionRun) -> dict[str, Any]:
    """Find people in all frames and write the boxes into a new or empty folder, or read the statement of the same run there.

    Returns the statement with `found`: camera → numbers of frames and boxes. total: number of frames, for the progress bar.
    Raises ValueError where the folder holds another run, or no frame has an image; the errors of `frames` leave no folder.
    """
    wanted = json_value({**run, "model": how.detector.network.checksum, "wraps": how.wraps, "pictures": how.pictures})
    if (there := _same(folder, wanted)) is not None:
        return there
    with folder_lock(folder):
        if (there := _same(folder, wanted)) is not None:
            return there
        with new_folder(folder) as partial:
            boxes: dict[str, dict[int, tuple[Array, Array]]] = {}
            for one in progress_bar(frames, total=total, desc="detecting", unit="image"):
                found = how.detector.find(one.image, one.site, how.wraps)
                boxes.setdefault(one.camera, {})[one.frame + 1] = np.round(found.box, 2), np.round(found.probability, 4)
                if how.pictures:
                    _draw(partial / "pictures" / one.camera / f"{one.frame + 1:06d}.jpg", one.image, found.box)
            if not boxes:
                raise ValueError(f"{run.get('source')}: no images to search, neither of a video nor of files")
            for camera, rows in boxes.items():
                write_mot15(partial / f"{camera}.txt", rows_from_boxes(rows))
            counted = {camera: {"frames": len(rows), "boxes": sum(len(box) for box, _ in rows.values())} for camera, rows in boxes.items()}
            statement = {**wanted, "found": counted}
            write_text(partial / RUN, json_text(statement, indent=1) + "\n")
    return statement


def _same(folder: Path, wanted: Mapping[str, Any]) -> dict[str, Any] | None:
    if not holds_run(folder, RUN):
        return None
    there = read_json(folder / RUN)
    if not isinstance(there, dict) or not isinstance(there.get("found"), dict):
        raise ValueError(f"{folder / RUN}: is no statement of detections")
    check_same(folder, there, wanted)
    return there


def _draw(file: Path, image: Image, boxes: Array) -> None:
    """Write an image with boxes drawn; what passes the seam goes on at the left edge."""
    drawn = np.array(image)
    for left, top, width, height in boxes:
        for shift in (0, image.shape[1]) if left + width > image.shape[1] else (0,):
            corners = np.round([left - shift, top, left + width - shift, top + height]).astype(int).tolist()
            cv2.rectangle(drawn, corners[:2], corners[2:], LINE, 2)
    file.parent.mkdir(parents=True, exist_ok=True)
    ok, data = cv2.imencode(".jpg", drawn[:, :, ::-1])
    if not ok:
        raise ValueError(f"{file}: cannot be encoded")
    file.write_bytes(data.tobytes())
