"""A scene of the AI City Challenge, track 1 (files.py), as a Recording of its people.

calibration.json has the cameras. ground_truth.json is optional; only its people are read. videos/CAMERA.mp4 is optional, with an
image for each frame. detections/CAMERA.txt is optional and not of the challenge: MOT15, frames from 1, px from the centre of the first pixel.

The challenge names the videos Camera_0000, Camera_0001, … where the ids of the cameras are Camera, Camera_01, …. Both names are found.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from tracker.formats.aicity.files import CALIBRATION, PERSON, TRUTH, AiCityObject, read_calibration, read_ground_truth
from tracker.geometry import Array, Ints
from tracker.io.resume import checksums
from tracker.recordings import Recording
from tracker.recordings.folder import read_boxes
from tracker.recordings.images import VideoFile

SOURCE = "aicity"
DETECTIONS, VIDEOS = "detections", "videos"
HEAD = 1 << 16
"""Bytes of calibration.json that are searched for its list of sensors."""
_NUMBERED = re.compile(r"Camera_?(\d{0,9})")


def is_aicity(path: Path) -> bool:
    """Whether a folder holds a calibration.json with a list of sensors."""
    file = path / CALIBRATION
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        return b'"sensors"' in opened.read(HEAD)


def read_aicity(path: Path) -> Recording:
    """Read a scene. The feet of people are below the middle of their boxes by half the height; objects of other classes are left out.

    Recording.source["left_out"] has class → number of its boxes that are left out.
    Raises ValueError with file and field or line for missing or invalid content, cameras of different rates, and detections of no camera.
    """
    rate, cameras = read_calibration(path / CALIBRATION)
    named = _detections(path / DETECTIONS, list(cameras))
    truth, left_out = None, Counter[str]()
    if (path / TRUTH).is_file():
        truth, left_out = people(read_ground_truth(path / TRUTH))
    videos = {file.stem: file for file in sorted((path / VIDEOS).glob("*.mp4"))}
    try:
        return Recording(
            rate,
            cameras,
            {name: read_boxes(file) for name, file in named.items()},
            truth,
            images={name: VideoFile(found) for name in cameras if (found := _of_camera(name, videos)) is not None},
            source={
                "source": SOURCE,
                "cameras": list(cameras),
                "left_out": dict(sorted(left_out.items())),
                "files": checksums(path, [path / CALIBRATION, path / TRUTH, *named.values()]),
            },
        )
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path / CALIBRATION}: {error}") from None


def _detections(folder: Path, cameras: list[str]) -> dict[str, Path]:
    """Camera → its file of detections. Raises ValueError for a file that belongs to no camera."""
    files = {file.stem: file for file in sorted(folder.glob("*.txt"))}
    named = {name: found for name in cameras if (found := _of_camera(name, files)) is not None}
    unknown = [file for file in files.values() if file not in named.values()]
    if unknown:
        raise ValueError(f"{unknown[0]}: is of camera {unknown[0].stem!r}, {CALIBRATION} has {', '.join(cameras)}")
    return named


def _of_camera(name: str, files: dict[str, Path]) -> Path | None:
    """The file of a camera by its name, or by the number in it with four digits."""
    numbered = _NUMBERED.fullmatch(name)
    return files.get(name, files.get(f"Camera_{int(numbered[1] or 0):04d}") if numbered else None)


def people(truth: dict[int, list[AiCityObject]]) -> tuple[dict[int, tuple[Ints, Array]], Counter[str]]:
    """Frame → ids (k,) and feet (k, 3) m of the people, and the number of the objects of other classes."""
    left_out = Counter(one.kind for objects in truth.values() for one in objects if one.kind != PERSON)
    out = {}
    for frame, objects in truth.items():
        here = [one for one in objects if one.kind == PERSON]
        feet = np.array([one.centre - [0.0, 0.0, one.size[2] / 2] for one in here]).reshape(-1, 3)
        out[frame] = np.array([one.id for one in here], dtype=np.int64), feet
    return out, left_out
