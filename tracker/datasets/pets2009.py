"""Reading a PETS 2009 folder as a recording: cameras, detections, ground truth and videos."""

from __future__ import annotations

import re
from pathlib import Path

from tracker.datasets.source_options import SourceOptions, camera_named
from tracker.formats.pets2009 import AREA, FILE, RATE, TERRAIN, Site, ground_truth, read_annotations, read_camera, read_site
from tracker.geometry import Array, Ints
from tracker.io.resume import checksum
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.folder import read_boxes
from tracker.recordings.images import VideoFile
from tracker.recordings.recording import MAX_FRAMES

PETS_AREA, PETS_RATE = AREA, RATE

PETS_VIEWS = (1, 5, 7)
"""Numbers of the views of S2.L1 that the literature uses."""


def is_pets(path: Path) -> bool:
    """Whether a folder is laid out as PETS 2009: detections or annotations, and calibrations as View_00N.xml in it or beside it."""
    folder = calibration_of(path)
    named = folder is not None and any(folder.glob("View_*.xml"))
    return named and ((path / "annotations").is_dir() or (path / "detections").is_dir())


def calibration_of(path: Path) -> Path | None:
    """The folder calibration/ in a PETS 2009 folder or beside it, or None."""
    return next((p for p in (path / "calibration", path.parent / "calibration") if p.is_dir()), None)


def read_pets(path: Path, options: SourceOptions) -> Recording:
    """Read a PETS 2009 folder; calibration/ lies in it or beside it. Of `options`, cameras and the names in detections count here.

    A camera whose detections are replaced needs no file of its own. Raises ValueError with the path for missing or invalid content.
    """
    calibration = calibration_of(path)
    if calibration is None:
        raise ValueError(f"{path}: no calibration/ in it or beside it")
    found = _detection_files(path, calibration, options)
    cameras, detections = {}, dict[str, FrameBoxes]()
    for name, file in found.items():
        _, camera, pose = read_camera(calibration / f"{name}.xml")
        cameras[name] = RecordingCamera(camera, pose)
        if file is not None:
            detections[name] = read_boxes(file)
    site = read_site(path)
    truth = _pets_truth(path, calibration, site)
    files = [file for file in found.values() if file is not None] + sorted((path / "annotations").glob("*-cropped.xml"))
    files += [file for file in (path / FILE, path / TERRAIN) if file.is_file()]
    sums = {file.name: checksum(file) for file in files}
    videos = {name: path / "video" / f"{name}.mp4" for name in cameras}
    return Recording(
        site.rate,
        cameras,
        detections,
        truth,
        area=site.area,
        ground=site.ground,
        occluders=site.occluders,
        pillars=site.pillars,
        images={name: VideoFile(video) for name, video in videos.items() if video.is_file()},
        source={"source": "PETS 2009", "views": list(cameras), "files": sums},
    )


def _detection_files(path: Path, calibration: Path, options: SourceOptions) -> dict[str, Path | None]:
    """Camera → file of its detections, None where `options` replace it. Raises ValueError where the file of a wanted view is missing."""
    found: dict[str, Path | None] = {}
    for file in sorted((path / "detections").glob("*.txt")):
        if match := re.fullmatch(r"View_0*(\d+)\.txt", file.name):
            found[f"View_{int(match[1]):03d}"] = file
    calibrated = [file.stem for file in sorted(calibration.glob("View_*.xml"))]
    if options.pixels:
        found |= {name: None for name in calibrated if name not in found and (path / "video" / f"{name}.mp4").is_file()}
    wanted = [camera_named(text, calibrated) for text in options.cameras]
    for text in filter(None, options.detections):
        name = camera_named(text, calibrated)
        if wanted and name not in wanted:
            raise ValueError(f"--detections names {name}, --cameras has {','.join(options.cameras)}")
        found[name] = None
    for name in wanted:
        if name not in found and not options.detections.get(""):
            raise ValueError(f"{path / 'detections' / name}.txt: no such file; there are {', '.join(found) or 'none'}")
    if not found:
        raise ValueError(f"{path / 'detections'}: no View_00N.txt")
    return {name: found.get(name) for name in wanted or found}


def _pets_truth(path: Path, calibration: Path, site: Site) -> dict[int, tuple[Ints, Array]] | None:
    """Ground truth from the cropped annotation, which is in the image of View_001: frame from 0 → ids and feet; None without annotation."""
    files = sorted((path / "annotations").glob("*-cropped.xml"))
    if not files:
        return None
    if len(files) > 1:
        raise ValueError(f"{path / 'annotations'}: {len(files)} files *-cropped.xml, needs one")
    _, camera, pose = read_camera(calibration / "View_001.xml")
    annotations = read_annotations(files[0])
    try:
        people = ground_truth(annotations, camera, pose, site.ground)
    except ValueError as error:
        raise ValueError(f"{files[0]}: {error}") from None
    if max(people, default=-1) >= MAX_FRAMES:
        raise ValueError(f"{files[0]}: frame {max(people)}, needs less than {MAX_FRAMES}")
    return people
