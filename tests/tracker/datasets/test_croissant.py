"""Croissant metadata validated by mlcroissant, and the front matter of the dataset card."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tracker.datasets.croissant import describe, write_croissant
from tracker.datasets.dataset_card import card_of, size_of, write_card
from tracker.io.json_files import read_json
from tracker.sequence.schema import BOXES, CAMERAS, DETECTIONS, JOINTS, KEYPOINTS, ODOMETRY, ROBOT_DETECTIONS, ROBOTS, people_columns
from tracker.sequence.truth_tables import read_boxes

NAMES = ["pilsun-00000", "pilsun-00001"]


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Two sequences with other seeds."""
    folder = tmp_path / "set"
    folder.mkdir()
    for seed, name in enumerate(NAMES):
        sequences.write(folder / name, seed)
    content = {"schema": 1, "preset": "pilsun", "scenario": {"world": "quarry", "people": 2}, "views": 0, "form": {}, "sequences": NAMES}
    (folder / "dataset.json").write_text(json.dumps(content))
    return folder


def test_mlcroissant_validates_and_reads_records(dataset: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    write_croissant(dataset)
    found = mlcroissant.Dataset(jsonld=str(dataset / "croissant.json"))
    assert not found.metadata.ctx.issues.errors
    warnings = list(found.metadata.ctx.issues.warnings)
    # A date would make two runs differ.
    assert all("datePublished" in str(warning) for warning in warnings), warnings
    records = list(found.records("boxes"))
    expected = []
    for name in NAMES:
        for (frame, camera), boxes in read_boxes(dataset / name).items():
            for k, person in enumerate(boxes.person.tolist()):
                expected.append((name, frame, camera, person, *boxes.seen[k], boxes.visible[k]))
    fields = ("sequence", "frame", "camera", "person", "left", "top", "right", "bottom", "visible")
    assert len(records) == len(expected) == 2 * 3 * 2 * 2
    for record, wanted in zip(records, expected, strict=True):
        got = [record[f"boxes/{name}"] for name in fields]
        assert tuple(v.decode() if isinstance(v, bytes) else v for v in got) == wanted
    assert [r["people/person"] for r in found.records("people")] == [4, 9] * 6
    images = list(found.records("images"))
    assert len(images) == 2 * 2 * sequences.FRAMES
    assert np.asarray(images[0]["images/image"]).shape == (32, 64, 3)
    assert (images[0]["images/camera"], images[1]["images/frame"]) == (b"robot_0_camera", 1)
    for name in ("odometry", "detections", "companions", "robots", "cameras", "keypoints", "joints", "instances"):
        assert list(found.records(name))


def test_checksums_equal_those_of_the_manifests(dataset: Path) -> None:
    write_croissant(dataset)
    text = (dataset / "croissant.json").read_text()
    write_croissant(dataset)
    assert (dataset / "croissant.json").read_text() == text
    content = json.loads(text)
    assert content["conformsTo"] == "http://mlcommons.org/croissant/1.0"
    objects = {entry["@id"]: entry for entry in content["distribution"] if entry["@type"] == "cr:FileObject"}
    for name in NAMES:
        manifest = read_json(dataset / name / "manifest.json")["files"]
        assert objects[f"{name}/truth/boxes.csv"]["sha256"] == manifest["truth/boxes.csv"]["sha256"]
        assert f"{name}/manifest.json" in objects


def test_metadata_of_a_single_sequence(tmp_path: Path) -> None:
    sequences.write(tmp_path / "one")
    write_croissant(tmp_path / "one")
    mlcroissant = pytest.importorskip("mlcroissant")
    records = list(mlcroissant.Dataset(jsonld=str(tmp_path / "one" / "croissant.json")).records("boxes"))
    assert len(records) == 12
    assert "boxes/sequence" not in records[0]


def test_every_column_is_described() -> None:
    for columns in (ODOMETRY, DETECTIONS, ROBOT_DETECTIONS, ROBOTS, BOXES, CAMERAS, KEYPOINTS, JOINTS, people_columns(["robot_0_camera", "view-1"])):
        for column in columns:
            assert len(describe(column)) > 2, column


def test_front_matter_of_the_card(dataset: Path) -> None:
    yaml = pytest.importorskip("yaml")
    write_card(dataset)
    text = (dataset / "README.md").read_text()
    assert text == card_of(dataset)
    _, front, body = text.split("---\n", 2)
    content = yaml.safe_load(front)
    assert content["pretty_name"] == "pilsun by pilsim"
    assert content["annotations_creators"] == ["machine-generated"]
    assert content["size_categories"] == ["n<1K"]
    assert content["license"] == "apache-2.0"
    assert content["task_categories"]
    for config in content["configs"]:
        for path in config["data_files"][0]["path"]:
            assert (dataset / path).is_file(), path
    assert "quarry" in body
    assert "6 frames in all at 6 frames/s and 12 images" in body


def test_both_files_name_the_licence_of_a_place(dataset: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    (dataset / NAMES[0] / "place.toml").write_text('source = "site.glb"\nlicence = "CC BY 4.0"\n')
    write_croissant(dataset)
    assert json.loads((dataset / "croissant.json").read_text())["license"] == "other"
    assert "license: other" in card_of(dataset)
    assert not mlcroissant.Dataset(jsonld=str(dataset / "croissant.json")).metadata.ctx.issues.errors


def test_cameras_of_robots_and_fixed_ones_are_told_apart(dataset: Path) -> None:
    assert "robots with panoramic cameras drive among them (2), and fixed pinhole cameras\nlook on (0)" in card_of(dataset)
    path = dataset / NAMES[1] / "calibration.json"
    calibration = read_json(path)
    for camera in calibration["cameras"].values():
        camera["model"] = "fisheye"
    calibration["cameras"]["View_001"] = {"model": "tsai", "robot": "View_001"}
    path.write_text(json.dumps(calibration))
    assert "robots with cameras drive among them (2), and fixed pinhole cameras\nlook on (1)" in card_of(dataset)


@pytest.mark.parametrize(("images", "name"), [(0, "n<1K"), (999, "n<1K"), (1000, "1K<n<10K"), (99_999, "10K<n<100K"), (10**9, "n>10M")])
def test_size_categories(images: int, name: str) -> None:
    assert size_of(images) == name
