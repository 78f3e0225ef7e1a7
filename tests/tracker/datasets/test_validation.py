"""Validation: valid sequences have no faults, each fault is reported, and malicious files need little memory."""

import hashlib
import json
from pathlib import Path

import pytest

from tests.tracker import disc_sequence
from tracker.datasets.validation import validate
from tracker.sequence.dataset import Dataset
from tracker.sequence.manifest import manifest_checksum
from tracker.sequence.writer import ImageForm


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    disc_sequence.write(tmp_path / "s")
    return tmp_path / "s"


def faults(folder: Path) -> list[str]:
    return [f"{fault.file.relative_to(folder).as_posix()}: {fault.reason}" for fault in validate(folder)]


def sealed(folder: Path) -> None:
    """Bring the manifest up to date with what lies there, as somebody who wants a wrong sequence to look right would."""
    manifest = json.loads((folder / "manifest.json").read_text())
    for name in manifest["files"]:
        data = (folder / name).read_bytes()
        manifest["files"][name] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
    manifest["sum"] = manifest_checksum(manifest)
    (folder / "manifest.json").write_text(json.dumps(manifest))


def replaced(folder: Path, name: str, old: str, new: str) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("form", [ImageForm(), ImageForm(png=True, range=True, classes=True, video=True)])
def test_valid_sequence_has_no_faults(tmp_path: Path, form: ImageForm) -> None:
    disc_sequence.write(tmp_path / "s", form)
    assert faults(tmp_path / "s") == []


@pytest.mark.parametrize("name", ["images/View_001/000001.jpg", "instances/robot_0_camera/000002.png", "truth/boxes.csv", "terrain.npz", "README.md"])
def test_changed_truncated_and_missing_files_are_found(folder: Path, name: str) -> None:
    path = folder / name
    data = path.read_bytes()
    path.write_bytes(data[:-50] + bytes([data[-50] ^ 1]) + data[-49:])
    assert faults(folder) == [f"{name}: its SHA-256 is not the manifest's: changed"]
    path.write_bytes(data[:-9])
    assert faults(folder) == [f"{name}: {len(data) - 9} bytes, the manifest says {len(data)}: truncated or changed"]
    path.unlink()
    assert f"{name}: missing, though the manifest names it" in faults(folder)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"pilsim": "test"', '"pilsim": "best"', "manifest.json: its checksum does not match its content: edited by hand"),
        ('"schema": 3', '"schema": 4', "manifest.json: schema is 4, this version reads 2 and 3: a newer pilsim wrote it"),
        ('"schema": 3', '"schema": 1', "manifest.json: schema is 1, this version reads 2 and 3: version 1 has no key points"),
        ('"schema": 3', '"schema": true', "manifest.json: schema is True"),
        ('"odometry.csv"', '"../odometry.csv"', "manifest.json: entry '../odometry.csv' lies outside the folder"),
        ('"odometry.csv"', '"/etc/passwd"', "manifest.json: entry '/etc/passwd' lies outside the folder"),
        ('"odometry.csv"', '"odometry.tsv"', "manifest.json: does not name odometry.csv"),
        ('"bytes": ', '"bytes": NaN, "was": ', "manifest.json: holds NaN, needs finite numbers"),
    ],
)
def test_edited_manifest_is_found(folder: Path, old: str, new: str, said: str) -> None:
    replaced(folder, "manifest.json", old, new)
    assert any(line.startswith(said) for line in faults(folder)), faults(folder)


