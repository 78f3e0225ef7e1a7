"""Find people in the images of a source, and write their boxes: one MOT15 file for each camera, and a statement of the run."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.geometry import Array, Image
from tracker.io.atomic import Kept, begin_folder, discard_folder, finish_folder, unfinished_path, write_text
from tracker.io.json_files import json_text, read_json
from tracker.io.mot15 import VISIBLE_FILE, rows_from_boxes, write_mot15
from tracker.io.progress import progress_bar
from tracker.io.resume import Journal, check_same, holds_run, json_value, program_version, same_or_new
from tracker.io.video_files import VideoWriters
from tracker.person_detector.detector import PersonDetector
from tracker.person_detector.pictures import PictureFrame

RUN, JOURNAL = "run.json", ".found.jsonl"
BOXES, VISIBLE = "boxes", "visible"
"""Entry of the statement, and its value where CAMERA.txt holds visible parts; it is null where that holds whole bodies."""
LINE = (255, 64, 0)
"""RGB of a drawn box."""


@dataclass(frozen=True, eq=False)
class DetectionRun:
    """How people are found: the detector, whether images wrap (None for the camera's own value), and what is written beside the boxes.

    pictures: a JPEG of each image with the boxes drawn. video: a video of each camera with the boxes drawn.
    visible: whether CAMERA.txt holds the boxes of visible parts in place of those of whole bodies.
    """

    detector: PersonDetector
    wraps: bool | None = None
    pictures: bool = False
    video: bool = False
    visible: bool = False


def write_detections(frames: Iterable[PictureFrame], total: int | None, folder: Path, run: Mapping[str, Any], how: DetectionRun) -> dict[str, Any]:
    """Find people in all frames and write the boxes into a new or empty folder, or read the statement of the same run there.

    Each camera has CAMERA.txt, and CAMERA.visible.txt with a row for each of its rows. The latter has the box of the
    visible part and, in place of the probability, the visible share of the body. Models without visible parts give whole boxes and shares of 1.

    A run that was killed or interrupted is resumed: unchanged images are not searched again.
    Returns the statement with `found`: camera → numbers of frames and boxes. total: number of frames, for the progress bar.
    Raises ValueError where the folder holds another run, or no frame has an image; the errors of `frames` leave no folder.
    """
    wanted = json_value({**run, "model": how.detector.network.checksum, "wraps": how.wraps, "pictures": how.pictures, "video": how.video})
    # Older versions wrote whole bodies only and had no entry, which equals null.
    wanted[BOXES] = VISIBLE if how.visible else None
    return same_or_new(
        folder,
        lambda: _same(folder, wanted),
        lambda: _new(progress_bar(frames, total=total, desc="detecting", unit="image"), folder, wanted, how),
    )


def _new(frames: Iterable[PictureFrame], folder: Path, wanted: dict[str, Any], how: DetectionRun) -> dict[str, Any]:
    """Find people in all frames, write the boxes into a folder without content, and return the statement."""
    partial = unfinished_path(folder)
    journal = Journal(partial / JOURNAL, {"version": program_version(), **wanted})
    if not journal.found:
        begin_folder(folder)
    try:
        statement = _written(frames, partial, wanted, how, journal)
    except OSError as error:
        raise Kept.of(error, partial) from error
    except Exception:
        discard_folder(partial)
        raise
    finish_folder(folder, partial)
    return statement


def _written(frames: Iterable[PictureFrame], partial: Path, wanted: dict[str, Any], how: DetectionRun, journal: Journal) -> dict[str, Any]:
    """Write all files into the temporary folder and return the statement. The journal has the boxes of each image that was searched."""
    known = {(entry.get("camera"), entry.get("frame"), entry.get("image")): entry for entry in journal.entries}
    boxes: dict[str, dict[int, tuple[Array, Array]]] = {}
    parts: dict[str, dict[int, tuple[Array, Array]]] = {}
    with journal, ExitStack() as stack:
        videos, sizes = VideoWriters(partial / "videos", PictureFrame.rate), dict[str, tuple[int, ...]]()
        stack.callback(videos.close)
        for one in frames:
            key = one.camera, one.frame, zlib.crc32(one.image.tobytes())
            if (entry := known.get(key)) is None:
                found = how.detector.find(one.image, one.site, how.wraps)
                entry = dict(zip(("camera", "frame", "image"), key, strict=True))
                entry |= {"box": np.round(found.box, 2).tolist(), "probability": np.round(found.score, 4).tolist()}
                entry["visible"] = np.round(found.visible, 4).tolist()
                journal.add(entry)
            box, probability = np.array(entry["box"], dtype=float).reshape(-1, 4), np.array(entry["probability"], dtype=float)
            visible = np.array(entry["visible"], dtype=float).reshape(-1, 5)
            part = np.round(visible[:, :4], 2)
            parts.setdefault(one.camera, {})[one.frame + 1] = part, visible[:, 4]
            if how.visible:
                box = part
            boxes.setdefault(one.camera, {})[one.frame + 1] = box, probability
            if how.pictures or how.video:
                drawn = _drawn(one.image, box)
            if how.pictures:
                _write_picture(partial / "pictures" / one.camera / f"{one.frame + 1:06d}.jpg", drawn)
            if how.video:
                _check_size(one, sizes.setdefault(one.camera, drawn.shape))
                videos.put(one.camera, drawn, one.rate)
        videos.finish()
    if not boxes:
        raise ValueError(f"{wanted.get('source')}: no images to search, neither of a video nor of files")
    for camera, rows in boxes.items():
        write_mot15(partial / f"{camera}.txt", rows_from_boxes(rows))
        write_mot15(partial / f"{camera}{VISIBLE_FILE}", rows_from_boxes(parts[camera]))
    counted = {camera: {"frames": len(rows), "boxes": sum(len(box) for box, _ in rows.values())} for camera, rows in boxes.items()}
    statement = {**wanted, "found": counted}
    write_text(partial / RUN, json_text(statement, indent=1) + "\n")
    journal.remove()
    return statement


def _check_size(frame: PictureFrame, first: tuple[int, ...]) -> None:
    """Raises ValueError where an image has not the size of the first one of its camera."""
    height, width = frame.image.shape[:2]
    if (height, width) != first[:2]:
        raise ValueError(f"{frame.camera}: has images of {first[1]} x {first[0]} and {width} x {height} px, --video needs one size")


def _same(folder: Path, wanted: Mapping[str, Any]) -> dict[str, Any] | None:
    if not holds_run(folder, RUN):
        return None
    there = read_json(folder / RUN)
    if not isinstance(there, dict) or not isinstance(there.get("found"), dict):
        raise ValueError(f"{folder / RUN}: is no statement of detections")
    check_same(folder, there, wanted)
    return there


def _drawn(image: Image, boxes: Array) -> Image:
    """The image with boxes drawn; a box across the seam continues at the left edge."""
    drawn = np.array(image)
    for left, top, width, height in boxes:
        for shift in (0, image.shape[1]) if left + width > image.shape[1] else (0,):
            corners = np.round([left - shift, top, left + width - shift, top + height]).astype(int).tolist()
            cv2.rectangle(drawn, corners[:2], corners[2:], LINE, 2)
    return drawn


def _write_picture(file: Path, image: Image) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    ok, data = cv2.imencode(".jpg", image[:, :, ::-1])
    if not ok:
        raise ValueError(f"{file}: cannot be encoded")
    file.write_bytes(data.tobytes())
