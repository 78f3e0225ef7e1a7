"""The command `pilsim predict`: twins of the second half of a recording beside its real boxes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sim.cli.main import main
from sim.confidence_intervals import bounds_of, one_more_interval
from sim.prediction import PredictionPlan, fit_views, open_halves, predict, twin
from sim.stress.tracker_under_test import TrackerUnderTest
from tests.tracker.recordings.walked_room import walked_room
from tests.worlds.places.samples import write_house
from tracker.formats.recording_export import write_recording
from tracker.formats.source_options import SourceOptions

pytestmark = pytest.mark.command


def command(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["pilsim", *map(str, words)])
    main()


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder = tmp_path_factory.mktemp("predict") / "room"
    folder.mkdir()
    write_recording(folder, walked_room(people=4, frames=100, seed=2))
    return folder


def test_scores_stand_beside_the_real_ones(room, tmp_path, monkeypatch, capsys):
    out = tmp_path / "prediction.json"
    command(monkeypatch, "predict", room, "--fit", "0:70", "--seeds", 2, "--beside", "independent", "--n-scan", 0, "--out", out)
    said = capsys.readouterr().out
    assert "frames 70:100" in said
    assert "real" in said
    content = json.loads(out.read_text())
    assert [content["fit_frames"], content["frames"]] == [[0, 70], [70, 100]]
    assert set(content["predicted"]) == {"fitted", "independent"}
    fitted, real = content["predicted"]["fitted"], content["real"]
    assert fitted["figures"]["truths"]["mean"] == real["figures"]["truths"] > 0
    for figures in fitted["runs"]:
        assert np.isclose(figures["mota"], 1 - (figures["misses"] + figures["false_positives"] + figures["switches"]) / figures["truths"])
    # Causes add up to the counts of the score.
    assert sum(real["causes"]["misses"].values()) == real["figures"]["misses"]
    assert sum(one["mean"] for one in fitted["causes"]["false positives"].values()) == pytest.approx(fitted["figures"]["false_positives"]["mean"])
    assert content["command"] == f"pilsim predict {room} --fit 0:70 --beside independent --seeds 2 --n-scan 0.0"
    command(monkeypatch, "report", out)
    assert "predicted less real" in (tmp_path / "prediction.html").read_text()
    assert (tmp_path / "prediction-report" / "misses.png").is_file()


def test_printed_json_is_the_file(room, tmp_path, monkeypatch, capsys):
    words = ("predict", room, "--fit", "0:90", "--seeds", 1, "--n-scan", 0)
    command(monkeypatch, *words, "--json", "--out", tmp_path / "prediction.json")
    said = capsys.readouterr()
    assert said.out == (tmp_path / "prediction.json").read_text()
    assert not said.err


def test_twins_have_the_true_people_and_the_errors_of_each_view(room):
    halves = open_halves(room, SourceOptions(), (0, 70))
    # One view misses half of what it sees; its model alone says so.
    boxes = halves.fitted.recording.detections["C1"]
    poor = {frame: (box[::2], sure[::2]) for frame, (box, sure) in boxes.items()}
    fitted = replace(halves.fitted, recording=halves.fitted.recording.with_detections({"C1": poor}))
    made = twin(halves.tried, fit_views(fitted, room), 1)
    count = {name: sum(len(box) for box, _ in by_frame.values()) for name, by_frame in made.detections.items()}
    real = {name: sum(len(box) for box, _ in by_frame.values()) for name, by_frame in halves.tried.recording.detections.items()}
    assert count["C1"] < 0.75 * real["C1"]
    assert all(abs(count[name] - real[name]) < 0.25 * real[name] for name in ("C2", "C3", "C4"))
    assert made.truth is halves.tried.recording.truth
    again = twin(halves.tried, fit_views(fitted, room), 1)
    for name, by_frame in made.detections.items():
        assert all(np.array_equal(box, again.detections[name][frame][0]) for frame, (box, _) in by_frame.items())


def test_a_place_is_predicted_before_there_is_a_recording(tmp_path, monkeypatch, capsys):
    place = write_house(tmp_path / "house.glb")
    words = ("--world", place, "--people", 3, "--robots", 1, "--fixed-cameras", 1, "--frames", "0:6", "--seeds", 2, "--n-scan", 0)
    command(monkeypatch, "predict", *words, "--out", tmp_path / "p.json")
    assert "3 people in frames 0:6 of robot_0_camera, View_001; 2 runs" in capsys.readouterr().out
    content = json.loads((tmp_path / "p.json").read_text())
    first, second = content["predicted"]["independent"]["runs"]
    assert first != second, "each seed has other paths"
    assert first["truths"] > 0
    command(monkeypatch, "report", tmp_path / "p.json")
    assert "house.glb" in (tmp_path / "p.html").read_text()


@pytest.mark.soak
def test_workers_change_nothing(room):
    from sim.parallel.pool import Pool

    plan = PredictionPlan(room, SourceOptions(), TrackerUnderTest(options={"n_scan": 0.0}), fit_frames=(0, 70), seeds=(0, 1))
    assert predict(plan).to_dict() == predict(plan, Pool(2)).to_dict()


def test_intervals_are_of_one_more_run():
    found = one_more_interval([0.8, 0.9, float("nan")], bounds_of("idf1"))
    # t of one degree of freedom is 12.706; s is 0.0707.
    assert (found.mean, found.low, found.high) == pytest.approx((0.85, 0.0, 1.0))
    assert one_more_interval([0.8, 0.9], bounds_of("mota")).low == pytest.approx(0.85 - 12.706 * 0.070711 * np.sqrt(1.5), abs=1e-3)
    assert one_more_interval([3.0]).low is None
