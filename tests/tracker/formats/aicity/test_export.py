"""AI City: a sequence is exported and read back as the same scene, and results as the file of a submission."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES
from tracker.formats.aicity.export import camera_of, export_results
from tracker.formats.aicity.files import read_ground_truth, read_results
from tracker.formats.aicity.reading import is_aicity, read_aicity
from tracker.formats.exported_sequence import RecordedSequence
from tracker.geometry.cameras import Pinhole, Tsai
from tracker.metrics.evaluation import evaluate
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results, write_results
from tracker.sequence.truth_tables import read_boxes

Exported = Callable[[str], Path]
NOBODY = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


@pytest.fixture(scope="module")
def scene(exported: Exported) -> Path:
    return exported("aicity") / "plaza"


def test_a_scene_is_told_by_its_files(sequence: Path, scene: Path) -> None:
    assert is_aicity(scene)
    assert not is_aicity(sequence)


def test_boxes_of_people_have_one_size_and_face_their_motion(sequence: Path, scene: Path) -> None:
    truth, seen = read_ground_truth(scene / "ground_truth.json"), read_boxes(sequence)
    by_person = {one.id: one for one in truth[FRAMES - 1]}
    assert {one.kind for objects in truth.values() for one in objects} == {"Person"}
    assert_allclose([one.size for one in truth[0]], [[0.6, 0.6, 1.75]] * len(truth[0]))
    # Person 17 walks along −y, person 300 along the diagonal.
    assert by_person[17].rotation[2] == pytest.approx(-np.pi / 2, abs=0.05)
    assert by_person[300].rotation[2] == pytest.approx(np.pi / 4, abs=0.05)
    boxes = seen[0, "view_0"]
    for one in truth[0]:
        k = int(np.flatnonzero(boxes.person == one.id)[0])
        if boxes.visible[k] > 0:
            assert_array_equal(one.visible["view_0"], boxes.seen[k] - [0, 0, 1, 1])


def test_videos_hold_the_images(scene: Path) -> None:
    read = read_aicity(scene)
    assert set(read.images) == {"view_0", "view_1", "view_2"}
    images = [image for image in read.images["view_1"].images(FRAMES, (240, 320)) if image is not None]
    assert [image.shape for image in images] == [(240, 320, 3)] * FRAMES


def test_boxes_are_scored_in_space(sequence: Path, scene: Path) -> None:
    """True positions, moved by 0.3 m: a third of the union at a shift of half the width, a little less where the box is turned."""
    tracks = {t.index: (t.person_id, t.feet + np.array([0.3, 0.0, 0.0])) for t in read_sequence(sequence).truth or ()}
    read = evaluate(read_aicity(scene).sequence(), Results(FRAMES, tracks, {}, {}, {}))
    assert 5 / 19 <= read["hota_3d"]["hota"] <= 6 / 19 + 1e-9


def test_results_become_the_file_of_a_submission(tmp_path: Path) -> None:
    tracks = {0: (np.array([0, 4]), np.array([[1.0, 2.0, 0.0], [5.0, 5.0, 0.5]])), 1: (np.array([4]), np.array([[5.0, 6.0, 0.5]])), 2: NOBODY}
    write_results(tmp_path / "run", Results(3, tracks, {}, {}, {"source": "Warehouse_017"}))
    assert export_results(tmp_path / "run", tmp_path / "out") == 17
    rows = read_results(tmp_path / "out" / "track1.txt")
    assert_array_equal(np.column_stack([rows.scene, rows.category, rows.id, rows.frame]), [[17, 0, 1, 0], [17, 0, 5, 0], [17, 0, 5, 1]])
    assert_allclose(rows.centre, [[1.0, 2.0, 0.875], [5.0, 5.0, 1.375], [5.0, 6.0, 1.375]])
    assert_allclose(rows.yaw, [0.0, 0.0, np.pi / 2], atol=1e-6)
    assert "scene_id: 17." in (tmp_path / "out" / "README.md").read_text()
    with pytest.raises(ValueError, match="out: is there already"):
        export_results(tmp_path / "run", tmp_path / "out")
    with pytest.raises(ValueError, match="scene is -1, needs at least 0"):
        export_results(tmp_path / "run", tmp_path / "below", -1)
    write_results(tmp_path / "nobody", Results(1, {}, {}, {}, {}))
    assert export_results(tmp_path / "nobody", tmp_path / "empty") == 0
    assert (tmp_path / "empty" / "track1.txt").read_text() == ""


def test_only_pinholes_without_distortion_are_held(sequence: Path) -> None:
    recorded = RecordedSequence.open(sequence)
    view = recorded.fixed["view_0"]
    assert isinstance(view.camera, Tsai)
    same = camera_of("view_0", view, recorded).camera
    assert isinstance(same, Pinhole)
    for bent in (replace(view.camera, kappa1=0.001), replace(same, distortion=(0.0, 0.0, 0.001, 0.0, 0.0))):
        with pytest.raises(ValueError, match=r"plaza: view_0 is .*, aicity needs a pinhole camera without distortion"):
            camera_of("view_0", replace(view, camera=bent), recorded)
