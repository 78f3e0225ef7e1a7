"""The README.md of a dataset: front matter in YAML for the Hugging Face hub, then a description.

https://huggingface.co/docs/hub/datasets-cards
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.sequence.dataset import read_dataset, sequences

LICENSE = "apache-2.0"
TASKS = ("object-detection", "image-segmentation", "keypoint-detection")
TAGS = ("synthetic", "multi-object-tracking", "multi-camera", "slam", "panoramas", "pedestrians")
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"), (10_000_000, "1M<n<10M"))
TABLES = {
    "boxes": "truth/boxes.csv",
    "keypoints": "truth/keypoints.csv",
    "people": "truth/people.csv",
    "robots": "truth/robots.csv",
    "cameras": "truth/cameras.csv",
    "detections": "detections.csv",
    "odometry": "odometry.csv",
    "imu": "imu.csv",
    "wheels": "wheels.csv",
    "stamps": "stamps.csv",
}
"""Configuration on the hub → table of each sequence; those that no sequence has are left out."""

BODY = """
People walk through the world `{world}` ({people} a sequence), robots with panoramic cameras drive among them ({robots}), and fixed pinhole cameras
look on ({fixed}). Synthetic: people, places and images were made by pilsim, and the truth is exact.

* Sequences: {sequences}, with {frames} frames in all at {rate:g} frames/s and {images} images. Each is a folder of its own: {names}.
* Every sequence has a `README.md` that says what each file and column is, with unit, origin and index base, and a `manifest.json` with the SHA-256 of
  every file. `scenario.json` is all that made it: the same scenario gives the same bytes again (images: on one machine and GL driver).
* World: right-handed, z up, metres, seconds, radians. Bodies and cameras: x forward, y left, z up. Frames count from 0; time = frame · period.
  Pixels are counted from the image's corner: the first pixel's centre is (0.5, 0.5). Ids are the same in all views and at all times.
* `dataset.json`: what kind of dataset this is and which sequences it has. `croissant.json`: the tables and images as Croissant 1.0 records.

Look at it, check it, and write it in other formats:

    pilsim info DIR
    pilsim check DIR
    pilsim export DIR --format coco --out COCO      # or pets, mot15, mot17, wildtrack, jrdb, tum

Tables are plain CSV:

    import pandas
    boxes = pandas.read_csv("{first}/truth/boxes.csv")

Uses: detection, tracking over one or many cameras, SLAM of a team of robots, re-identification within a sequence. Limits: people are rendered bodies,
images look like a simulator's, and a detector trained on them alone will not do on real ones. There is no personal data of anybody in it.
"""


@dataclass(frozen=True)
class _Size:
    """Total numbers of frames and images, frames per second, names of moving and of fixed cameras."""

    frames: int
    images: int
    rate: float
    moving: tuple[str, ...]
    fixed: tuple[str, ...]

    @staticmethod
    def of(paths: Iterable[Path]) -> _Size:
        frames = images = 0
        calibration: dict[str, Any] = {}
        for path in paths:
            names = [name for name in read_json(path / "manifest.json")["files"] if name.startswith("images/")]
            calibration = read_json(path / "calibration.json")
            images += len(names)
            frames += len(names) // max(1, len(calibration["cameras"]))
        cameras = calibration.get("cameras", {})
        fixed = tuple(name for name, camera in cameras.items() if camera["model"] != "panorama")
        moving = tuple(name for name in cameras if name not in fixed)
        return _Size(frames, images, 1 / calibration.get("period", 1.0), moving, fixed)


def write_card(folder: Path) -> None:
    """Write README.md of a dataset. Raises ValueError where `folder` is no dataset, or has no complete sequence."""
    write_text(folder / "README.md", card_of(folder))


def card_of(folder: Path) -> str:
    """The text of README.md. The same dataset gives the same text."""
    dataset, found = read_dataset(folder), sequences(folder)
    size = _Size.of(found)
    names = [path.name for path in found]
    title = f"{dataset.preset} by pilsim"
    scenario = dataset.scenario
    body = BODY.format(
        people=scenario.get("people", "Several"),
        world=scenario.get("world", "a world"),
        robots=len(size.moving),
        fixed=len(size.fixed),
        sequences=len(names),
        frames=size.frames,
        rate=round(size.rate, 6),
        images=size.images,
        names=f"`{names[0]}`" if len(names) == 1 else f"`{names[0]}` to `{names[-1]}`",
        first=names[0],
    )
    return "\n".join(["---", *_front(title, size.images, _tables(found)), "---", "", f"# {title}", *body.splitlines(), ""])


def _tables(found: Iterable[Path]) -> dict[str, list[str]]:
    """Configuration on the hub → its files, as paths in the dataset."""
    files = {path.name: read_json(path / "manifest.json")["files"] for path in found}
    paths = {config: [f"{name}/{file}" for name, there in files.items() if file in there] for config, file in TABLES.items()}
    return {config: listed for config, listed in paths.items() if listed}


def _front(title: str, images: int, tables: dict[str, list[str]]) -> list[str]:
    """Lines of YAML. Strings are quoted as in JSON, which is valid YAML."""
    lines = [f"pretty_name: {json.dumps(title)}", f"license: {LICENSE}", "annotations_creators:", "- machine-generated", "task_categories:"]
    lines += [f"- {task}" for task in TASKS]
    lines += ["size_categories:", f"- {json.dumps(size_of(images))}", "tags:", *(f"- {tag}" for tag in TAGS), "configs:"]
    for config, paths in tables.items():
        lines += [f"- config_name: {config}", "  data_files:", "  - split: train", "    path:"]
        lines += [f"    - {json.dumps(path)}" for path in paths]
    return lines


def size_of(images: int) -> str:
    """The size category of the hub for a number of images."""
    return next((name for limit, name in SIZES if images < limit), "n>10M")
