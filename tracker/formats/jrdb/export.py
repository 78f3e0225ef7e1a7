"""Export to JRDB: the panoramas of the robots with 2-D and 3-D boxes of people, and detections."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.formats.jrdb.files import (
    DETECTIONS,
    LABELS_2D,
    LABELS_3D,
    Label2d,
    Label3d,
    PanoramaNote,
    write_detections_2d,
    write_labels_2d,
    write_labels_3d,
)
from tracker.geometry import Array
from tracker.geometry.cameras import Cylinder
from tracker.sequence.truth_tables import read_joints
from tracker.types import KEYPOINT_NAMES

NOSE_HEIGHT = 0.921
"""Height of the nose over stature of a standing person (Drillis & Contini 1966, and the heads of pilsim's people)."""
BODY_MARGIN = 0.1
"""m: horizontal distance of the body surface from the outermost joints."""
_NOSE, _LEFT, _RIGHT = (KEYPOINT_NAMES.index(name) for name in ("nose", "left_shoulder", "right_shoulder"))

README = """
    images/image_stitched/SEQUENCE-CAMERA/000000.jpg  panoramas, RGB, frames from 0
    labels/labels_2d_stitched/SEQUENCE-CAMERA.json    boxes in the panorama
    labels/labels_3d/SEQUENCE-CAMERA.json             boxes in space
    detections/detections_2d_stitched/SEQUENCE-CAMERA.json  boxes that the simulated detector reported

A panorama of width W and height H = W/2 is all of the sphere: azimuth = π − 2πu/W, elevation = π/2 − πv/H, ahead is the middle, the seam is behind.
There are no point clouds; labels_3d has keys 000000.pcd nevertheless, because tools look for them.

labels_2d_stitched: frame → list of labels. label_id: `pedestrian:` and pilsim's id, the same in all views and at all times. box: left, top, width,
height [px] of the whole body, as if nothing were before it, counted from the image's corner (0-based); left is in [0, W), left + width may pass W
where a body lies over the seam: `wraps` is true there, and modulo W is where the box goes on. box_seen: the same of what is seen, zeros where
nothing is. visibility in [0, 1]: pixels seen / pixels that the body would cover alone. attributes: occlusion (Fully_visible from visibility 0.95,
Mostly_visible from 0.5, Severely_occluded above 0, else Fully_occluded), area [px²] of box, no_eval: nothing is seen, truncated, interpolated: false.

Beside the labels the file has a field `pilsim` (ours): rate [1/s], width and height [px] of the panoramas, above_ground [m], the median height of the
camera above the ground, and for cylinders horizon and focal [px].

detections_2d_stitched: frame → list. label_id: `person:` and a running number; box as above, score in [0, 1].

labels_3d: frame → list. box: cx, cy, cz [m] its centre, l [m] along the heading, w [m] across, h [m] up, rot_z [rad] the heading about z,
anticlockwise from x, in the camera's frame: x forward (the panorama's middle), y left, z up as the robot has it (which on a slope is not upright).
The box is put around the key points and the feet (to a few centimetres). attributes: distance [m] of the centre, num_points: −1 (unknown).
observation_angle [rad]: rot_z less the azimuth of the centre.

`pilsim track` reads a sequence in the camera's frame of each tick: the layout has no odometry, so a robot that moves makes people seem to move.
"""


def export_jrdb(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write panoramas and labels. Raises ValueError where a sequence has no panorama."""
    for folder in (LABELS_2D, LABELS_3D, DETECTIONS):
        (out / folder).mkdir(parents=True)
    for recording in recordings:
        panoramas = {name: camera for name, camera in recording.cameras.items() if camera.wraps}
        if not panoramas:
            raise ValueError(f"{recording.folder}: has no panorama, which jrdb needs; export fixed views as mot17, coco or wildtrack")
        for name in panoramas:
            (out / "images" / "image_stitched" / f"{recording.name}-{name}").mkdir(parents=True)
        for k in recording.frames():
            for name in panoramas:
                (out / "images" / "image_stitched" / f"{recording.name}-{name}" / f"{k:06d}.jpg").write_bytes(recording.image(k, name))
        for name, camera in panoramas.items():
            file = f"{recording.name}-{name}.json"
            write_labels_2d(out / LABELS_2D / file, _labels_2d(recording, name), camera.width, _note(recording, name))
            write_labels_3d(out / LABELS_3D / file, _labels_3d(recording, name))
            found = {k: recording.detection_boxes(k, name) for k in range(len(recording.truth))}
            write_detections_2d(out / DETECTIONS / file, found)
    return []


def _note(recording: RecordedSequence, name: str) -> PanoramaNote:
    camera = recording.cameras[name]
    places = np.array([recording.views[k, name].T_world_camera.translation for k in range(len(recording.truth))]).reshape(-1, 3)
    above = float(np.median(places[:, 2] - recording.setup.ground.height_at(places))) if len(places) else 1.0
    horizon, focal = (camera.horizon, camera.focal) if isinstance(camera, Cylinder) else (None, None)
    return PanoramaNote(recording.rate, camera.width, camera.height, above, horizon, focal)


def _labels_2d(recording: RecordedSequence, camera: str) -> dict[int, list[Label2d]]:
    out = {}
    for k in range(len(recording.truth)):
        boxes = recording.views[k, camera].boxes
        full, seen = ltwh_from_edges(boxes.full), ltwh_from_edges(boxes.seen)
        out[k] = [Label2d(p, full[i], seen[i], float(boxes.visible[i])) for i, p in enumerate(boxes.person.tolist())]
    return out


def _labels_3d(recording: RecordedSequence, camera: str) -> dict[int, list[Label3d]]:
    joints = read_joints(recording.folder)
    out = {}
    for truth in recording.truth:
        view = recording.views[truth.index, camera]
        T = view.T_world_camera.inverse()
        present = {p: k for k, p in enumerate(truth.person_id.tolist())}
        ids, bodies = joints.get(truth.index, (truth.person_id, np.zeros((0, len(KEYPOINT_NAMES), 3))))
        body = {p: bodies[k] for k, p in enumerate(ids.tolist())}
        wanted = view.boxes.person.tolist()
        out[truth.index] = [label_3d(p, T.apply(body[p]), T.apply(truth.feet[[present[p]]])[0]) for p in wanted]
    return out


def label_3d(person: int, joints: Array, feet: Array) -> Label3d:
    """The 3-D box of a person with joints (17, 3) m and feet (3,) m, both in the camera's frame."""
    across = joints[_LEFT] - joints[_RIGHT]
    heading = float(np.arctan2(-across[0], across[1]))
    c, s = np.cos(heading), np.sin(heading)
    along = np.array([[c, s], [-s, c]])
    flat = joints[:, :2] @ along.T
    low, high = flat.min(axis=0) - BODY_MARGIN, flat.max(axis=0) + BODY_MARGIN
    top = feet[2] + (joints[_NOSE, 2] - feet[2]) / NOSE_HEIGHT
    centre = np.array([*((low + high) / 2 @ along), (feet[2] + top) / 2])
    return Label3d(person, centre, np.array([*(high - low), top - feet[2]]), heading)
