"""True and found boxes of a source, image by image: the input of tracker/metrics/box_detection.py.

Truth is a sequence of pilsim, a recording such as PETS 2009, WILDTRACK or JRDB, or a MOT15 file. `pilsim detect` or MOT15 files give found boxes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tracker.detector_models.bodies import bodies_in_view
from tracker.detector_models.observations import judged, true_people
from tracker.formats.opening import format_of, open_recording
from tracker.formats.registry import PILSIM, UTIAS
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.geometry import Array, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Ground
from tracker.geometry.image_boxes import clipped, edges_of
from tracker.io.json_files import read_json
from tracker.io.mot15 import Mot15Rows, read_mot15
from tracker.metrics.box_detection import ImageBoxes
from tracker.recordings import FrameBoxes, Recording
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import RUN
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes, Sequence

REACH = 200.0
"""m: feet farther from the camera have no place on the ground."""
NONE = np.zeros((0, 4)), np.zeros(0)


@dataclass(frozen=True, eq=False)
class FoundFiles:
    """Boxes of a detector: camera → frame from 0 → boxes (n, 4) left, top, width, height px and scores (n,).

    frames: those searched, None for all. visible: whether boxes are of visible parts, in place of whole bodies.
    """

    boxes: Mapping[str, FrameBoxes]
    frames: tuple[int, int | None] | None
    visible: bool = False


def images_of(truth: Path, result: Path, options: SourceOptions) -> list[ImageBoxes]:
    """The images of one source. options: its cameras and frames; without frames, those that `pilsim detect` searched, else all.

    Raises ValueError with the path where the truth has no people or boxes, where no result belongs to its cameras, and as the readers.
    """
    if truth.is_file():
        out = list(_images_of_file(truth, result, options))
    else:
        form = format_of(truth).name
        if form == UTIAS:
            raise ValueError(f"{truth}: has robots and no cameras, needs a source with true people")
        source = _images_of_sequence if form == PILSIM else _images_of_recording
        out = list(source(truth, result, options))
    if not out:
        raise ValueError(f"{truth}: no image of the wanted cameras and frames, needs at least one")
    return out


def found_boxes(result: Path, cameras: list[str], options: SourceOptions) -> FoundFiles:
    """The boxes found in some of `cameras`. result: a folder of CAMERA.txt, or a file that is named after a camera or belongs to the only one."""
    wanted = [camera_named(text, cameras) for text in options.cameras] or cameras
    if result.is_dir():
        files = {name: file for name in wanted if (file := result / f"{name}.txt").is_file()}
        if not files:
            raise ValueError(f"{result}: no CAMERA.txt of {', '.join(wanted)}")
        missing = [name for name in wanted if name not in files] if options.cameras else []
        if missing:
            raise ValueError(f"{result / missing[0]}.txt: no such file")
        searched, visible = _statement(result / RUN)
        first = searched[0] if searched else 0
        return FoundFiles({name: _by_frame(file, read_mot15(file), first) for name, file in files.items()}, searched, visible)
    if not result.is_file():
        raise ValueError(f"{result}: no such file or folder")
    named = [result.stem] if result.stem in wanted else wanted
    if len(named) != 1:
        raise ValueError(f"{result}: may be of {', '.join(named)}, needs --cameras NAME")
    return FoundFiles({named[0]: _by_frame(result, read_mot15(result), 0)}, None)


def _statement(statement: Path) -> tuple[tuple[int, int | None] | None, bool]:
    """The frames that `pilsim detect` searched, and whether its boxes are of visible parts. Its files count from the first of these frames."""
    content = read_json(statement) if statement.is_file() else {}
    text = content.get("frames", "") if isinstance(content, dict) else ""
    try:
        frames = SourceOptions.parse(frames=text).frames if isinstance(text, str) else None
        return frames, isinstance(content, dict) and content.get("boxes") == "visible"
    except ValueError as error:
        raise ValueError(f"{statement}: {error}") from None


def _by_frame(file: Path, rows: Mot15Rows, first: int) -> FrameBoxes:
    if not rows.has_box.all():
        raise ValueError(f"{file}: has rows without a box, needs boxes of a detector")
    return {frame - 1 + first: (rows.box[own], rows.confidence[own]) for frame, own in rows.by_frame().items()}


def _frames(count: int, wanted: tuple[int, int | None] | None, path: Path) -> range:
    first, end = wanted or (0, None)
    if first >= count:
        raise ValueError(f"--frames begins at {first}, needs a first frame below {count}, all that {path} has")
    return range(first, count if end is None else min(end, count))


def _images_of_file(truth: Path, result: Path, options: SourceOptions) -> Iterator[ImageBoxes]:
    if options.cameras:
        raise ValueError(f"{truth}: --cameras is for folders; a file is of one camera")
    rows = read_mot15(truth)
    if not len(rows) or not rows.has_box.all():
        raise ValueError(f"{truth}: needs rows that all have a box")
    found = FoundFiles({"": _by_frame(result, read_mot15(result), 0)}, None) if result.is_file() else found_boxes(result, [truth.stem], options)
    (boxes,) = found.boxes.values()
    by_frame, nowhere = rows.by_frame(), np.zeros(0, dtype=np.int64)
    for frame in _frames(max(by_frame), options.frames or found.frames, truth):
        own, (box, score) = by_frame.get(frame + 1, nowhere), boxes.get(frame, NONE)
        image = ImageBoxes.of(edges_of(rows.box[own]), edges_of(box), score)
        yield replace(image, counts=np.asarray(rows.confidence[own] != 0), world=truth.stem)


def _images_of_sequence(path: Path, result: Path, options: SourceOptions) -> Iterator[ImageBoxes]:
    sequence = read_sequence(path)
    if sequence.truth is None:
        raise ValueError(f"{path}: has no truth")
    world = str((sequence.provenance.get("scenario") or {}).get("world", path.name))
    found, true = found_boxes(result, list(sequence.setup.mounts), options), read_boxes(path)
    for frame in _frames(len(sequence.truth), options.frames or found.frames, path):
        place = dict(zip(sequence.truth[frame].person_id.tolist(), sequence.truth[frame].feet[:, :2], strict=True))
        for name, boxes in found.boxes.items():
            camera = sequence.setup.mounts[name].camera
            bodies, (box, score) = true.get((frame, name), Boxes.none()), boxes.get(frame, NONE)
            edges, n = edges_of(box), len(bodies.person)
            feet = np.array([place.get(person, (np.nan, np.nan)) for person in bodies.person.tolist()]).reshape(n, 2)
            # Boxes of sequences count pixels from the corner of the image, for every camera model.
            own_feet = feet_on_ground((camera, _camera_pose(sequence, name, frame)), sequence.setup.ground, edges + camera.pixel_centre - 0.5)
            # A hidden person has no visible part.
            counts, judged_ = (bodies.visible > 0) | (not found.visible), np.ones(len(box), dtype=np.bool_)
            period = float(camera.width) if camera.wraps else None
            whole = bodies.seen if found.visible else bodies.full
            yield ImageBoxes(whole, edges, score, bodies.visible, counts, judged_, feet, own_feet, period, world, name, frame)


def _camera_pose(sequence: Sequence, name: str, frame: int) -> Pose:
    assert sequence.truth is not None
    mount = sequence.setup.mounts[name]
    start, true = sequence.setup.starts[mount.robot], sequence.truth[frame].T_world_robot
    if mount.robot in true:
        return true[mount.robot] @ mount.T_body_camera
    assert start is not None, "a fixed camera has a start"
    return start.T_world_robot @ mount.T_body_camera


def _images_of_recording(path: Path, result: Path, options: SourceOptions) -> Iterator[ImageBoxes]:
    recording = open_recording(path, SourceOptions(pixels=True))
    labels = bool(recording.source.get("labels_as_detections"))
    found = found_boxes(result, list(recording.cameras), options)
    if found.visible and not labels:
        raise ValueError(f"{result}: has boxes of visible parts, and {path} has true boxes of whole bodies, needs `pilsim detect --boxes whole`")
    frames = _frames(recording.frames, options.frames or found.frames, path)
    for name, boxes in found.boxes.items():
        yield from _of_labels(path, recording, name, (frames, boxes)) if labels else _of_camera(path, recording, name, (frames, boxes))


def _of_labels(path: Path, recording: Recording, name: str, found: tuple[range, FrameBoxes]) -> Iterator[ImageBoxes]:
    """The images of a recording with labelled boxes in place of a detector's, such as JRDB."""
    camera = recording.cameras[name].camera
    for frame in found[0]:
        box, score = found[1].get(frame, NONE)
        labels = edges_of(recording.detections.get(name, {}).get(frame, NONE)[0])
        image = ImageBoxes.of(labels, edges_of(box), score)
        yield replace(image, period=float(camera.width) if camera.wraps else None, world=path.name, camera=name, frame=frame)


