"""All exports: descriptions of columns, atomic writing, and datasets."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.tracker import sequences
from tests.tracker.formats import scene
from tracker.formats.exporting import ExportOptions, export
from tracker.formats.table import EXPORTS as FORMATS

SUM = "its SHA-256 is not the manifest's"


@pytest.fixture
def dataset(sequence: Path, tmp_path: Path) -> Path:
    """Two sequences; a third is not whole yet."""
    folder = tmp_path / "set"
    for name in ("set-00000", "set-00001"):
        shutil.copytree(sequence, folder / name)
    content = {"schema": 1, "preset": "pilsun", "scenario": {}, "views": 1, "form": {}, "sequences": ["set-00000", "set-00001", "set-00002"]}
    (folder / "dataset.json").write_text(json.dumps(content))
    return folder


def test_a_dataset_is_exported_sequence_by_sequence(dataset: Path, tmp_path: Path) -> None:
    seen: list[tuple[str, int]] = []

    def progress(frames, name):  # type: ignore[no-untyped-def]
        for k in frames:
            seen.append((name, k))
            yield k

    out = tmp_path / "out"
    assert [p.name for p in export(dataset, "mot17", out, progress)] == ["set-00000", "set-00001"]
    assert seen == [(name, k) for name in ("set-00000", "set-00001") for k in range(scene.FRAMES)]
    assert "set-00000, set-00001" in (out / "README.md").read_text()
    assert {path.name.split("-view")[0].split("-robot")[0] for path in (out / "MOT17-train").iterdir()} == {"set-00000", "set-00001"}
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("form", FORMATS)
def test_an_export_describes_its_columns(exported: Callable[[str], Path], form: str) -> None:
    readme = (exported(form) / "README.md").read_text()
    assert "plaza" in readme
    assert any(word in readme for word in ("[px]", "metres"))
    assert "from 0" in readme or "from 1" in readme


@pytest.mark.parametrize("form", FORMATS)
def test_same_sequence_gives_same_bytes(sequence: Path, exported: Callable[[str], Path], tmp_path: Path, form: str) -> None:
    before, again = exported(form), tmp_path / "again"
    export(sequence, form, again)
    files = sorted(p.relative_to(before) for p in before.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(again) for p in again.rglob("*") if p.is_file())
    assert all((before / f).read_bytes() == (again / f).read_bytes() for f in files)


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "tum"])
def test_damaged_image_leaves_no_export(sequence: Path, tmp_path: Path, form: str) -> None:
    folder = tmp_path / "in" / "plaza"
    shutil.copytree(sequence, folder)
    camera = "robot_0_camera" if form in ("jrdb", "euroc", "kitti") else "view_0"
    image = folder / "images" / camera / "000003.jpg"
    data = bytearray(image.read_bytes())
    data[len(data) // 2] ^= 1
    image.write_bytes(bytes(data))
    with pytest.raises(ValueError, match=rf"{camera}/000003.jpg: {SUM}"):
        export(folder, form, tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["in"]


@pytest.mark.parametrize("form", ["pets", "wildtrack"])
def test_missing_fixed_cameras_are_reported_with_advice(tmp_path: Path, form: str) -> None:
    sequences.write(tmp_path / "in")
    with pytest.raises(ValueError, match=rf"in: has no fixed pinhole camera, which {form} needs; generate .* with some .--views 4."):
        export(tmp_path / "in", form, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_invalid_exports_are_refused(sequence: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="format is 'nuscenes', needs one of recording, wildtrack"):
        export(sequence, "nuscenes", tmp_path / "out")
    with pytest.raises(ValueError, match="faces is set for kitti, needs euroc"):
        export(sequence, "kitti", tmp_path / "out", options=ExportOptions(faces=True))
    with pytest.raises(ValueError, match="epoch is -1 s, needs 0 to 2146483648"):
        export(sequence, "euroc", tmp_path / "out", options=ExportOptions(epoch=-1))
    with pytest.raises(ValueError, match="neither a sequence"):
        export(tmp_path, "tum", tmp_path / "out")
    with pytest.raises(ValueError, match="needs a place outside it"):
        export(sequence, "tum", sequence / "out")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("x")
    with pytest.raises(ValueError, match="out: is there already"):
        export(sequence, "tum", tmp_path / "out")
