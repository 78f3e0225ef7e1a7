"""JRDB (Martín-Martín et al. 2021): 2-D labels and detections in stitched panoramas, 3-D labels in the camera's frame; writer and reader.

2-D boxes are in pixels from the corner of the image. left lies in [0, W); left + width may exceed W over the seam, where `wraps` is true.
3-D boxes are in the camera's frame: x forward, y left, z up, metres. rot_z is the heading about z, anticlockwise from x.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, wrap
from tracker.geometry.camera_protocol import MAX_SIDE
from tracker.io.json_files import JsonObject, read_json, write_json
from tracker.io.text_files import parse_number
from tracker.sequence.calibration import MAX_RATE, MIN_RATE

LABELS_2D, LABELS_3D, DETECTIONS = "labels/labels_2d_stitched", "labels/labels_3d", "detections/detections_2d_stitched"
"""Folders of files SEQUENCE.json."""
OCCLUSION = ((0.95, "Fully_visible"), (0.5, "Mostly_visible"), (0.0, "Severely_occluded"))
"""Least visible fraction → name of the occlusion; a person without visible pixels is HIDDEN."""
HIDDEN = "Fully_occluded"
_LABEL = "pedestrian:"
_DETECTION = "person:"
_PANORAMA = "stitched_image0"
_SPACE = ("cx", "cy", "cz", "l", "w", "h", "rot_z")


@dataclass(frozen=True, eq=False)
class Label2d:
    """A person in a panorama: person id; box (4,) left, top, width, height px of the whole body.

    seen (4,): the box of the visible part, zeros where nothing is visible. visible: visible fraction in [0, 1].
    """

    person: int
    box: Array
    seen: Array
    visible: float

    @property
    def occlusion(self) -> str:
        """Name of the occlusion in JRDB."""
        above = (name for limit, name in OCCLUSION if self.visible >= limit and self.visible > 0)
        return next(above, HIDDEN)


@dataclass(frozen=True, eq=False)
class Label3d:
    """A person's 3-D box in the camera's frame. person: id. centre (3,) m. size (3,) m: along the heading, across it and up. heading: rad about z."""

    person: int
    centre: Array
    size: Array
    heading: float


@dataclass(frozen=True)
class PanoramaNote:
    """Data that JRDB's layout does not hold: the field `pilsim` in labels_2d_stitched.

    rate: frames per second. width, height: of the images, px. above_ground: height, m, of the camera above the ground.
    horizon, focal: of cylinders, px; None for equirectangular images.
    """

    rate: float
    width: int
    height: int
    above_ground: float
    horizon: float | None = None
    focal: float | None = None


Labels2d = Mapping[int, Sequence[Label2d]]
Labels3d = Mapping[int, Sequence[Label3d]]


def write_labels_2d(path: Path, labels: Labels2d, width: int, note: PanoramaNote | None = None) -> None:
    """Write frame → labels as a file of labels_2d_stitched. width: of the panorama, px. note: a field of pilsim, None to leave it out."""
    frames = {f"{frame:06d}.jpg": [_json_2d(label, width) | {"file_id": f"{frame:06d}.jpg"} for label in labels[frame]] for frame in sorted(labels)}
    content: dict[str, Any] = {"labels": frames}
    if note is not None:
        content["pilsim"] = asdict(note)
    write_json(path, content)


def read_note(path: Path) -> PanoramaNote | None:
    """Read the note of a file by write_labels_2d, None in a file of JRDB itself. Raises ValueError with path and field for other content."""
    content = JsonObject(read_json(path), str(path))
    if content.values.get("pilsim") is None:
        return None
    note = content.part("pilsim")
    rate, above_ground = note.number("rate", MIN_RATE, MAX_RATE), note.number("above_ground", 1e-4, 1e6)
    out = PanoramaNote(rate, note.whole("width", 1, MAX_SIDE), note.whole("height", 1, MAX_SIDE), above_ground)
    if note.values.get("horizon") is None and note.values.get("focal") is None:
        return out
    return replace(out, horizon=note.number("horizon", 1e-4, 1e6), focal=note.number("focal", 1e-4, 1e6))


def _json_2d(label: Label2d, width: int) -> dict[str, Any]:
    left, _, w, h = label.box.tolist()
    attributes = {"area": w * h, "interpolated": False, "no_eval": label.visible == 0, "occlusion": label.occlusion, "truncated": "false"}
    own = {"wraps": left + w > width, "visibility": label.visible, "box_seen": label.seen.tolist()}
    return {"label_id": f"{_LABEL}{label.person}", "box": label.box.tolist(), "attributes": attributes} | own


def read_labels_2d(path: Path) -> dict[int, list[Label2d]]:
    """Read frame → labels of a file by write_labels_2d or of JRDB itself, where the occlusion's name gives `visible`: 1, 0.5, 0.25 and 0.

    Raises ValueError with path, frame and field for missing or wrong fields.
    """
    return {frame: [_label_2d(label) for label in labels] for frame, labels in _frames(path, ".jpg").items()}


def _label_2d(label: JsonObject) -> Label2d:
    box = label.array("box", (4,))
    seen = label.array("box_seen", (4,)) if "box_seen" in label.values else box
    if "visibility" in label.values:
        return Label2d(_person(label), box, seen, label.number("visibility", 0.0, 1.0))
    named = dict(zip((*(name for _, name in OCCLUSION), HIDDEN), (1.0, 0.5, 0.25, 0.0), strict=True))
    return Label2d(_person(label), box, seen, named[label.part("attributes").text("occlusion", "|".join(named), f"one of {', '.join(named)}")])


def write_labels_3d(path: Path, labels: Labels3d) -> None:
    """Write frame → labels as a file of labels_3d."""
    frames = {f"{frame:06d}.pcd": [_json_3d(label) | {"file_id": f"{frame:06d}.pcd"} for label in labels[frame]] for frame in sorted(labels)}
    write_json(path, {"labels": frames})


def _json_3d(label: Label3d) -> dict[str, Any]:
    x, y, _ = label.centre.tolist()
    box = dict(zip(_SPACE, [*label.centre.tolist(), *label.size.tolist(), float(label.heading)], strict=True))
    attributes = {"distance": float(np.linalg.norm(label.centre)), "interpolated": False, "no_eval": False, "num_points": -1}
    angle = float(wrap(label.heading - np.arctan2(y, x)))
    return {"label_id": f"{_LABEL}{label.person}", "box": box, "attributes": attributes, "observation_angle": angle}


def read_labels_3d(path: Path) -> dict[int, list[Label3d]]:
    """Read frame → labels of a file by write_labels_3d or of JRDB itself. Raises ValueError as read_labels_2d."""
    return {frame: [_label_3d(label) for label in labels] for frame, labels in _frames(path, ".pcd").items()}


def _label_3d(label: JsonObject) -> Label3d:
    box = label.part("box")
    values = np.array([box.number(name) for name in _SPACE])
    return Label3d(_person(label), values[:3], values[3:6], float(values[6]))


def write_detections_2d(path: Path, detections: Mapping[int, tuple[Array, Array]]) -> None:
    """Write frame → boxes (n, 4) left, top, width, height px and scores (n,) as a file of detections_2d_stitched."""
    frames = {}
    for frame in sorted(detections):
        boxes, scores = detections[frame]
        pairs = enumerate(zip(boxes.tolist(), scores.tolist(), strict=True))
        name = f"{frame:06d}.jpg"
        frames[name] = [{"box": box, "file_id": name, "label_id": f"{_DETECTION}{k}", "score": score} for k, (box, score) in pairs]
    write_json(path, {"detections": frames})


def read_detections_2d(path: Path) -> dict[int, tuple[Array, Array]]:
    """Read frame → boxes (n, 4) left, top, width, height px and scores (n,) of the people in a file of detections_2d_stitched.

    Raises ValueError with path, frame and field for missing or wrong fields, and for a negative width or height.
    """
    out = {}
    for frame, entries in _frames(path, ".jpg", "detections").items():
        people = [entry for entry in entries if entry.a("label_id", str).startswith(_DETECTION)]
        boxes = np.array([entry.array("box", (4,)) for entry in people]).reshape(-1, 4)
        if (boxes[:, 2:] < 0).any():
            raise people[int(np.argmax((boxes[:, 2:] < 0).any(axis=1)))].refused("box", "a width and a height of at least 0")
        out[frame] = boxes, np.array([entry.number("score") for entry in people])
    return out


def read_times(path: Path) -> dict[int, float]:
    """Read frames_img.json: number of an image → time of the panorama, s. Raises ValueError as read_labels_2d."""
    out = {}
    for row in JsonObject(read_json(path), str(path)).objects("data"):
        for camera in row.objects("cameras"):
            if camera.a("name", str) == _PANORAMA:
                stem = camera.text("url", r".*?[0-9]{1,12}\.\w+", "a path that ends in NUMBER.jpg").rpartition("/")[2].partition(".")[0]
                time = camera.values.get("timestamp")
                out[int(stem)] = parse_number(time, f"{camera.where}: timestamp") if isinstance(time, str) else camera.number("timestamp")
    return out


def _person(label: JsonObject) -> int:
    return int(label.text("label_id", f"{_LABEL}[0-9]{{1,16}}", f"{_LABEL}NUMBER").removeprefix(_LABEL))


def _frames(path: Path, suffix: str, key: str = "labels") -> dict[int, list[JsonObject]]:
    frames = JsonObject(read_json(path), str(path)).part(key)
    out = {}
    for name in frames.values:
        if not re.fullmatch(f"[0-9]{{1,12}}{re.escape(suffix)}", name):
            raise ValueError(f"{path}: {key} of {name[:80]!r}, needs NUMBER{suffix}")
        out[int(name.removesuffix(suffix))] = frames.objects(name)
    return out
