"""PETS 2009: annotations (XML, CVML) and the site (site.json); a folder of them as a recording; the export of a sequence.

Annotations are those of PETS 2009 and CAVIAR: boxes by their centres in the image of one camera, frames from 0. Detections are MOT15 files,
with frames from 1. tracker/io/tsai_xml.py reads the calibrations. Their pixels are used: pixel centres lie at whole numbers.

site.json lies beside the annotations. It holds what PETS 2009 does not record: frame rate, tracking area, ground and occluding pillars. Its fields:
rate [1/s]. area [[x, y], [x, y]] m: the lowest and the highest corner. terrain: the name of a file of heights, or null for the plane z = 0.
The field pillars may be missing: [[x, y, radius, low, high], ...] m, upright cylinders that occlude people.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera, Tsai
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.geometry.tsai import tsai_of
from tracker.io.atomic import write_text
from tracker.io.csv_tables import read_terrain
from tracker.io.json_files import JsonObject, read_json, write_json
from tracker.io.mot15 import LARGEST_PIXEL, MAX_FRAME, number, write_mot15
from tracker.io.picture_folders import say_left_out, visible_files
from tracker.io.resume import checksum
from tracker.io.time_order import say_repeated
from tracker.io.tsai_xml import read_camera, write_camera
from tracker.io.xml_files import Element, parse
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.folder import pillars_from, read_boxes
from tracker.recordings.images import image_sources
from tracker.recordings.recording import MAX_FRAMES
from tracker.sequence.calibration import MAX_RATE, MIN_RATE

MAX_RANGE = 500.0
"""m: longest ray that is intersected with the ground."""


def ground_truth(annotations: Annotations, camera: Camera, T_world_camera: Pose, ground: Ground) -> dict[int, tuple[Ints, Array]]:
    """Ground positions of the annotated people: frame → ids (m,) and feet (m, 3) m.

    The feet are the middle of the lower edge of the box, projected to the ground.
    Raises ValueError with frame and id where that ray does not meet the ground.
    """
    out: dict[int, tuple[Ints, Array]] = {}
    for frame, (ids, boxes) in annotations.items():
        pixels = np.stack([boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3]], axis=1)
        directions = camera.bearings_from_pixels(pixels) @ T_world_camera.rotation.T
        origins = np.broadcast_to(T_world_camera.translation, directions.shape)
        feet, hit = ground.intersect(origins, directions, MAX_RANGE)
        if not hit.all():
            raise ValueError(f"frame {frame}: the feet of id {ids[np.argmin(hit)]} are not on the ground, need to be below the horizon")
        out[frame] = ids, feet
    return out


Annotations = dict[int, tuple[Ints, Array]]


def read_annotations(path: str | os.PathLike[str]) -> Annotations:
    """Read a CVML file: frame (from 0) → ids (m,) and boxes (m, 4) left, top, width, height px. Frames without people have empty entries.

    The centre of a box is xc, yc, or x, y in the older CAVIAR files.
    A frame or object that is repeated with the same content counts once; the number of repetitions is logged.
    Raises ValueError with file, line and field for repetitions that differ, for an invalid number, and for a size not above 0.
    """
    out: Annotations = {}
    repeated = 0
    for frame in parse(path, "dataset").find_all("frame"):
        number = frame.integer("number")
        if not 0 <= number <= MAX_FRAME:
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} is {'below 0' if number < 0 else f'above {MAX_FRAME}'}")
        boxes: dict[int, list[float]] = {}
        for item in (o for group in frame.find_all("objectlist") for o in group.find_all("object")):
            person, box = item.integer("id"), _box(item.find("box"))
            repeated += person in boxes
            if boxes.setdefault(person, box) != box:
                raise ValueError(f"{path}:line {item.line}: field object.id {person} occurs twice in frame {number}, with two boxes")
        one = np.array(list(boxes), dtype=np.int64), np.array(list(boxes.values())).reshape(-1, 4)
        repeated += number in out
        if not all(map(np.array_equal, out.setdefault(number, one), one)):
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} occurs twice, with other boxes")
    say_repeated(path, repeated, "element")
    return dict(sorted(out.items()))


def _box(box: Element) -> list[float]:
    w, h = box.number("w"), box.number("h")
    for name, size in (("w", w), ("h", h)):
        if not size > 0:
            raise ValueError(f"{box.where}:line {box.line}: field box.{name} is {size}, needs more than 0")
    x, y = box.number("xc", "x"), box.number("yc", "y")
    if max(abs(x), abs(y), w, h) > LARGEST_PIXEL:
        raise ValueError(f"{box.where}:line {box.line}: field box is {x:g}, {y:g}, {w:g}, {h:g}, needs pixels up to {LARGEST_PIXEL:g}")
    return [x - w / 2, y - h / 2, w, h]


def write_annotations(path: Path, name: str, annotations: Annotations) -> None:
    """Write a CVML file; read_annotations reads it. Raises ValueError with frame and id for a size that is not above 0."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<dataset name={quoteattr(name)}>"]
    for frame, (ids, boxes) in sorted(annotations.items()):
        lines += [f'  <frame number="{frame}">', "    <objectlist>"]
        for person, (left, top, w, h) in zip(ids.tolist(), np.asarray(boxes).tolist(), strict=True):
            if not (w > 0 and h > 0):
                raise ValueError(f"frame {frame}: the box of id {person} is {w} x {h} px, needs more than 0")
            size, centre = f'h="{number(h)}" w="{number(w)}"', f'xc="{number(left + w / 2)}" yc="{number(top + h / 2)}"'
            lines.append(f'      <object id="{person}"><box {size} {centre}/></object>')
        lines += ["    </objectlist>", "  </frame>"]
    write_text(path, "\n".join([*lines, "</dataset>", ""]))


