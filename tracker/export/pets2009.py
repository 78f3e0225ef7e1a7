"""Export to PETS 2009: fixed cameras as views, annotations in the image of View_001. `tracker/datasets/pets2009.py` reads it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tracker.export.recorded_sequence import FixedView, RecordedSequence, ltwh_from_edges
from tracker.formats.motchallenge import write_mot15
from tracker.formats.pets2009 import TERRAIN, Annotations, Site, ground_truth, write_annotations, write_camera, write_site
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Grid
from tracker.geometry.tsai import tsai_of

MAX_FEET_ERROR = 0.05
"""m: the cropped annotation holds people whose feet, projected to the ground, are this close to the truth."""
_PETS = re.compile(r"View_\d{3}")

README = """
    SEQUENCE/View_001/frame_0000.jpg           images, RGB, frames from 0
    SEQUENCE/annotations/SEQUENCE.xml          truth in the image of View_001 (CVML)
    SEQUENCE/annotations/SEQUENCE-cropped.xml  the same, of those whose feet can be cast to the ground from there (see below)
    SEQUENCE/detections/View_001.txt           detections (MOTChallenge 2015)
    SEQUENCE/calibration/View_001.xml          Tsai's model of the camera
    SEQUENCE/site.json, terrain.npz            frame rate [1/s], area [m] and ground, where they are not those of PETS 2009

`pilsim track SEQUENCE` and `pilsim score` take such a folder.

Pixels: u to the right, v down; the first pixel's *centre* is (0, 0), as the calibrations of PETS 2009 have it, so the image's edges lie at −0.5.
Truth: frame number from 0; object id: pilsim's, kept when a person comes back; box h, w, xc, yc [px]: height, width and centre. Everybody who
covers a pixel of the view, occluded or not, is there. The middle of a box's lower edge is the ground under the middle of the body, its upper edge and
its width are those of the whole body in the image (where the feet would lie above that edge, the box is the body's).
Cropped: without those whose feet, cast to the ground from the camera, come to lie elsewhere by more than 0.05 m: behind a crest, or too far away.
Detections: frame (from 1!), −1, left, top, width, height [px], confidence in [0, 1], −1, −1, −1. What pilsim's simulated detector reported.
Calibration: focal [mm], kappa1 [1/mm²], cx, cy [px], dpx, dpy [mm/px], translation [mm], angles [rad]; R = Rz Ry Rx, camera = R world + t,
undistorted = distorted (1 + kappa1 r²). The world is pilsim's: right-handed, z up, its own origin; people stand on its terrain, which need not be
z = 0.
terrain.npz: heights [m] (rows, columns), row 0 at the lowest y, origin x, y [m] of heights[0, 0], spacing [m]; tops: with walls and furniture on it.
"""


def export_pets(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write the sequences. The notes map views to cameras. Raises ValueError where a sequence has no fixed pinhole camera."""
    notes = []
    for recording in recordings:
        names = view_names(list(recording.require_fixed("pets")))
        root = out / recording.name
        for folder in ("annotations", "detections", "calibration", *names.values()):
            (root / folder).mkdir(parents=True)
        for camera, view in recording.fixed.items():
            write_camera(root / "calibration" / f"{names[camera]}.xml", names[camera], _calibration(recording, camera), view.T_world_camera)
            rows = recording.detection_rows(camera, recording.cameras[camera].pixel_centre - 0.5)
            write_mot15(root / "detections" / f"{names[camera]}.txt", rows)
        first = next(camera for camera, name in names.items() if name == "View_001")
        annotations = annotations_of(recording, first)
        write_annotations(root / "annotations" / f"{recording.name}.xml", recording.name, annotations)
        write_annotations(root / "annotations" / f"{recording.name}-cropped.xml", recording.name, _cropped(recording, first, annotations))
        _write_site(root, recording)
        for k in recording.frames():
            for camera, name in names.items():
                (root / name / f"frame_{k:04d}.jpg").write_bytes(recording.image(k, camera))
        renamed = [f"{name} is {camera}" for camera, name in names.items() if name != camera]
        notes += [f"{recording.name}: {', '.join(renamed)}."] if renamed else []
    return notes


def _calibration(recording: RecordedSequence, camera: str) -> Tsai:
    try:
        return tsai_of(recording.fixed[camera].camera)
    except ValueError as error:
        raise ValueError(f"{recording.folder}: {camera}: {error}, which pets can hold") from None


def view_names(cameras: list[str]) -> dict[str, str]:
    """Camera → View_00N. Names of PETS 2009 are kept where View_001 is among them; otherwise views are numbered in order."""
    if "View_001" in cameras and all(_PETS.fullmatch(camera) for camera in cameras):
        return {camera: camera for camera in cameras}
    return {camera: f"View_{number:03d}" for number, camera in enumerate(cameras, 1)}


def annotations_of(recording: RecordedSequence, camera: str) -> Annotations:
    """Frame → ids (m,) and boxes (m, 4) left, top, width, height px. The middle of the lower edge is the ground under the person."""
    view = recording.fixed[camera]
    shift = 0.5 - view.camera.pixel_centre
    out: Annotations = {}
    for truth in recording.truth:
        shown = recording.views[truth.index, camera].boxes
        body = ltwh_from_edges(shown.full) - np.array([shift, shift, 0, 0])
        feet, _ = view.camera.pixels_from_bearings(view.T_world_camera.inverse().apply(_feet(truth.person_id, truth.feet, shown.person)))
        box = np.column_stack([feet[:, 0] - body[:, 2] / 2, body[:, 1], body[:, 2], feet[:, 1] - body[:, 1]])
        fits = np.isfinite(box).all(axis=1) & (box[:, 3] > 0)
        out[truth.index] = shown.person, np.where(fits[:, None], box, body)
    return out


def _feet(present: Ints, feet: Array, wanted: Ints) -> Array:
    order = np.argsort(present)
    return feet[order[np.searchsorted(present[order], wanted)]].reshape(-1, 3)


def _cropped(recording: RecordedSequence, camera: str, annotations: Annotations) -> Annotations:
    """The annotations whose boxes project to the true feet."""
    view = recording.fixed[camera]
    out: Annotations = {}
    for truth in recording.truth:
        ids, boxes = annotations[truth.index]
        feet = _feet(truth.person_id, truth.feet, ids)
        kept = np.array([_projects_to_feet(recording, view, box, position) for box, position in zip(boxes, feet, strict=True)], dtype=bool)
        out[truth.index] = ids[kept], boxes[kept]
    return out


def _projects_to_feet(recording: RecordedSequence, view: FixedView, box: Array, feet: Array) -> bool:
    one = {0: (np.zeros(1, dtype=np.int64), box[None])}
    try:
        cast = ground_truth(one, view.camera, view.T_world_camera, recording.setup.ground)[0][1][0]
    except ValueError:
        return False
    return float(np.linalg.norm(cast - feet)) <= MAX_FEET_ERROR


def _write_site(root: Path, recording: RecordedSequence) -> None:
    """Write site.json, with the annotations terrain as area."""
    ground = recording.setup.ground
    assert isinstance(ground, Grid)
    size = ground.spacing * (np.array(ground.heights.shape[::-1]) - 1)
    write_site(root, Site(recording.rate, np.stack([ground.origin, ground.origin + size]), ground), recording.folder / TERRAIN)