def test_an_older_schema_is_read(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["sum"]
    (folder / "manifest.json").write_text(json.dumps(manifest | {"schema": 2}))
    assert faults(folder) == []


def test_link_outside_the_folder_is_found(folder: Path, tmp_path: Path) -> None:
    path = folder / "odometry.csv"
    path.rename(tmp_path / "elsewhere.csv")
    path.symlink_to(tmp_path / "elsewhere.csv")
    assert faults(folder) == ["odometry.csv: is a link to outside the folder"]


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("truth/boxes.csv", "0,View_001,1,", "0,View_001,2,", "keypoints.csv: frame 0 of View_001 has other people than boxes.csv"),
        ("truth/keypoints.csv", "1,View_001,1,", "1,View_001,1,2", "keypoints.csv: frame 1 of View_001: person 1 is"),
        ("truth/people.csv", "\n0,2,", "\n0,70000,", "people.csv: frame 0 has an id that is not in 1 to 65535"),
        ("truth/joints.csv", "\n2,1,", "\n2,3,", "joints.csv: frame 2 has other people than people.csv"),
        ("truth/robots.csv", "0,robot_0,0,0,0,", "0,robot_0,nan,0,0,", "robots.csv: line 2: x is nan, needs a finite number"),
        ("companions.csv", "0,robot_0_camera,View_001,-", "0,robot_0_camera,View_001,", "companions.csv: frame 0 of robot_0_camera: View_001 is 803"),
        ("companions.csv", "2,robot_0_camera,View_001,", "2,robot_0_camera,robot_0,", "companions.csv: frame 2 of robot_0_camera: "),
        ("odometry.csv", "1,robot_0,0.1,", "1,robot_0,inf,", "odometry.csv: line 2: x is inf, needs a finite number"),
        ("calibration.json", '"period": ', '"period": Infinity, "was": ', "calibration.json: holds Infinity, needs finite numbers"),
        ("calibration/View_001.xml", 'focal="', 'focal="1', "View_001.xml: differs from the camera in calibration.json"),
        ("calibration/View_001.xml", "<Camera", '<!DOCTYPE a [<!ENTITY b "c">]><Camera', "View_001.xml: line 2: holds a document type or an entity"),
    ],
)
def test_inconsistent_tables_are_found(folder: Path, name: str, old: str, new: str, said: str) -> None:
    replaced(folder, name, old, new)
    sealed(folder)
    found = faults(folder)
    assert any(said in line for line in found), found


def test_box_off_by_one_pixel_is_found(folder: Path) -> None:
    lines = (folder / "truth/boxes.csv").read_text().splitlines()
    cells = lines[1].split(",")
    cells[3] = str(int(cells[3]) + 1)
    (folder / "truth/boxes.csv").write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]) + "\n")
    sealed(folder)
    assert [line for line in faults(folder) if "is not that of the instances" in line]


def test_exchanged_images_are_found(folder: Path) -> None:
    """Boxes that lag the image by a frame."""
    for kind, ending in (("instances", "png"), ("images", "jpg")):
        for k in range(disc_sequence.FRAMES - 1, 0, -1):
            (folder / kind / "View_001" / f"{k:06d}.{ending}").write_bytes((folder / kind / "View_001" / f"{k - 1:06d}.{ending}").read_bytes())
    sealed(folder)
    found = [line for line in faults(folder) if "View_001" in line]
    assert {line.split(":")[1].strip() for line in found} == {"frame 1 of View_001", "frame 2 of View_001"}, found


def test_faults_of_a_dataset(tmp_path: Path) -> None:
    made = Dataset("painted", {"world": "painted", "seed": 0, "frames": disc_sequence.FRAMES}, 1, {}, ("painted-00000", "painted-00001"))
    (tmp_path / "dataset.json").write_text(made.to_json())
    disc_sequence.write(tmp_path / "painted-00000")
    (tmp_path / ".painted-00001.partial").mkdir()
    found = faults(tmp_path)
    assert ".painted-00001.partial: left by a run that is unfinished or was interrupted; generate into this folder again" in found
    assert "painted-00001: this sequence is missing; generate into this folder again" in found
    assert "painted-00000/scenario.json: preset is None, dataset.json says painted" in found
    (tmp_path / "dataset.json").write_text(made.to_json().replace("painted-00001", "../elsewhere"))
    assert faults(tmp_path) == ["dataset.json: sequence is '../elsewhere', needs a name of letters, digits, - and _"]


def test_other_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="neither a sequence"):
        list(validate(tmp_path))