FILE, TERRAIN = "site.json", "terrain.npz"

PETS_AREA = ((-14.0696, -14.2740), (4.9813, 1.7335))
"""m: tracking area of the cropped annotations of PETS 2009 (Milan's ground truth)."""

PILLARS = ((-13.708, -10.623, 0.07, 0.0, 2.4), (-13.708, -10.623, 0.24, 2.4, 3.03))
"""m: the lamp post of PETS 2009 and its sign, which occlude people in View_001; measured in the first frame of View_001."""

PETS_RATE = 7.0
"""Frames per second of PETS 2009."""


@dataclass(frozen=True, eq=False)
class Site:
    """rate in frames/s; area (2, 2) m, ground, occluders and pillars (p, 5) m as in Setup."""

    rate: float
    area: Array
    ground: Ground
    occluders: Ground | None = None
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))


def read_site(folder: Path) -> Site:
    """Read site.json of a folder; without the file, the site of PETS 2009. Raises ValueError with the path for an invalid file."""
    path = folder / FILE
    if not path.is_file():
        return Site(PETS_RATE, np.array(PETS_AREA), Flat(), pillars=np.array(PILLARS))
    content = JsonObject(read_json(path), str(path))
    rate, area = content.number("rate", MIN_RATE, MAX_RATE), content.array("area", (2, 2))
    if not (area[0] < area[1]).all():
        raise content.refused("area", "two corners x, y m, the lowest first")
    pillars = pillars_from(content)
    if "terrain" in content.values and content.values["terrain"] is None:
        return Site(rate, area, Flat(), pillars=pillars)
    return Site(rate, area, *read_terrain(folder / content.text("terrain", re.escape(TERRAIN), f"{TERRAIN!r} or null")), pillars=pillars)


def write_site(folder: Path, site: Site, terrain: Path | None) -> None:
    """Write site.json; read_site reads it. terrain: path of a terrain.npz with the ground, or None for z = 0."""
    if terrain is not None:
        (folder / TERRAIN).write_bytes(terrain.read_bytes())
    content = {"rate": site.rate, "area": site.area.tolist(), "terrain": TERRAIN if terrain is not None else None, "pillars": site.pillars.tolist()}
    write_json(folder / FILE, content, indent=1)


