"""JRDB (Martín-Martín et al. 2021): 2-D labels and detections in stitched panoramas, 3-D labels in the camera's frame; writer and reader.

2-D boxes are in pixels from the corner of the image. left lies in [0, W); left + width may exceed W over the seam, where `wraps` is true.
3-D boxes are in the camera's frame: x forward, y left, z up, metres. rot_z is the heading about z, anticlockwise from x.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, set_array, wrap
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json

LABELS_2D, LABELS_3D, DETECTIONS = "labels/labels_2d_stitched", "labels/labels_3d", "detections/detections_2d_stitched"
"""Folders of files SEQUENCE.json."""
OCCLUSION = ((0.95, "Fully_visible"), (0.5, "Mostly_visible"), (0.0, "Severely_occluded"))
"""Least visible fraction → name of the occlusion; a person without visible pixels is HIDDEN."""
HIDDEN = "Fully_occluded"
LARGEST = 2**53
"""Ids from here on are not exact in JSON readers that use floats."""
_LABEL = "pedestrian:"
_DETECTION = "person:"
_SPACE = ("cx", "cy", "cz", "l", "w", "h", "rot_z")


@dataclass(frozen=True, eq=False)
class Label2d:
    """A person in a panorama: person id; box (4,) left, top, width, height px of the whole body.

    seen (4,): the box of the visible part, zeros where nothing is visible. visible: visible fraction in [0, 1].
    Raises ValueError for an id of 2^53 or more, and for a visible fraction out of bounds.
    """

    person: int
    box: Array
    seen: Array
    visible: float

    def __post_init__(self) -> None:
        _check_person(self.person)
        set_array(self, "box", (4,))
        set_array(self, "seen", (4,))
        if not 0 <= self.visible <= 1:
            raise ValueError(f"visible is {self.visible}, needs 0 to 1")

    @property
    def occlusion(self) -> str:
        """Name of the occlusion in JRDB."""
        above = (name for limit, name in OCCLUSION if self.visible >= limit and self.visible > 0)
        return next(above, HIDDEN)


@dataclass(frozen=True, eq=False)
class Label3d:
    """A person's 3-D box in the camera's frame: person id; centre (3,) m; size (3,) m along the heading, across it and up; heading rad about z.

    Raises ValueError for an id of 2^53 or more.
    """

    person: int
    centre: Array
    size: Array
    heading: float

    def __post_init__(self) -> None:
        _check_person(self.person)
        set_array(self, "centre", (3,))
        set_array(self, "size", (3,))


def _check_person(person: int) -> None:
    if not 0 <= person < LARGEST:
        raise ValueError(f"person is {person}, needs 0 to less than 2^53")


@dataclass(frozen=True)
class PanoramaNote:
    """What JRDB's layout does not hold, a field of pilsim in labels_2d_stitched.

    rate: frames per second. width, height: of the images, px. above_ground: height, m, of the camera above the ground.
    horizon, focal: of cylinders, px; None for equirectangular images. Raises ValueError for a value out of bounds.
    """

    rate: float
    width: int
    height: int
    above_ground: float
    horizon: float | None = None
    focal: float | None = None

    def __post_init__(self) -> None:
        for name in ("rate", "width", "height", "above_ground", "horizon", "focal"):
            value = getattr(self, name)
            if value is None and name in ("horizon", "focal"):
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-4 <= value < 1e6:
                raise ValueError(f"{name} is {str(value)[:40]}, needs a number above 0, from 1e-4, and below 1e6")
        if (self.horizon is None) != (self.focal is None):
            raise ValueError(f"horizon is {self.horizon} and focal is {self.focal}, needs both or neither")


Labels2d = Mapping[int, Sequence[Label2d]]
Labels3d = Mapping[int, Sequence[Label3d]]


def write_labels_2d(path: Path, labels: Labels2d, width: int, note: PanoramaNote | None = None) -> None:
    """Write frame → labels as a file of labels_2d_stitched. width: of the panorama, px. note: a field of pilsim, None to leave it out."""
    frames = {f"{frame:06d}.jpg": [_json_2d(label, width) | {"file_id": f"{frame:06d}.jpg"} for label in labels[frame]] for frame in sorted(labels)}
    content: dict[str, Any] = {"labels": frames}
    if note is not None:
        content["pilsim"] = asdict(note)
    write_text(path, json.dumps(content, allow_nan=False) + "\n")


def read_note(path: Path) -> PanoramaNote | None:
    """Read the note of a file by write_labels_2d, None in a file of JRDB itself. Raises ValueError with path and field for other content."""
    content = read_json(path)
    note = content.get("pilsim") if isinstance(content, dict) else None
    if note is None:
        return None
    try:
        return PanoramaNote(note["rate"], int(note["width"]), int(note["height"]), note["above_ground"], note.get("horizon"), note.get("focal"))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: pilsim: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{path}: pilsim: {error}") from None


def _json_2d(label: Label2d, width: int) -> dict[str, Any]:
    left, _, w, h = label.box.tolist()
    attributes = {"area": w * h, "interpolated": False, "no_eval": label.visible == 0, "occlusion": label.occlusion, "truncated": "false"}
    own = {"wraps": left + w > width, "visibility": label.visible, "box_seen": label.seen.tolist()}
    return {"label_id": f"{_LABEL}{label.person}", "box": label.box.tolist(), "attributes": attributes} | own


def read_labels_2d(path: Path) -> dict[int, list[Label2d]]:
    """Read frame → labels of a file by write_labels_2d or of JRDB itself, where `visible` is the most that the occlusion's name allows.

    Raises ValueError with path, frame and field for missing or wrong fields.
    """
    return {frame: [_label_2d(entry, f"{path}: frame {frame}") for entry in entries] for frame, entries in _frames(path, ".jpg").items()}


def _label_2d(entry: dict[str, Any], where: str) -> Label2d:
    try:
        box = np.array(entry["box"], dtype=np.float64)
        named = {name: limit for limit, name in OCCLUSION} | {OCCLUSION[0][1]: 1.0, HIDDEN: 0.0}
        visible = entry["visibility"] if "visibility" in entry else named[entry["attributes"]["occlusion"]]
        return Label2d(_person(entry), box, np.array(entry.get("box_seen", box), dtype=np.float64), float(visible))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{where}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def write_labels_3d(path: Path, labels: Labels3d) -> None:
    """Write frame → labels as a file of labels_3d."""
    frames = {f"{frame:06d}.pcd": [_json_3d(label) | {"file_id": f"{frame:06d}.pcd"} for label in labels[frame]] for frame in sorted(labels)}
    write_text(path, json.dumps({"labels": frames}, allow_nan=False) + "\n")


def _json_3d(label: Label3d) -> dict[str, Any]:
    x, y, _ = label.centre.tolist()
    box = dict(zip(_SPACE, [*label.centre.tolist(), *label.size.tolist(), float(label.heading)], strict=True))
    attributes = {"distance": float(np.linalg.norm(label.centre)), "interpolated": False, "no_eval": False, "num_points": -1}
    angle = float(wrap(label.heading - np.arctan2(y, x)))
    return {"label_id": f"{_LABEL}{label.person}", "box": box, "attributes": attributes, "observation_angle": angle}


def read_labels_3d(path: Path) -> dict[int, list[Label3d]]:
    """Read frame → labels of a file by write_labels_3d or of JRDB itself. Raises ValueError as read_labels_2d."""
    return {frame: [_label_3d(entry, f"{path}: frame {frame}") for entry in entries] for frame, entries in _frames(path, ".pcd").items()}


def _label_3d(entry: dict[str, Any], where: str) -> Label3d:
    try:
        values = np.array([_number(entry["box"][name], f"box.{name}") for name in _SPACE])
        return Label3d(_person(entry), values[:3], values[3:6], float(values[6]))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{where}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} is {repr(value)[:40]}, needs a number")
    return float(value)


def write_detections_2d(path: Path, detections: Mapping[int, tuple[Array, Array]]) -> None:
    """Write frame → boxes (n, 4) left, top, width, height px and scores (n,) as a file of detections_2d_stitched."""
    frames = {}
    for frame in sorted(detections):
        boxes, scores = detections[frame]
        pairs = enumerate(zip(boxes.tolist(), scores.tolist(), strict=True))
        name = f"{frame:06d}.jpg"
        frames[name] = [{"box": box, "file_id": name, "label_id": f"{_DETECTION}{k}", "score": score} for k, (box, score) in pairs]
    write_text(path, json.dumps({"detections": frames}, allow_nan=False) + "\n")


def read_detections_2d(path: Path) -> dict[int, tuple[Array, Array]]:
    """Read frame → boxes (n, 4) left, top, width, height px and scores (n,) of the people in a file of detections_2d_stitched.

    Raises ValueError with path, frame and field for missing or wrong fields, and for a negative width or height.
    """
    out = {}
    for frame, entries in _frames(path, ".jpg", "detections").items():
        try:
            people = [entry for entry in entries if str(entry["label_id"]).startswith(_DETECTION)]
            boxes = np.array([entry["box"] for entry in people], dtype=np.float64).reshape(len(people), 4)
            scores = np.array([entry["score"] for entry in people], dtype=np.float64).reshape(len(people))
        except (KeyError, TypeError) as error:
            raise ValueError(f"{path}: frame {frame}: field {error} is missing or of the wrong kind") from None
        except ValueError as error:
            raise ValueError(f"{path}: frame {frame}: box needs left, top, width, height, and score a number ({error})") from None
        if not np.isfinite(boxes).all() or not np.isfinite(scores).all() or (boxes[:, 2:] < 0).any():
            raise ValueError(f"{path}: frame {frame}: box and score need finite numbers, width and height at least 0")
        out[frame] = boxes, scores
    return out


def _person(entry: dict[str, Any]) -> int:
    label = entry["label_id"]
    if not isinstance(label, str) or not label.startswith(_LABEL) or not label.removeprefix(_LABEL).isdecimal():
        raise ValueError(f"label_id is {str(label)[:80]!r}, needs {_LABEL}NUMBER")
    return int(label.removeprefix(_LABEL))


def _frames(path: Path, suffix: str, key: str = "labels") -> dict[int, list[dict[str, Any]]]:
    content = read_json(path)
    frames = content.get(key) if isinstance(content, dict) else None
    if not isinstance(frames, dict):
        raise ValueError(f"{path}: has no {key}")
    out = {}
    for name, entries in frames.items():
        stem = name.removesuffix(suffix)
        if stem == name or not stem.isdecimal() or not isinstance(entries, list):
            raise ValueError(f"{path}: {key} of {name[:80]!r}, needs NUMBER{suffix} and a list")
        out[int(stem)] = entries
    return out