def _of_camera(path: Path, recording: Recording, name: str, found: tuple[range, FrameBoxes]) -> Iterator[ImageBoxes]:
    """The images of a recording with true boxes of this camera, or with true places, at which bodies are projected."""
    frames, boxes = found
    if not recording.truth:
        raise ValueError(f"{path}: has no truth, which scores need")
    camera, people = recording.cameras[name], true_people(path, recording, [name])
    for frame in frames:
        pose = recording.pose_at(camera, frame)
        if pose is None or frame not in people.places:
            continue
        box, score = boxes.get(frame, NONE)
        edges, (person, feet) = edges_of(box), people.places[frame]
        known = people.boxes.get(name, {}).get(frame)
        places = feet_on_ground((camera.camera, pose), recording.ground, edges)
        if known is not None:
            whole, visible, own = edges_of(known), np.full(len(known), np.nan), feet
            complete = np.ones(len(edges), dtype=np.bool_)
        else:
            bodies = bodies_in_view((camera.camera, pose), person, feet, recording.pillars)
            # Detectors cut their boxes off at the edge of the image.
            whole, visible = clipped(bodies.whole[:, :2], bodies.whole[:, 2:], camera.camera), bodies.visible
            own = feet[[person.tolist().index(one) for one in bodies.person.tolist()]]
            complete = _complete(recording, places)
        period = float(camera.camera.width) if camera.camera.wraps else None
        counts = np.ones(len(whole), dtype=np.bool_)
        yield ImageBoxes(whole, edges, score, visible, counts, complete, own[:, :2], places, period, path.name, name, frame)


