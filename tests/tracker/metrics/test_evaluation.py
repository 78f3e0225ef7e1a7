"""Evaluated people, scores of a sequence and of recordings, dead reckoning, and scores of files."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tracker.formats.aicity.files import AiCityObject, AiCityRows, write_ground_truth, write_results
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.evaluation import Flagged, efficiency, evaluate, evaluate_files, table
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results
from tracker.types import LandmarkHistory, Sequence, Start, Truth
from tracker.types.sequence import dead_reckoning
from tracker.types.truth import evaluated_people


def test_a_person_is_evaluated_for_nine_frames_after_being_seen() -> None:
    """At 7 frames/s: person 1 is seen in frame 2 alone, by the second camera; person 2 never enough."""
    truth = tuple(Truth(k, {}, np.array([1, 2]), np.zeros((2, 3)), np.array([[0.0, 0.2 if k == 2 else 0.19], [0.19, 0.1]])) for k in range(15))
    counts = np.array(evaluated_people(truth, 1 / 7))
    assert counts[:, 0].tolist() == [2 <= k <= 11 for k in range(15)]
    assert not counts[:, 1].any()


def test_perfect_results_score_one(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    sequence = read_sequence(tmp_path / "s")
    assert sequence.truth is not None
    tracks = {t.index: (t.person_id + 100, t.feet) for t in sequence.truth}
    poses: dict[str, list[Pose | None]] = {r: [t.T_world_robot[r] for t in sequence.truth] for r in ("robot_0", "robot_1")}
    results = Results(3, tracks, poses, {r: [np.eye(6)] * 3 for r in poses}, {})
    scores = evaluate(sequence, results)
    assert scores["targets"]["mota"] == scores["everybody"]["mota"] == 1
    assert scores["targets"]["truths"] == 3  # the second person is never seen: 0.125 is below 0.2
    assert scores["everybody"]["truths"] == 6
    assert scores["robots"]["ate_m"] == pytest.approx(0, abs=1e-9)
    assert scores["dead_reckoning"]["ate_m"] > 0.01
    assert "MOTA" in table(scores)
    assert efficiency(sequence, results) == {"bound_m": None, "efficiency": None}
    # One landmark that both robots see in all frames: the bound is below what the start and dead reckoning leave, and the truth is perfect.
    seen = {robot: np.array([3]) for robot in poses}
    survey = LandmarkHistory({3: np.array([5.0, 5.0, 1.0])}, np.array([3]), (seen,) * 3)
    found = efficiency(sequence, replace(results, landmark_history=survey))
    assert found["efficiency"] == pytest.approx(0, abs=1e-9)
    assert 0 < (found["bound_m"] or 0) < np.sqrt(0.04)
    scores["robots"] |= {"bound_m": 0.01, "efficiency": 1.25}
    assert "(efficiency) 1.25" in table(scores)


def test_fixed_cameras_are_not_scored_as_robots(tmp_path: Path) -> None:
    """robot_1 is known exactly: there are no results of it, and none are asked for."""
    sequences.write(tmp_path / "s")
    sequence = read_sequence(tmp_path / "s")
    assert sequence.truth is not None
    start = sequence.setup.starts["robot_1"]
    assert start is not None
    starts = sequence.setup.starts | {"robot_1": Start(start.T_world_robot, np.zeros((6, 6)))}
    fixed = replace(sequence, setup=replace(sequence.setup, starts=starts))
    poses: dict[str, list[Pose | None]] = {"robot_0": [t.T_world_robot["robot_0"] for t in sequence.truth]}
    results = Results(3, {}, poses, {"robot_0": [np.eye(6)] * 3}, {})
    assert evaluate(fixed, results)["robots"]["ate_m"] == pytest.approx(0, abs=1e-9)
    with pytest.raises(ValueError, match="robot robot_1 is in the truth, needs estimates too"):
        evaluate(sequence, results)


def test_dead_reckoning_composes_odometry(tmp_path: Path) -> None:
    ticks = sequences.write(tmp_path / "s")
    poses = dead_reckoning(read_sequence(tmp_path / "s"))["robot_1"]
    expected = Pose.planar(1, 2, 0.3)
    for k, tick in enumerate(ticks):
        odometry = tick.views[1].odometry
        expected = expected @ odometry.T_before_now if odometry else expected
        got = poses[k]
        assert got is not None
        np.testing.assert_allclose(got.log(), expected.log(), atol=1e-7)


def test_published_score_of_s2l1(data: Callable[..., Path]) -> None:
    """FORMATS and the data's README: MOTA 85.0, FP 247, FN 420, 31 switches at IoU 0.5."""
    folder = data("pets2009", "S2.L1", "mot15")
    targets = evaluate_files(folder / "gt.txt", folder / "cem_result.txt", 0.5, flagged="counted")["targets"]
    assert round(targets["mota"], 3) == 0.850
    assert [targets[k] for k in ("false_positives", "misses", "switches")] == [247, 420, 31]


