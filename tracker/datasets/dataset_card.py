"""The README.md of a dataset: front matter in YAML for the Hugging Face hub, then a description.

https://huggingface.co/docs/hub/datasets-cards
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

from tracker.datasets.croissant import ManifestFiles, tables_of
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.sequence.dataset import read_dataset, sequences
from tracker.sequence.schema import PLACE_FILE

LICENSE = "apache-2.0"
TASKS = ("object-detection", "image-segmentation", "keypoint-detection")
TAGS = ("synthetic", "multi-object-tracking", "multi-camera", "slam", "panoramas", "pedestrians")
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"), (10_000_000, "1M<n<10M"))
TABLES = ("boxes", "keypoints", "people", "robots", "cameras", "detections", "odometry", "imu", "wheels", "stamps")
"""Tables of croissant.json that are configurations on the hub; those that no sequence has are left out."""

BODY = """
People walk through the world `{world}` ({people} a sequence), robots with {carried} drive among them ({robots}), and fixed pinhole cameras
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


def write_card(folder: Path) -> None:
    """Write README.md of a dataset. Raises ValueError where `folder` is no dataset, or has no complete sequence."""
    write_text(folder / "README.md", card_of(folder))


def card_of(folder: Path) -> str:
    """The text of README.md. The same dataset gives the same text."""
    dataset, files, paths = read_dataset(folder), ManifestFiles.of(folder), sequences(folder)
    scenario = dataset.scenario
    calibrations = [read_json(path / "calibration.json") for path in paths]
    images = [sum(name.startswith("images/") for name in found) for found in files.checksums.values()]
    cameras = calibrations[-1]["cameras"]
    # The robot of a fixed camera has the name of the camera.
    carried = [camera for name, camera in cameras.items() if camera["robot"] != name]
    body = BODY.format(
        people=scenario.get("people", "Several"),
        world=scenario.get("world", "a world"),
        robots=len({camera["robot"] for camera in carried}),
        carried="panoramic cameras" if all(camera["model"] == "panorama" for camera in carried) else "cameras",
        fixed=len(cameras) - len(carried),
        sequences=len(paths),
        frames=sum(count // max(1, len(one["cameras"])) for count, one in zip(images, calibrations, strict=True)),
        rate=round(1 / calibrations[-1].get("period", 1.0), 6),
        images=sum(images),
        names=f"`{paths[0].name}`" if len(paths) == 1 else f"`{paths[0].name}` to `{paths[-1].name}`",
        first=paths[0].name,
    )
    file_of = {name: file for name, (file, *_) in tables_of(folder).items()}
    tables = {config: listed for config in TABLES if (listed := files.holding(file_of[config]))}
    title = f"{dataset.preset} by pilsim"
    source = _source(paths[0])
    front = _front(title, sum(images), tables, bool(source))
    return "\n".join(["---", *front, "---", "", f"# {title}", *body.splitlines(), *source, ""])


def _source(sequence: Path) -> list[str]:
    """Lines about the file from which the place was made; none for a world of pilsim."""
    if not (sequence / PLACE_FILE).is_file():
        return []
    place = tomllib.loads((sequence / PLACE_FILE).read_text(encoding="utf-8"))
    licence = f"its licence: {place['licence']}" if place.get("licence") else "its licence is not told (licence=)"
    return ["", f"The place was made of `{Path(str(place.get('source'))).name}`; {licence}. `{sequence.name}/{PLACE_FILE}` has the choices for it."]


def _front(title: str, images: int, tables: dict[str, list[str]], foreign: bool) -> list[str]:
    """Lines of YAML. Strings are quoted as in JSON, which is valid YAML. foreign: whether the place was made from a file with its own licence."""
    licence = "other" if foreign else LICENSE
    lines = [f"pretty_name: {json.dumps(title)}", f"license: {licence}", "annotations_creators:", "- machine-generated", "task_categories:"]
    lines += [f"- {task}" for task in TASKS]
    lines += ["size_categories:", f"- {json.dumps(size_of(images))}", "tags:", *(f"- {tag}" for tag in TAGS), "configs:"]
    for config, paths in tables.items():
        lines += [f"- config_name: {config}", "  data_files:", "  - split: train", "    path:"]
        lines += [f"    - {json.dumps(path)}" for path in paths]
    return lines


def size_of(images: int) -> str:
    """The size category of the hub for a number of images."""
    return next((name for limit, name in SIZES if images < limit), "n>10M")
