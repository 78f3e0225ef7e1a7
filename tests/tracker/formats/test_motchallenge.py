"""MOTChallenge export: TrackEval reads and scores it, and its values equal the sequence."""

import configparser
import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, PEOPLE, RATE
from tracker.detections.boxes import detections_from_boxes
from tracker.formats.motchallenge import write_mot17
from tracker.io.mot15 import Mot15Rows, read_mot15, rows_from_tracks, write_mot15
from tracker.metrics.evaluation import evaluate, evaluate_files
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes

Exported = Callable[[str], Path]
VIEWS = ("robot_0_camera", "view_0", "view_1", "view_2")


def scored(root: Path, era: str, tracker: Path) -> dict[str, Any]:
    """TrackEval's numbers by its own program over a folder of results."""
    with contextlib.redirect_stdout(io.StringIO()):
        trackeval = pytest.importorskip("trackeval")
        quiet = {"PRINT_CONFIG": False, "PRINT_RESULTS": False, "OUTPUT_SUMMARY": False, "OUTPUT_DETAILED": False, "PLOT_CURVES": False}
        evaluator = trackeval.Evaluator(quiet | {"TIME_PROGRESS": False, "BREAK_ON_ERROR": True})
        data = {"GT_FOLDER": str(root), "TRACKERS_FOLDER": str(tracker), "BENCHMARK": era, "SPLIT_TO_EVAL": "train", "PRINT_CONFIG": False}
        metrics = [trackeval.metrics.HOTA(), trackeval.metrics.CLEAR({"PRINT_CONFIG": False}), trackeval.metrics.Identity({"PRINT_CONFIG": False})]
        results, _ = evaluator.evaluate([trackeval.datasets.MotChallenge2DBox(data)], metrics)
    return results["MotChallenge2DBox"]["mine"]


def mot17(path: Path) -> Mot15Rows:
    """The rows of a truth file of MOT17, with the visibility as confidence."""
    table = np.loadtxt(path, delimiter=",", ndmin=2)
    assert (table[:, 6:8] == 1).all()
    return Mot15Rows(table[:, 0], table[:, 1], table[:, 2:6], table[:, 8], np.full((len(table), 3), -1.0))


def submit(tracker: Path, era: str, name: str, rows: Mot15Rows) -> None:
    folder = tracker / f"{era}-train" / "mine" / "data"
    folder.mkdir(parents=True, exist_ok=True)
    write_mot15(folder / f"{name}.txt", rows)


@pytest.mark.parametrize("era", ["MOT15", "MOT17"])
def test_trackeval_gives_the_truth_full_score(exported: Exported, tmp_path: Path, era: str) -> None:
    root = exported(era.lower())
    for view in VIEWS:
        path = root / f"{era}-train" / f"plaza-{view}" / "gt" / "gt.txt"
        truth = mot17(path) if era == "MOT17" else read_mot15(path)
        n = len(truth)
        submit(tmp_path, era, f"plaza-{view}", Mot15Rows(truth.frame, truth.id, truth.box, np.ones(n), np.full((n, 3), -1.0)))
    found = scored(root, era, tmp_path)
    assert set(found) == {f"plaza-{view}" for view in VIEWS} | {"COMBINED_SEQ"}
    total = found["COMBINED_SEQ"]["pedestrian"]
    assert total["CLEAR"]["MOTA"] == 1
    assert total["Identity"]["IDF1"] == 1
    assert_allclose(total["HOTA"]["HOTA"], 1)
    assert total["CLEAR"]["CLR_TP"] > 50


