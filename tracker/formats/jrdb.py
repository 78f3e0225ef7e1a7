"""JRDB (Martín-Martín et al. 2021): labels of stitched panoramas, in the image and in the robot's frame. Written and read side by side.

Boxes in the image are counted from its corner; left lies in [0, W) and left + width may pass W over the seam, where `wraps` is true. Boxes in space
are in the camera's frame, x forward, y left, z up, metres; rot_z is the heading about z, anticlockwise from x.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, frozen, wrap
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json

OCCLUSION = ((0.95, "Fully_visible"), (0.5, "Mostly_visible"), (0.0, "Severely_occluded"))
"""Visible fraction above which an occlusion has this name; nothing seen is Fully_occluded."""
HIDDEN = "Fully_occluded"
LARGEST = 2**53
_LABEL = "pedestrian:"
_SPACE = ("cx", "cy", "cz", "l", "w", "h", "rot_z")


@dataclass(frozen=True, eq=False)
class Label:
    """Somebody in a panorama: person id; box (4,) left, top, width, height px of the whole body; seen (4,) of what is seen, zeros where nothing is;
    visible in [0, 1].

    Raises ValueError for an id that other readers cannot keep, and for a visible fraction beyond its bounds.
    """

    person: int
    box: Array
    seen: Array
    visible: float

    def __post_init__(self) -> None:
        _check_person(self.person)
        object.__setattr__(self, "box", frozen(self.box, (4,), "box"))
        object.__setattr__(self, "seen", frozen(self.seen, (4,), "seen"))
        if not 0 <= self.visible <= 1:
            raise ValueError(f"visible is {self.visible}, needs 0 to 1")

    @property
    def occlusion(self) -> str:
        """In JRDB's words."""
        above = (name for limit, name in OCCLUSION if self.visible >= limit and self.visible > 0)
        return next(above, HIDDEN)


@dataclass(frozen=True, eq=False)
class Solid:
    """Somebody in space, in the camera's frame: person id; centre (3,) m; size (3,) m, along the heading, across it, up; heading rad about z."""

    person: int
    centre: Array
    size: Array
    heading: float

    def __post_init__(self) -> None:
        _check_person(self.person)
        object.__setattr__(self, "centre", frozen(self.centre, (3,), "centre"))
        object.__setattr__(self, "size", frozen(self.size, (3,), "size"))


def _check_person(person: int) -> None:
    if not 0 <= person < LARGEST:
        raise ValueError(f"person is {person}, needs 0 to less than 2^53")


Labels = Mapping[int, Sequence[Label]]
Solids = Mapping[int, Sequence[Solid]]


def write_labels(path: Path, labels: Labels, width: int) -> None:
    """Frame → labels in a panorama of that width px, as labels_2d_stitched has them."""
    frames = {f"{frame:06d}.jpg": [_of_label(label, width) | {"file_id": f"{frame:06d}.jpg"} for label in labels[frame]] for frame in sorted(labels)}
    write_text(path, json.dumps({"labels": frames}, allow_nan=False) + "\n")


def _of_label(label: Label, width: int) -> dict[str, Any]:
    left, _, w, h = label.box.tolist()
    attributes = {"area": w * h, "interpolated": False, "no_eval": label.visible == 0, "occlusion": label.occlusion, "truncated": "false"}
    own = {"wraps": left + w > width, "visibility": label.visible, "box_seen": label.seen.tolist()}
    return {"label_id": f"{_LABEL}{label.person}", "box": label.box.tolist(), "attributes": attributes} | own


def read_labels(path: Path) -> dict[int, list[Label]]:
    """What write_labels wrote; of JRDB's own files, too: `visible` is then what the occlusion's name says at most.

    Raises ValueError with the file's name, frame and field for what is missing or wrong.
    """
    return {frame: [_label(entry, f"{path}: frame {frame}") for entry in entries] for frame, entries in _frames(path, ".jpg").items()}


def _label(entry: dict[str, Any], where: str) -> Label:
    try:
        box = np.array(entry["box"], dtype=np.float64)
        named = {name: limit for limit, name in OCCLUSION} | {OCCLUSION[0][1]: 1.0, HIDDEN: 0.0}
        visible = entry["visibility"] if "visibility" in entry else named[entry["attributes"]["occlusion"]]
        return Label(_person(entry), box, np.array(entry.get("box_seen", box), dtype=np.float64), float(visible))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{where}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def write_solids(path: Path, solids: Solids) -> None:
    """Frame → boxes in space, as labels_3d has them."""
    frames = {f"{frame:06d}.pcd": [_of_solid(solid) | {"file_id": f"{frame:06d}.pcd"} for solid in solids[frame]] for frame in sorted(solids)}
    write_text(path, json.dumps({"labels": frames}, allow_nan=False) + "\n")


def _of_solid(solid: Solid) -> dict[str, Any]:
    x, y, _ = solid.centre.tolist()
    box = dict(zip(_SPACE, [*solid.centre.tolist(), *solid.size.tolist(), float(solid.heading)], strict=True))
    attributes = {"distance": float(np.linalg.norm(solid.centre)), "interpolated": False, "no_eval": False, "num_points": -1}
    angle = float(wrap(solid.heading - np.arctan2(y, x)))
    return {"label_id": f"{_LABEL}{solid.person}", "box": box, "attributes": attributes, "observation_angle": angle}


def read_solids(path: Path) -> dict[int, list[Solid]]:
    """What write_solids wrote, or JRDB's own. ValueError as read_labels."""
    return {frame: [_solid(entry, f"{path}: frame {frame}") for entry in entries] for frame, entries in _frames(path, ".pcd").items()}


def _solid(entry: dict[str, Any], where: str) -> Solid:
    try:
        values = np.array([entry["box"][name] for name in _SPACE], dtype=np.float64)
        return Solid(_person(entry), values[:3], values[3:6], float(values[6]))
    except (KeyError, TypeError) as error:
        raise ValueError(f"{where}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _person(entry: dict[str, Any]) -> int:
    label = entry["label_id"]
    if not isinstance(label, str) or not label.startswith(_LABEL) or not label.removeprefix(_LABEL).isdecimal():
        raise ValueError(f"label_id is {str(label)[:80]!r}, needs {_LABEL}NUMBER")
    return int(label.removeprefix(_LABEL))


def _frames(path: Path, suffix: str) -> dict[int, list[dict[str, Any]]]:
    content = read_json(path)
    frames = content.get("labels") if isinstance(content, dict) else None
    if not isinstance(frames, dict):
        raise ValueError(f"{path}: has no labels")
    out = {}
    for name, entries in frames.items():
        stem = name.removesuffix(suffix)
        if stem == name or not stem.isdecimal() or not isinstance(entries, list):
            raise ValueError(f"{path}: labels of {name[:80]!r}, needs NUMBER{suffix} and a list")
        out[int(stem)] = entries
    return out
