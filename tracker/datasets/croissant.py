"""Metadata of a dataset as Croissant 1.0 (JSON-LD, MLCommons): its files with checksums, and its tables and images as record sets.

The same dataset gives the same bytes, because the file holds no date. https://docs.mlcommons.org/croissant/docs/croissant-spec.html
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.io.resume import checksum
from tracker.sequence.dataset import sequences
from tracker.sequence.schema import (
    BOXES,
    CAMERAS,
    CLOCKS,
    DETECTIONS,
    IMU,
    INERTIAL,
    JOINTS,
    KEYPOINTS,
    ODOMETRY,
    PLACE_FILE,
    ROBOT_DETECTIONS,
    ROBOTS,
    STAMPS,
    WHEELS,
)
from tracker.sequence.truth_tables import people_columns_of

FILE = "croissant.json"
CONFORMS = "http://mlcommons.org/croissant/1.0"
LICENSE = "https://www.apache.org/licenses/LICENSE-2.0"
CITE = "@misc{pilsim, title = {pilsim: irregular worlds, people and panoramic robots with exact truth}}"
TYPES: dict[type, str] = {int: "sc:Integer", float: "sc:Float", str: "sc:Text"}
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "equivalentProperty": "cr:equivalentProperty",
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
TABLES: dict[str, tuple[str, Mapping[str, type], str]] = {
    "odometry": ("odometry.csv", ODOMETRY, "Motion of a robot's body since the frame before, measured, with its covariance."),
    "detections": ("detections.csv", DETECTIONS, "What the simulated detector reported: directions in the camera's frame."),
    "companions": ("companions.csv", ROBOT_DETECTIONS, "Other robots in the views of robots: directions in the camera's frame."),
    "robots": ("truth/robots.csv", ROBOTS, "True poses of the robots' bodies."),
    "cameras": ("truth/cameras.csv", CAMERAS, "True poses of the cameras, and the terrain straight below."),
    "boxes": ("truth/boxes.csv", BOXES, "True boxes of people in every view."),
    "keypoints": ("truth/keypoints.csv", KEYPOINTS, "The 17 key points of COCO in every view."),
    "joints": ("truth/joints.csv", JOINTS, "The 17 key points of COCO in the world."),
    "imu": ("imu.csv", IMU, "Samples of the robots' IMU in their body frame (x forward, y left, z up)."),
    "inertial": ("truth/inertial.csv", INERTIAL, "The samples of imu.csv without errors, and the biases that are in them."),
    "wheels": ("wheels.csv", WHEELS, "Samples of the robots' wheel encoders."),
    "stamps": ("stamps.csv", STAMPS, "Times of the frames, true and by the clock of each robot and camera."),
    "clocks": ("truth/clocks.csv", CLOCKS, "True errors of the clocks."),
}
"""Record set → file in a sequence, its columns, description. people.csv is not among them, because its columns depend on the cameras."""
PEOPLE = "Where people stand, and the share of each that every camera sees."
_POSE = "of the pose (x forward, y left, z up; to the world, or now to before)"
COLUMNS: tuple[tuple[str, str], ...] = (
    (r"frame", "index from 0; time = frame · period of calibration.json"),
    (r"robot|camera", "name, as in calibration.json"),
    (r"sits", "1 for a person who sits, else 0"),
    (r"clock", "name of the robot or camera whose clock it is, as in calibration.json"),
    (r"time", "[s] true time since frame 0; of the IMU the end of the sample"),
    (r"stamp", "[s] that time on the clock of the robot or camera"),
    (r"gyro_[xyz]", "[rad/s] angular velocity in the body frame"),
    (r"force_[xyz]", "[m/s²] specific force in the body frame"),
    (r"gyro_bias_[xyz]", "[rad/s] bias of the gyroscope"),
    (r"force_bias_[xyz]", "[m/s²] bias of the accelerometer"),
    (r"(front|rear)_(left|right)", "[rad] total angle of that wheel"),
    (r"offset|jitter", "[s] constant error of a clock (offset), or one sigma of the error of each stamp (jitter)"),
    (r"drift", "[ppm] relative error of the rate of a clock"),
    (r"person", "id, the same in all views and at all times"),
    (r"tipped", "1 where the robot has tipped over, else 0"),
    (r"[xyz]", "[m]"),
    (r"q[wxyz]", f"unit quaternion {_POSE}"),
    (r"up_[xyz]", "direction of up in the body's frame by the accelerometer; zeros where there is none"),
    (r"up_sigma", "[rad] its error"),
    (r"bearing_[xyz]", "unit direction of the box's middle, or of the seen robot's camera, in the camera's frame (x forward, y left, z up)"),
    (r"width|height", "[rad] span of the box in azimuth (width) or elevation (height)"),
    (r"confidence", "in [0, 1]"),
    (r"c\d\d", "covariance, upper triangle: [rad²] of detections and companions; of odometry, right tangent [translation m, rotation rad]"),
    (r"(full_)?(left|top|right|bottom)", "[px] edge from the image's corner, of what is seen, or of the whole body (full_); right may pass W"),
    (r"visible|visible_.*", "in [0, 1]: pixels seen / pixels that the body would cover alone"),
    (r"range", "[m] from the camera to the middle between the hips"),
    (r"ground", "[m] height of the terrain straight below the camera"),
    (r"normal_[xyz]", "unit normal of the terrain there"),
    (r".*_[uv]", "[px] from the image's corner; 0 where not in the image"),
    (r".*_visibility", "2 visible, 1 hidden, 0 not in the image"),
    (r".*_[xyz]", "[m] in the world"),
)
"""Pattern of a column's name → description."""


