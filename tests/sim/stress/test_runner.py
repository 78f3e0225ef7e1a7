"""Running trials into a folder: rows, resuming, refused folders, and failing trackers."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sim.parallel.pool import Pool
from sim.scenario import Scenario
from sim.stress.bounds import MEASURES
from sim.stress.runner import ROBOTS, Trial, Worker, empty_row, key_of, row_of, run_trials
from sim.stress.sweeps import Case
from sim.stress.tracker_under_test import TrackerUnderTest
from tests.tracker.person_detector.blob_network import write_blob_network
from tracker.io.file_lock import file_lock
from tracker.person_detector.network import PersonNetwork

SCENARIO = Scenario(seed=1005, robots=1, people=3, frames=4, width=256)


def trial(folder: Path, tracker: str = "", **changes: Any) -> Trial:
    function = f"tests.sim.sample_trackers:{tracker}" if tracker else ""
    return Trial(Case("misses/0", "misses", "misses", 0.1, replace(SCENARIO, **changes)), TrackerUnderTest(function), folder, rendered=False)


def test_a_row_has_all_fields_and_is_json(tmp_path: Path) -> None:
    row = row_of(trial(tmp_path))
    assert row["error"] is None
    assert json.loads(json.dumps(row)) == row
    assert set(row) == set(empty_row(trial(tmp_path)))
    names = ("mota", "mota_all", "idf1", "hota", "motp_m", "false_positives", "misses", "switches", "truths", "ate_m", "dead_reckoning_m")
    assert set(row["scores"]) == {*names, *ROBOTS, *MEASURES, "efficiency"}
    assert row["scores"]["efficiency"] == pytest.approx(row["scores"]["ate_m"] / row["limits"]["ate_bound_m"])
    assert row["limits"]["visible_recall"] >= row["scores"]["mota_all"]
    assert row["limits"]["target_bound_m"] < row["scores"]["motp_m"]
    for moment in row["moments"]:
        for picture in moment["pictures"]:
            assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")


@pytest.mark.command
def test_people_are_found_in_the_rendered_panoramas(tmp_path: Path) -> None:
    """The network finds blobs, and the row names its file. A run without it is another one."""
    model = write_blob_network(tmp_path / "m.onnx")
    plain = replace(trial(tmp_path, frames=2), rendered=True)
    pixels = replace(plain, pixels=True, model=str(model))
    row = row_of(pixels)
    assert row["error"] is None
    assert row["detector"] == f"pixels {PersonNetwork(model).checksum[:12]}"
    assert row["scores"]["misses"] > 0.5 * row["scores"]["truths"]
    (tmp_path / "results.jsonl").write_text(json.dumps(row) + "\n")
    with pytest.raises(ValueError, match="detector"):
        run_trials([plain], tmp_path, "", progress=iter)
    without = row_of(replace(pixels, rendered=False))
    assert without["error"] == "ValueError: --detector pixels needs rendered panoramas"


def test_a_tracker_that_raises_is_a_row(tmp_path: Path) -> None:
    row = row_of(trial(tmp_path, "raising"))
    assert row["error"] == "ZeroDivisionError: nobody is there"
    assert row["scores"] is None


def test_a_tracker_that_hangs_is_killed(tmp_path: Path) -> None:
    worker = Worker(limit=1.0)
    row = worker.row(trial(tmp_path, "hanging"))
    assert row["error"] == "TimeoutError: took more than 1 s and was ended"
    assert 0.9 < row["seconds"] < 5.0
    worker.close()


def rows_of(folder: Path, *trials: Trial) -> list[dict[str, Any]]:
    out = []
    for one in trials:
        row = empty_row(one)
        row |= {"scores": {"mota": 0.5}, "seconds": 1.0}
        out.append(json.loads(json.dumps(row)))
    (folder / "results.jsonl").write_text("".join(json.dumps(row) + "\n" for row in out))
    return out


def test_finished_trials_are_not_run_again(tmp_path: Path) -> None:
    wanted = [trial(tmp_path), trial(tmp_path, seed=1)]
    there = rows_of(tmp_path, *wanted)
    before = (tmp_path / "results.jsonl").read_text()
    (tmp_path / "results.jsonl").write_text(before + '{"schema": 1, "id": "mis')
    made = run_trials(wanted, tmp_path, "pilsim stress")
    assert made == sorted(there, key=key_of)
    assert [json.loads(line) for line in (tmp_path / "results.jsonl").read_text().splitlines()] == made
    assert json.loads((tmp_path / "run.json").read_text())["command"] == "pilsim stress"


def test_another_run_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    rows_of(tmp_path, trial(tmp_path))
    with pytest.raises(ValueError, match=r"holds misses/0 seed 1005 of another run \(scenario\.frames 4 there, 9 asked for\)"):
        run_trials([trial(tmp_path, frames=9)], tmp_path, "pilsim stress")
    with file_lock(tmp_path / ".lock"), pytest.raises(ValueError, match=rf"is being written by another pilsim \(process {os.getpid()} on "):
        run_trials([trial(tmp_path)], tmp_path, "pilsim stress")


def test_folders_with_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text("nonsense\n")
    with pytest.raises(ValueError, match=r"results\.jsonl:1: not JSON"):
        run_trials([], tmp_path, "pilsim stress")
    path.unlink()
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"notes.txt: is a file, needs a folder"):
        run_trials([], tmp_path / "notes.txt", "pilsim stress")
    with pytest.raises(ValueError, match=r"holds notes.txt and no results.jsonl"):
        run_trials([], tmp_path, "pilsim stress")


@pytest.mark.soak
def test_rows_do_not_depend_on_workers_and_machines(tmp_path: Path, cluster: Any) -> None:
    rows = []
    for name, pool in (("one", Pool()), ("two", Pool(2)), ("cluster", Pool(cluster=cluster.scheduler_address))):
        folder = tmp_path / name
        made = run_trials([trial(folder), trial(folder, "raising", seed=4)], folder, "pilsim stress", pool)
        rows.append([{key: value for key, value in row.items() if key != "seconds"} for row in made])
    # In the order of their seeds: 4, 1005.
    assert [row["error"] is None for row in rows[0]] == [False, True]
    assert rows[0] == rows[1] == rows[2]
