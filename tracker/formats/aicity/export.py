"""Export to track 1 of the AI City Challenge: scenes of fixed cameras with truth, and results as the file of a submission."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from tracker.formats.aicity.files import (
    CALIBRATION,
    PERSON,
    TRUTH,
    AiCityObject,
    AiCityRows,
    write_calibration,
    write_ground_truth,
    write_results,
)
from tracker.formats.aicity.person_boxes import boxes_of_tracks
from tracker.formats.exported_sequence import OPENCV_CORNER, RecordedSequence, export_folder
from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole, Tsai
from tracker.io.atomic import write_text
from tracker.io.image_files import decode_image
from tracker.io.mot15 import write_mot15
from tracker.io.video_files import VideoWriters
from tracker.recordings import RecordingCamera
from tracker.sequence.results import RUN, Results, read_results

RESULT_FILE = "track1.txt"

README = """
    SEQUENCE/calibration.json      cameras
    SEQUENCE/ground_truth.json     people, frames from 0
    SEQUENCE/videos/CAMERA.mp4     images (MPEG-4 part 2), one for each frame
    SEQUENCE/detections/CAMERA.txt what pilsim's simulated detector reported; the challenge has no such file

The world is pilsim's: right-handed, z up, metres, its own origin. Cameras are fixed pinholes without distortion. Pixels: u to the right, v down;
the centre of the first pixel is (0, 0).

calibration.json: `sensors`, a camera each. id: pilsim's name. attributes: fps [1/s], frameWidth, frameHeight [px], as text. intrinsicMatrix K [px].
extrinsicMatrix [R | t]: x_camera = R x_world + t [m], x right, y down, z ahead. cameraMatrix: K [R | t]. homography: from (x, y, 1) [m] on the plane
z = 0 to the image [px], its last number 1. coordinates: x, y, z [m] of the camera. There is no plan of the scene (map.png): scaleFactor is 1 and
translationToGlobalCoordinates is 0.

ground_truth.json: frame → list of people. object type: Person. object id: pilsim's, the same in all views and at all times. 3d location: x, y, z [m],
the middle of the box. 3d bounding box scale: width, length, height [m] along the box's own axes: 0.6, 0.6, 1.75 for everybody. 3d bounding box
rotation: pitch, roll, yaw [rad]: 0, 0, and the direction of motion, anticlockwise from x; who stands keeps the last. 2d bounding box visible:
camera → first x, first y, last x, last y [px] of what is seen; cameras that see nothing of a person are left out.

detections: MOT15, ten values a line: frame from 1, −1, left, top, width, height [px], confidence in [0, 1], −1, −1, −1.
"""

README_RESULTS = """
    track1.txt    one person in one frame a line, eleven values separated by blanks, no header; as the challenge takes it

scene_id: {scene}. class_id: 0, a person. object_id: the track's number, from 1. frame_id: from 0. x, y, z [m]: the middle of the box, in the world
of the cameras' calibration; the feet are 0.875 m below. width, length, height [m]: 0.6, 0.6, 1.75 for everybody. yaw [rad]: the direction of motion,
anticlockwise from x, from the past alone; who stands keeps the last, and who has not moved has 0.
"""


def export_aicity(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write the sequences. Returns no notes.

    Raises ValueError where a sequence has no fixed pinhole camera, or one with a distortion, which the format cannot hold.
    """
    for recording in recordings:
        fixed, root = recording.require_fixed("aicity"), out / recording.name
        (root / "detections").mkdir(parents=True)
        write_calibration(root / CALIBRATION, recording.rate, {name: camera_of(name, view, recording) for name, view in fixed.items()})
        _write_videos(root / "videos", recording)
        write_ground_truth(root / TRUTH, truth_of(recording))
        for name in fixed:
            write_mot15(root / "detections" / f"{name}.txt", recording.detection_rows(name, OPENCV_CORNER))
    return []