def describe(column: str) -> str:
    """The description of a column, with its unit."""
    return next(text for pattern, text in COLUMNS if re.fullmatch(pattern, column))


@dataclass(frozen=True, eq=False)
class ManifestFiles:
    """The files of a dataset by its manifests. checksums: path of a sequence in the dataset ('' for a single sequence) → file → SHA-256."""

    checksums: dict[str, dict[str, str]]

    @staticmethod
    def of(folder: Path) -> ManifestFiles:
        found = {}
        for path in sequences(folder):
            prefix = "" if path == folder else path.name + "/"
            found[prefix] = {name: entry["sha256"] for name, entry in read_json(path / "manifest.json")["files"].items()}
        return ManifestFiles(found)

    def holding(self, name: str) -> list[str]:
        """Paths of the file `name` in all sequences that have it."""
        return [prefix + name for prefix, files in self.checksums.items() if name in files]

    def suffixes(self, kind: str) -> list[str]:
        """Suffixes of the images of a kind."""
        return sorted({Path(name).suffix for files in self.checksums.values() for name in files if name.startswith(f"{kind}/")})


def write_croissant(folder: Path) -> None:
    """Write croissant.json of a dataset or of a single sequence. Raises ValueError where `folder` is neither."""
    content = json.dumps(croissant_of(folder), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(folder / FILE, content)


def croissant_of(folder: Path) -> dict[str, Any]:
    """The content of croissant.json as JSON values."""
    files = ManifestFiles.of(folder)
    distribution = [_manifest(folder, prefix) for prefix in files.checksums]
    records = []
    for name, (file, columns, text) in tables_of(folder).items():
        paths = files.holding(file)
        if paths:
            distribution += [_object(prefix + file, sha256[file], "text/csv") for prefix, sha256 in files.checksums.items() if file in sha256]
            distribution.append(_file_set(name, paths, "text/csv", f"{file} of every sequence"))
            records.append(_records(name, columns, text, "" not in files.checksums))
    for kind, text in (("images", "Images, RGB: panoramas and fixed views."), ("instances", "Instances: the person's id at each pixel, 0 nobody.")):
        for suffix in files.suffixes(kind):
            paths = [f"{prefix}{kind}/*/*{suffix}" for prefix in files.checksums]
            mime = {".jpg": "image/jpeg", ".png": "image/png"}[suffix]
            distribution.append(_file_set(kind, paths, mime, text))
            records.append(_image_records(kind, text, "" not in files.checksums))
    name = folder.resolve().name
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": re.sub(r"[^A-Za-z0-9_-]", "_", name),
        "description": "Synthetic people in irregular worlds, seen by panoramic robots and fixed cameras, with exact truth; made by pilsim.",
        "conformsTo": CONFORMS,
        "citeAs": CITE,
        "creator": {"@type": "sc:Organization", "name": "pilsim"},
        "license": "other" if (sequences(folder)[0] / PLACE_FILE).is_file() else LICENSE,
        "url": "README.md",
        "version": "1.0.0",
        "distribution": distribution,
        "recordSet": records,
    }