@pytest.mark.parametrize(("flagged", "mota", "false"), [(None, 0.0, 4), ("removed", 0.0, 4), ("ignored", 1.0, 0), ("counted", 1.0, 0)])
def test_rows_flagged_0_follow_the_rule_of_trackeval_or_the_chosen_one(tmp_path: Path, flagged: Flagged | None, mota: float, false: int) -> None:
    """A person who counts and one flagged 0, both found: an estimate on a removed row is false."""
    rows = [(f, k, 100 * k + f, 50, 40, 100) for f in range(1, 5) for k in (1, 2)]
    boxes = [",".join(map(str, row)) for row in rows]
    (tmp_path / "r.txt").write_text("".join(f"{box},1,-1,-1,-1\n" for box in boxes))
    (tmp_path / "gt.txt").write_text("".join(f"{box},{row[1] % 2},-1,-1,-1\n" for box, row in zip(boxes, rows, strict=True)))
    found = evaluate_files(tmp_path / "gt.txt", tmp_path / "r.txt", 0.5, flagged=flagged)["targets"]
    assert (found["mota"], found["false_positives"]) == (mota, false)
    # Nine columns: a pedestrian and a reflection (12), on which an estimate is no error.
    nine = "".join(f"{box},{row[1] % 2},{1 if row[1] == 1 else 12},1\n" for box, row in zip(boxes, rows, strict=True))
    (tmp_path / "gt.txt").write_text(nine)
    found = evaluate_files(tmp_path / "gt.txt", tmp_path / "r.txt", 0.5)["targets"]
    assert (found["mota"], found["truths"], found["false_positives"]) == (1.0, 4, 0)


def test_positions_are_needed_to_compare_positions(data: Callable[..., Path]) -> None:
    folder = data("pets2009", "S2.L1", "mot15")
    with pytest.raises(ValueError, match=r"cem_result.txt:1: has no x, y, z; give --iou"):
        evaluate_files(folder / "gt.txt", folder / "cem_result.txt", None)


@pytest.mark.parametrize("lost", ["1,3,5,5,9,9,1,-1,-1,-1", "1,3,5,5,9,9,1,1,1"])
def test_a_row_without_a_position_is_named_by_its_line(tmp_path: Path, lost: str) -> None:
    """Blank and repeated lines count; the second row is of MOT17."""
    (tmp_path / "r.txt").write_text("1,1,-1,-1,-1,-1,1,2,3,0\n" * 2)
    (tmp_path / "gt.txt").write_text("\n\n" + lost + "\n")
    with pytest.raises(ValueError, match=r"gt.txt:3: has no x, y, z; give --iou"):
        evaluate_files(tmp_path / "gt.txt", tmp_path / "r.txt", None)


def test_counted_rows_of_nine_columns_are_pedestrians_alone(tmp_path: Path) -> None:
    """Two pedestrians, one of them flagged 0, and a car, on which an estimate is false."""
    rows = [(k, f"1,{k},{100 * k},50,40,100") for k in (1, 2, 3)]
    (tmp_path / "r.txt").write_text("".join(f"{box},1,-1,-1,-1\n" for _, box in rows))
    (tmp_path / "gt.txt").write_text("".join(f"{box},{int(k == 1)},{3 if k == 3 else 1},1\n" for k, box in rows))
    found = evaluate_files(tmp_path / "gt.txt", tmp_path / "r.txt", 0.5, flagged="counted")["targets"]
    assert (found["truths"], found["misses"], found["false_positives"]) == (2, 0, 1)