PETS_VIEWS = (1, 5, 7)
"""Numbers of the views of S2.L1 that the literature uses."""


def is_pets(path: Path) -> bool:
    """Whether a folder has the layout of PETS 2009: detections or annotations, and calibration/View_*.xml in it or beside it."""
    folder = calibration_of(path)
    named = folder is not None and any(folder.glob("View_*.xml"))
    return named and ((path / "annotations").is_dir() or (path / "detections").is_dir())


def calibration_of(path: Path) -> Path | None:
    """The folder calibration/ in a PETS 2009 folder or beside it, or None."""
    return next((p for p in (path / "calibration", path.parent / "calibration") if p.is_dir()), None)


def annotation_file(path: Path) -> Path | None:
    """The annotations in a PETS 2009 folder, or None. A complete file, with people outside the evaluated area, is preferred."""
    files = sorted((path / "annotations").glob("*.xml"))
    return next((file for file in files if "cropped" not in file.name), next(iter(files), None))


def read_pets(path: Path, options: SourceOptions) -> Recording:
    """Read a PETS 2009 folder; calibration/ lies in it or beside it. Only cameras, detections and pixels of `options` are used here.

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
    return Recording(
        site.rate,
        cameras,
        detections,
        truth,
        area=site.area,
        ground=site.ground,
        occluders=site.occluders,
        pillars=site.pillars,
        images={name: source for name, source in image_sources(path, _calibrated(calibration)).items() if name in cameras},
        source={"source": "PETS 2009", "views": list(cameras), "files": sums},
    )


def _calibrated(calibration: Path) -> list[str]:
    return [file.stem for file in sorted(calibration.glob("View_*.xml"))]


def _detection_files(path: Path, calibration: Path, options: SourceOptions) -> dict[str, Path | None]:
    """Camera → file of its detections, None where `options` replaces it. Raises ValueError where the file of a chosen view is missing."""
    found: dict[str, Path | None] = {}
    for file in visible_files(path / "detections", (".txt",)) if (path / "detections").is_dir() else ():
        if match := re.fullmatch(r"View_0*(\d+)\.txt", file.name):
            found[f"View_{int(match[1]):03d}"] = file
        else:
            say_left_out(path / "detections", [file], "needs the name of a camera, as View_001.txt")
    calibrated = _calibrated(calibration)
    if options.pixels:
        found |= {name: None for name in image_sources(path, calibrated) if name not in found}
    wanted = [camera_named(text, calibrated) for text in options.cameras]
    for text in filter(None, options.detections):
        name = camera_named(text, calibrated)
        if wanted and name not in wanted:
            raise ValueError(f"--detections names {name}, --cameras has {','.join(options.cameras)}")
        found[name] = None
    if folder := options.detections.get(""):
        found |= {name: None for name in calibrated if name not in found and (folder / f"{name}.txt").is_file()}
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
            write_camera(root / "calibration" / f"{names[camera]}.xml", names[camera], _calibration(recording, camera), view.pose)
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
        feet, _ = view.camera.pixels_from_bearings(view.pose.inverse().apply(_feet(truth.person_id, truth.feet, shown.person)))
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


def _projects_to_feet(recording: RecordedSequence, view: RecordingCamera, box: Array, feet: Array) -> bool:
    one = {0: (np.zeros(1, dtype=np.int64), box[None])}
    try:
        cast = ground_truth(one, view.camera, view.pose, recording.setup.ground)[0][1][0]
    except ValueError:
        return False
    return float(np.linalg.norm(cast - feet)) <= MAX_FEET_ERROR


def _write_site(root: Path, recording: RecordedSequence) -> None:
    """Write site.json; its area is the extent of the terrain."""
    ground = recording.setup.ground
    assert isinstance(ground, Grid)
    size = ground.spacing * (np.array(ground.heights.shape[::-1]) - 1)
    write_site(root, Site(recording.rate, np.stack([ground.origin, ground.origin + size]), ground), recording.folder / TERRAIN)