def tables_of(folder: Path) -> dict[str, tuple[str, Mapping[str, type], str]]:
    """TABLES and the table of people, whose columns depend on the cameras."""
    calibration = read_json(sequences(folder)[0] / "calibration.json")
    return TABLES | {"people": ("truth/people.csv", people_columns_of(sequences(folder)[0], calibration["cameras"]), PEOPLE)}


def _manifest(folder: Path, prefix: str) -> dict[str, Any]:
    name = prefix + "manifest.json"
    return _object(name, checksum(folder / name), "application/json")


def _object(path: str, sha256: str, mime: str) -> dict[str, Any]:
    return {"@type": "cr:FileObject", "@id": path, "name": path, "contentUrl": path, "encodingFormat": mime, "sha256": sha256}


def _file_set(name: str, includes: list[str], mime: str, text: str) -> dict[str, Any]:
    return {"@type": "cr:FileSet", "@id": f"{name}-files", "name": f"{name}-files", "description": text, "encodingFormat": mime, "includes": includes}


def _field(records: str, name: str, kind: str, text: str, source: dict[str, Any]) -> dict[str, Any]:
    where = {"fileSet": {"@id": f"{records}-files"}} | source
    return {"@type": "cr:Field", "@id": f"{records}/{name}", "name": name, "description": text, "dataType": kind, "source": where}


def _part_of_path(records: str, name: str, kind: str, text: str, regex: str) -> dict[str, Any]:
    return _field(records, name, kind, text, {"extract": {"fileProperty": "fullpath"}, "transform": {"regex": regex}})


def _sequence(records: str) -> dict[str, Any]:
    return _part_of_path(records, "sequence", "sc:Text", "name of the sequence's folder", r"^([^/]+)/.*$")


def _records(name: str, columns: Mapping[str, type], text: str, many: bool) -> dict[str, Any]:
    """many: whether the folder holds several sequences, so that a row needs the name of its sequence."""
    fields = [_sequence(name)] if many else []
    fields += [_field(name, column, TYPES[kind], describe(column), {"extract": {"column": column}}) for column, kind in columns.items()]
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "description": text, "field": fields}


def _image_records(kind: str, text: str, many: bool) -> dict[str, Any]:
    fields = [_sequence(kind)] if many else []
    fields += [
        _part_of_path(kind, "camera", "sc:Text", "name, as in calibration.json", rf"^.*{kind}/([^/]+)/\d+\.[a-z]+$"),
        _part_of_path(kind, "frame", "sc:Integer", "index from 0", rf"^.*{kind}/[^/]+/(\d+)\.[a-z]+$"),
        _field(kind, "file", "sc:Text", "path in the dataset", {"extract": {"fileProperty": "fullpath"}}),
    ]
    # Readers of this format convert images to 8 bits per channel, which cannot hold the ids of instances.
    if kind == "images":
        fields.append(_field(kind, "image", "sc:ImageObject", "the picture", {"extract": {"fileProperty": "content"}}))
    return {"@type": "cr:RecordSet", "@id": kind, "name": kind, "description": text, "field": fields}
