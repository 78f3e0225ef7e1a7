"""All exports: descriptions of columns, atomic writing, and datasets."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker import sequences
from tests.tracker.formats import scene
from tracker.formats.exporting import ExportOptions, export
from tracker.formats.opening import open_sequence
from tracker.formats.registry import EXPORTS as FORMATS
from tracker.metrics.evaluation import evaluate
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results
from tracker.types import Sequence

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


FIXED = ("view_0", "view_1", "view_2")
BEARINGS = {"pets": 1e-9, "wildtrack": 2e-4, "aicity": 2e-4}
"""rad: what boxes in whole or decimal pixels lose of a direction, by the formats of fixed cameras."""


@pytest.mark.parametrize("form", BEARINGS)
def test_cameras_truth_and_boxes_are_read_back(sequence: Path, exported: Callable[[str], Path], form: str) -> None:
    """Cameras project alike, people stand where they stood, and boxes have the same directions and confidences."""
    known, again = read_sequence(sequence), open_sequence(exported(form) / "plaza")
    assert (again.setup.period, len(again.ticks)) == (1 / scene.RATE, scene.FRAMES)
    old_names = dict(zip(again.setup.mounts, FIXED, strict=True))
    points = np.random.default_rng(0).uniform([-8, -7, 0], [-2, -1, 2], (200, 3))
    for new, old in old_names.items():
        mounts = known.setup.mounts[old], again.setup.mounts[new]
        starts = known.setup.starts[mounts[0].robot], again.setup.starts[mounts[1].robot]
        poses = [start.T_world_robot @ mount.T_body_camera for start, mount in zip(starts, mounts, strict=True) if start is not None]
        (pixels, inside), (found, _) = (m.camera.pixels_from_bearings(T.inverse().apply(points)) for m, T in zip(mounts, poses, strict=True))
        assert inside.sum() > 100
        assert_allclose(found, pixels, atol=1e-8)
    for was, now in zip(known.truth or (), again.truth or (), strict=True):
        assert_array_equal(now.person_id, was.person_id)
        assert_allclose(now.feet, was.feet, atol=1e-9)
    boxes = 0
    for tick, read in zip(known.ticks, again.ticks, strict=True):
        given = {view.camera: view.detections for view in tick.views}
        assert read.time == pytest.approx(tick.time)
        for view in read.views:
            assert_allclose(view.detections.bearing, given[old_names[view.camera]].bearing, atol=BEARINGS[form])
            assert_allclose(view.detections.extent, given[old_names[view.camera]].extent, atol=2 * BEARINGS[form])
            assert_allclose(view.detections.confidence, given[old_names[view.camera]].confidence, atol=1e-6)
            boxes += len(view.detections)
    assert boxes > 20


@pytest.mark.parametrize("form", BEARINGS)
def test_an_export_scores_as_the_sequence(sequence: Path, exported: Callable[[str], Path], form: str) -> None:
    """A tracker that misses, drifts and swaps gets the same numbers from both."""
    known, again, rng = read_sequence(sequence), open_sequence(exported(form) / "plaza"), np.random.default_rng(9)
    tracks = {}
    for truth in known.truth or ():
        kept = rng.random(len(truth.person_id)) < 0.85
        ids = truth.person_id[kept] + 1000 * (truth.index > 3)
        tracks[truth.index] = ids, truth.feet[kept] + rng.normal(0, 0.3, (kept.sum(), 3)) * [1, 1, 0]

    def scores(source: Sequence) -> dict[str, float]:
        robots = {robot: [t.T_world_robot[robot] for t in source.truth or ()] for robot in source.setup.moving_robots}
        results = Results(scene.FRAMES, tracks, robots, {robot: [np.eye(6)] * scene.FRAMES for robot in robots}, {})  # type: ignore[arg-type]
        return dict(evaluate(source, results)["everybody"])

    ours = scores(known)
    assert ours["misses"] + ours["switches"] > 0
    assert scores(again) == pytest.approx(ours, abs=1e-9)