def test_too_few_frames_are_an_error(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    with pytest.raises(ValueError, match="results have 2 frames, the truth has 3"):
        evaluate(read_sequence(tmp_path / "s"), Results(2, {}, {}, {}, {}))


def walkers(frames: int = 20) -> dict[int, tuple[Ints, Array]]:
    """Two people, one of whom walks along the diagonal."""
    return {k: (np.array([3, 8]), np.array([[0.1 * k, 0.1 * k, 0.0], [5.0, 5.0, 0.0]])) for k in range(frames)}


def sequence_of(tmp_path: Path, source: str) -> Sequence:
    """A sequence with the truth of `walkers` and no robots, of a kind of source."""
    sequences.write(tmp_path / "s")
    truth = tuple(Truth(k, {}, ids, feet, np.ones((2, 2))) for k, (ids, feet) in walkers().items())
    files = {"annotations_positions": "0"} if source == "WILDTRACK" else {"truth.txt": "0"}
    return replace(read_sequence(tmp_path / "s"), truth=truth, provenance={"source": source, "files": files})


@pytest.mark.parametrize(
    ("source", "kits"),
    [("PETS 2009", set()), ("recording", {"hota_3d"}), ("JRDB", {"hota_3d"}), ("WILDTRACK", {"hota_3d", "ground_detection"})],
)
def test_recordings_have_the_scores_of_their_kits(tmp_path: Path, source: str, kits: set[str]) -> None:
    tracks = {k: (ids, feet + np.array([0.0, 0.3, 0.0])) for k, (ids, feet) in walkers().items() if k}
    scores = evaluate(sequence_of(tmp_path, source), Results(20, tracks, {}, {}, {}))
    assert set(scores) == {"targets", "everybody", "robots", "dead_reckoning"} | kits
    text = table(scores)
    assert ("HOTA in 3-D" in text, "as detections within 0.5 m" in text) == ("hota_3d" in kits, "ground_detection" in kits)
    if "ground_detection" in kits:
        # The kit leaves out the first frame, which has no detection.
        assert scores["ground_detection"] == {
            "moda": 1.0, "modp": pytest.approx(0.4), "precision": 1.0, "recall": 1.0, "truths": 38, "detections": 38, "skipped": 1,
        }  # fmt: skip
        assert scores["targets"]["moda"] == pytest.approx(0.95)
    if kits:
        # Who stands shares a third of the union, at 6 of 19 thresholds; who walks is a box at 45°, which shares about as much.
        assert 0.25 < scores["hota_3d"]["hota"] < 0.32
        assert set(scores["hota_3d"]) == {"hota", "deta", "assa"}


def aicity_files(tmp_path: Path, shift: float, scenes: tuple[int, ...] = (5,)) -> tuple[Path, Path]:
    """Truth of two people and a forklift, and rows that are moved along x by `shift`, sizes and yaw those of the truth."""
    size, yaw = np.array([0.5, 0.7, 1.8]), 0.4
    people = {
        k: [AiCityObject("Person", int(i), feet + np.array([0.0, 0.0, 0.9]), size, np.array([0, 0, yaw])) for i, feet in zip(*of, strict=True)]
        for k, of in walkers(5).items()
    }
    for objects in people.values():
        objects.append(AiCityObject("Forklift", 3, np.array([9.0, 0.0, 1.0]), np.array([1.0, 2.0, 2.0]), np.zeros(3)))
    write_ground_truth(tmp_path / "ground_truth.json", people)
    listed = [(scene, int(one.kind != "Person"), one.id, k, one) for scene in scenes for k, objects in people.items() for one in objects]
    scene_id, category, identity, frame = np.array([row[:4] for row in listed], dtype=np.int64).T
    centre = np.array([row[4].centre + np.array([shift, 0.0, 0.0]) for row in listed])
    rows = AiCityRows(
        scene_id, category, identity, frame, centre, np.array([row[4].size for row in listed]), np.array([row[4].rotation[2] for row in listed])
    )
    write_results(tmp_path / "track1.txt", rows)
    return tmp_path / "ground_truth.json", tmp_path / "track1.txt"


def test_a_result_file_of_aicity_is_scored_on_its_boxes(tmp_path: Path) -> None:
    truth, result = aicity_files(tmp_path, 0.0)
    scores = evaluate_files(truth, result, None)
    assert scores["targets"]["mota"] == scores["hota_3d"]["hota"] == 1
    assert scores["targets"]["truths"] == 10  # people alone
    shifted = evaluate_files(*aicity_files(tmp_path, 0.25), None)
    assert shifted["targets"]["mota"] == 1
    assert 0.2 < shifted["hota_3d"]["hota"] < 0.5
    (tmp_path / "track1.txt").write_text("")
    assert evaluate_files(truth, result, None)["targets"]["misses"] == 10


def test_a_result_file_of_other_scenes_or_frames_is_refused(tmp_path: Path) -> None:
    truth, result = aicity_files(tmp_path, 0.0, (5, 6))
    with pytest.raises(ValueError, match=r"track1.txt: scene_id is 5 and 6, needs one scene"):
        evaluate_files(truth, result, None)
    with pytest.raises(ValueError, match=r"ground_truth.json: --iou is for boxes in images"):
        evaluate_files(truth, result, 0.5)
    result.write_text("5 0 1 77 0 0 1 1 1 1 0\n")
    with pytest.raises(ValueError, match=r"track1.txt: frame_id is 77, needs a frame of ground_truth.json, which has 5"):
        evaluate_files(truth, result, None)