def _complete(recording: Recording, feet: Array) -> Mask:
    """Whether boxes with feet (n, 2) m stand where the truth is complete; those without feet on the ground do not."""
    if recording.area is None:
        return np.ones(len(feet), dtype=np.bool_)
    return np.asarray(np.isfinite(feet).all(axis=1) & judged(recording, np.nan_to_num(feet, nan=np.inf)))


def feet_on_ground(view: tuple[Camera, Pose], ground: Ground, edges: Array) -> Array:
    """Places (n, 2) m on the ground of the middle of the lower edges of boxes (n, 4) px.

    They are NaN where the ray misses the ground, and for boxes that the lower border of the image cuts. view: the camera and T_world_camera.
    """
    camera, pose = view
    if not len(edges):
        return np.zeros((0, 2))
    pixels = np.stack([(edges[:, 0] + edges[:, 2]) / 2, edges[:, 3]], axis=1)
    if camera.wraps:
        pixels[:, 0] = np.mod(pixels[:, 0], camera.width)
    rays = camera.bearings_from_pixels(pixels) @ pose.rotation.T
    feet, hit = ground.intersect(np.broadcast_to(pose.translation, rays.shape), rays, REACH)
    whole = edges[:, 3] < camera.height + camera.pixel_centre - 1.5
    return np.asarray(np.where((hit & whole)[:, None], feet[:, :2], np.nan))