def test_trackeval_and_score_agree_on_a_bad_tracker(exported: Exported, tmp_path: Path) -> None:
    root, rng = exported("mot17"), np.random.default_rng(5)
    for view in VIEWS:
        truth = mot17(root / "MOT17-train" / f"plaza-{view}" / "gt" / "gt.txt")
        kept = rng.random(len(truth)) < 0.8
        n = int(kept.sum())
        box = truth.box[kept] + rng.normal(0, 0.5, (n, 4)) * [1, 1, 0, 0]
        # Somebody is called by another name in the second half.
        ids = truth.id[kept] + 1000 * ((truth.frame[kept] > FRAMES // 2) & (truth.id[kept] == PEOPLE[0]))
        submit(tmp_path, "MOT17", f"plaza-{view}", Mot15Rows(truth.frame[kept], ids, box, np.ones(n), np.full((n, 3), -1.0)))
    found = scored(root, "MOT17", tmp_path)
    for view in VIEWS[1:]:
        gt = mot17(root / "MOT17-train" / f"plaza-{view}" / "gt" / "gt.txt")
        n = len(gt)
        write_mot15(tmp_path / "gt.txt", Mot15Rows(gt.frame, gt.id, gt.box, np.ones(n), np.full((n, 3), -1.0)))
        ours = evaluate_files(tmp_path / "gt.txt", tmp_path / "MOT17-train" / "mine" / "data" / f"plaza-{view}.txt", 0.5)["targets"]
        theirs = found[f"plaza-{view}"]["pedestrian"]
        assert_allclose([ours["mota"], ours["idf1"]], [theirs["CLEAR"]["MOTA"], theirs["Identity"]["IDF1"]], atol=1e-12)


def test_truth_equals_the_sequence_counted_from_one(sequence: Path, exported: Exported) -> None:
    boxes = read_boxes(sequence)
    for view in VIEWS:
        info = configparser.ConfigParser()
        info.read(exported("mot17") / "MOT17-train" / f"plaza-{view}" / "seqinfo.ini")
        found = info["Sequence"]
        assert (found["name"], float(found["frameRate"]), int(found["seqLength"])) == (f"plaza-{view}", RATE, FRAMES)
        new = mot17(exported("mot17") / "MOT17-train" / f"plaza-{view}" / "gt" / "gt.txt")
        old = read_mot15(exported("mot15") / "MOT15-train" / f"plaza-{view}" / "gt" / "gt.txt")
        assert_array_equal(new.box, old.box)
        for frame in range(FRAMES):
            true, rows = boxes[frame, view], new.frame == frame + 1
            assert_array_equal(new.id[rows], true.person)
            assert_array_equal(new.box[rows, :2] - 1, true.full[:, :2])
            assert_array_equal(new.box[rows, :2] - 1 + new.box[rows, 2:], true.full[:, 2:])
            assert_allclose(new.confidence[rows], true.visible)


def test_images_are_copied_byte_for_byte(sequence: Path, exported: Exported) -> None:
    for view in VIEWS:
        for frame in range(FRAMES):
            old = sequence / "images" / view / f"{frame:06d}.jpg"
            assert (exported("mot17") / "MOT17-train" / f"plaza-{view}" / "img1" / f"{frame + 1:06d}.jpg").read_bytes() == old.read_bytes()


def test_detections_have_the_directions_of_the_sequence(sequence: Path, exported: Exported) -> None:
    source = read_sequence(sequence)
    for tick in source.ticks:
        for view in tick.views[1:]:
            rows = read_mot15(exported("mot17") / "MOT17-train" / f"plaza-{view.camera}" / "det" / "det.txt")
            mine = rows.frame == tick.index + 1
            # The camera's first pixel has its centre at 0; here the image's edge is at 1.
            box = rows.box[mine] - [1.5, 1.5, 0, 0]
            found = detections_from_boxes(source.setup.mounts[view.camera].camera, box, rows.confidence[mine])
            assert_allclose(found.bearing, view.detections.bearing, atol=1e-9)
            assert_allclose(found.extent, view.detections.extent, atol=1e-9)
            assert_array_equal(rows.id, -1)


def test_ground_positions_score_as_the_sequence(sequence: Path, exported: Exported, tmp_path: Path) -> None:
    """`score --truth MOT15-3D/…/gt.txt` and `score SEQUENCE RESULTS` are the same numbers."""
    source, rng = read_sequence(sequence), np.random.default_rng(2)
    tracks = {}
    for truth in source.truth or ():
        kept = rng.random(len(truth.person_id)) < 0.8
        tracks[truth.index] = truth.person_id[kept], truth.feet[kept] + rng.normal(0, 0.2, (kept.sum(), 3)) * [1, 1, 0]
    assert sum(len(ids) for ids, _ in tracks.values()) < sum(len(t.person_id) for t in source.truth or ())
    robots = {"robot_0": [t.T_world_robot["robot_0"] for t in source.truth or ()]}
    results = Results(FRAMES, tracks, robots, {"robot_0": [np.eye(6)] * FRAMES}, {})
    write_mot15(tmp_path / "mine.txt", rows_from_tracks({k + 1: track for k, track in tracks.items()}))
    ours = evaluate(source, results)["targets"]
    from_files = evaluate_files(exported("mot15") / "MOT15-3D" / "plaza" / "gt" / "gt.txt", tmp_path / "mine.txt", None)["targets"]
    assert ours.keys() == from_files.keys()
    for name, value in ours.items():
        # Files hold an exact 0 as 1e-9 m.
        assert_allclose(value, from_files[name], atol=1e-6)


def test_rows_are_written_by_frame_then_id(tmp_path: Path) -> None:
    edges = np.array([[0.0, 1, 2, 4], [4, 5, 10, 12], [8, 9, 18, 20]])
    write_mot17(tmp_path / "gt.txt", np.array([2, 1, 1]), Boxes(np.array([1, 9, 4]), edges, edges, np.array([0.25, 1, 0]), np.ones(3)))
    assert (tmp_path / "gt.txt").read_text() == "1,4,9,10,10,11,1,1,0\n1,9,5,6,6,7,1,1,1\n2,1,1,2,2,3,1,1,0.25\n"