def camera_of(name: str, view: RecordingCamera, recording: RecordedSequence) -> RecordingCamera:
    """A fixed camera of the sequence. Raises ValueError where it is no pinhole camera, or has a distortion."""
    camera = view.camera
    if isinstance(camera, Tsai) and not camera.kappa1:
        camera = Pinhole(camera.width, camera.height, camera.focal * camera.sx / camera.dpx, camera.focal / camera.dpy, camera.cx, camera.cy)
    if not isinstance(camera, Pinhole) or any(camera.distortion):
        raise ValueError(f"{recording.folder}: {name} is {camera}, aicity needs a pinhole camera without distortion")
    return RecordingCamera(camera, view.pose)


def _write_videos(folder: Path, recording: RecordedSequence) -> None:
    writers = VideoWriters(folder, recording.rate)
    try:
        for k in recording.frames():
            for name, view in recording.fixed.items():
                image = decode_image(recording.image(k, name), (view.camera.height, view.camera.width), cv2.IMREAD_COLOR)
                writers.put(name, np.asarray(image[:, :, ::-1], dtype=np.uint8))
        writers.finish()
    finally:
        writers.close()


def truth_of(recording: RecordedSequence) -> dict[int, list[AiCityObject]]:
    """Frame → the people, as boxes of one size with the yaw of their motion."""
    out: dict[int, list[AiCityObject]] = {}
    for frame, (ids, boxes) in boxes_of_tracks({t.index: (t.person_id, t.feet) for t in recording.truth}).items():
        seen = {name: _seen(recording, frame, name) for name in recording.fixed}
        out[frame] = [
            AiCityObject(
                PERSON, person, box[:3], box[3:6], np.array([0.0, 0.0, box[6]]), {c: found[person] for c, found in seen.items() if person in found}
            )
            for person, box in zip(ids.tolist(), boxes, strict=True)
        ]
    return out


def _seen(recording: RecordedSequence, frame: int, camera: str) -> dict[int, Array]:
    """Person → (4,) first x, first y, last x, last y px of the visible part."""
    boxes = recording.views[frame, camera].boxes
    edges = np.column_stack([np.floor(boxes.seen[:, :2]), np.ceil(boxes.seen[:, 2:]) - 1])
    return {p: edge for p, edge, visible in zip(boxes.person.tolist(), edges, boxes.visible.tolist(), strict=True) if visible > 0}


def scene_of(results: Results) -> int:
    """The last number in the name of the folder that was tracked, as in Warehouse_017; 0 without any."""
    numbers = re.findall(r"\d{1,9}", str(results.run.get("source", "")))
    return int(numbers[-1]) if numbers else 0


def rows_of_results(results: Results, scene: int) -> AiCityRows:
    """The tracks of a run as rows of a result file. Ids are shifted where the least is below 1."""
    boxes = boxes_of_tracks(results.tracks, online=True)
    ids = np.concatenate([np.zeros(0, dtype=np.int64), *(ids for ids, _ in boxes.values())])
    frame = np.repeat(np.array(list(boxes), dtype=np.int64), [len(ids) for ids, _ in boxes.values()])
    table = np.concatenate([np.zeros((0, 7)), *(rows for _, rows in boxes.values())])
    shift = max(0, 1 - int(ids.min(initial=1)))
    return AiCityRows(np.full(len(ids), scene), np.zeros(len(ids), dtype=np.int64), ids + shift, frame, table[:, :3], table[:, 3:6], table[:, 6])


def is_results(folder: Path) -> bool:
    """Whether `track` wrote the folder."""
    return (folder / RUN).is_file()


def export_results(folder: Path, out: Path, scene: int | None = None) -> int:
    """Write the results in `folder` as RESULT_FILE of a submission, with a README.md, into `out` atomically. Returns the scene.

    scene: scene_id; None for the last number in the name of the source.
    Raises ValueError as read_results, as export_folder, and for a negative scene.
    """
    results = read_results(folder)
    number = scene_of(results) if scene is None else scene
    if number < 0:
        raise ValueError(f"scene is {number}, needs at least 0")
    with export_folder(folder, out) as unfinished:
        write_results(unfinished / RESULT_FILE, rows_of_results(results, number))
        head = f"# Results for track 1 of the AI City Challenge, exported by pilsim\n\nFrom: {folder.resolve().name}.\n"
        write_text(unfinished / "README.md", head + README_RESULTS.format(scene=number))
    return number
