"""Export to PETS 2009: the fixed cameras as views, truth in the image of the first. `tracker/datasets/pets2009.py` reads it back."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tracker.export.recorded_sequence import FixedView, RecordedSequence, sized
from tracker.formats.motchallenge import ABSENT, Rows, write_mot15
from tracker.formats.pets2009 import TERRAIN, Annotations, Site, ground_truth, write_annotations, write_camera, write_site
from tracker.geometry import Array, Ints
from tracker.geometry.ground import Grid

AGREES = 0.05
"""m: a person whose feet the annotation gives back within this is in the cropped truth."""
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


def export_pets(out: Path, footages: Iterable[RecordedSequence]) -> list[str]:
    """Write the sequences; the notes say which camera became which view. Raises ValueError where one has no fixed pinhole camera."""
    notes = []
    for footage in footages:
        names = view_names(list(footage.needs_fixed("pets")))
        root = out / footage.name
        for folder in ("annotations", "detections", "calibration", *names.values()):
            (root / folder).mkdir(parents=True)
        for camera, view in footage.fixed.items():
            write_camera(root / "calibration" / f"{names[camera]}.xml", names[camera], view.camera, view.T_world_camera)
            _write_detections(root / "detections" / f"{names[camera]}.txt", footage, camera)
        first = next(camera for camera, name in names.items() if name == "View_001")
        whole = annotations_of(footage, first)
        write_annotations(root / "annotations" / f"{footage.name}.xml", footage.name, whole)
        write_annotations(root / "annotations" / f"{footage.name}-cropped.xml", footage.name, _cropped(footage, first, whole))
        _write_site(root, footage)
        for k in footage.frames():
            for camera, name in names.items():
                (root / name / f"frame_{k:04d}.jpg").write_bytes(footage.image(k, camera))
        renamed = [f"{name} is {camera}" for camera, name in names.items() if name != camera]
        notes += [f"{footage.name}: {', '.join(renamed)}."] if renamed else []
    return notes


def view_names(cameras: list[str]) -> dict[str, str]:
    """Camera → View_00N: its own name where all are of PETS 2009 and the first of them is there, else numbers from 1 in their order."""
    if "View_001" in cameras and all(_PETS.fullmatch(camera) for camera in cameras):
        return {camera: camera for camera in cameras}
    return {camera: f"View_{number:03d}" for number, camera in enumerate(cameras, 1)}


def annotations_of(footage: RecordedSequence, camera: str) -> Annotations:
    """Frame → ids (m,) and boxes (m, 4) left, top, width, height px, of which the middle of the lower edge is where the person stands."""
    view = footage.fixed[camera]
    shift = 0.5 - view.camera.pixel_centre
    out: Annotations = {}
    for truth in footage.truth:
        shown = footage.views[truth.index, camera].boxes
        body = sized(shown.full) - np.array([shift, shift, 0, 0])
        feet, _ = view.camera.pixels_from_bearings(view.T_world_camera.inverse().apply(_feet(truth.person_id, truth.feet, shown.person)))
        box = np.column_stack([feet[:, 0] - body[:, 2] / 2, body[:, 1], body[:, 2], feet[:, 1] - body[:, 1]])
        fits = np.isfinite(box).all(axis=1) & (box[:, 3] > 0)
        out[truth.index] = shown.person, np.where(fits[:, None], box, body)
    return out


def _feet(present: Ints, feet: Array, wanted: Ints) -> Array:
    order = np.argsort(present)
    return feet[order[np.searchsorted(present[order], wanted)]].reshape(-1, 3)


def _cropped(footage: RecordedSequence, camera: str, whole: Annotations) -> Annotations:
    """Those whose feet the reader of the annotation will find where they are."""
    view = footage.fixed[camera]
    out: Annotations = {}
    for truth in footage.truth:
        ids, boxes = whole[truth.index]
        feet = _feet(truth.person_id, truth.feet, ids)
        kept = np.array([_agrees(footage, view, box, place) for box, place in zip(boxes, feet, strict=True)], dtype=bool)
        out[truth.index] = ids[kept], boxes[kept]
    return out


def _agrees(footage: RecordedSequence, view: FixedView, box: Array, feet: Array) -> bool:
    one = {0: (np.zeros(1, dtype=np.int64), box[None])}
    try:
        cast = ground_truth(one, view.camera, view.T_world_camera, footage.setup.ground)[0][1][0]
    except ValueError:
        return False
    return float(np.linalg.norm(cast - feet)) <= AGREES


def _write_detections(path: Path, footage: RecordedSequence, camera: str) -> None:
    found = [footage.detected(k, camera) for k in range(len(footage.truth))]
    boxes = np.concatenate([box for box, _ in found]) - np.array([1, 1, 0, 0]) * (0.5 - footage.cameras[camera].pixel_centre)
    frame = np.concatenate([np.full(len(sure), k + 1) for k, (_, sure) in enumerate(found)])
    rows = Rows(frame, np.full(len(frame), -1), boxes, np.concatenate([sure for _, sure in found]), np.full((len(frame), 3), ABSENT))
    write_mot15(path, rows)


def _write_site(root: Path, footage: RecordedSequence) -> None:
    """The area is all of the terrain."""
    ground = footage.setup.ground
    assert isinstance(ground, Grid)
    size = ground.spacing * (np.array(ground.heights.shape[::-1]) - 1)
    write_site(root, Site(footage.rate, np.stack([ground.origin, ground.origin + size]), ground), footage.folder / TERRAIN)
