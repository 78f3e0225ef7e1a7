"""The command `pilsim fit-detector`, and --detector-model of the commands that simulate."""

import json

import pytest

from sim.cli.main import main
from tests.tracker.recordings.walked_room import walked_room
from tracker.detector_models.model import read_model
from tracker.formats.recording_export import write_recording


def command(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["pilsim", *map(str, words)])
    main()


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit") / "room"
    folder.mkdir()
    write_recording(folder, walked_room(people=5, frames=60, seed=2))
    return folder


@pytest.mark.soak
def test_fit(room, tmp_path, monkeypatch, capsys):
    out, picture = tmp_path / "detector.json", tmp_path / "detector.png"
    command(monkeypatch, "fit-detector", room, "--out", out, "--picture", picture, "--frames", "0:50")
    said = capsys.readouterr().out
    assert "misses.share" in said
    assert "distance from real boxes" in said
    assert "Views agree on other places and statures" in said
    assert read_model(out).made["sources"][0]["frames"] == [0, 50]
    assert picture.read_bytes()[:4] == b"\x89PNG"
    command(monkeypatch, "stress", "--list", "--json", "--sweep", "density/0", "--detector-model", out)
    assert json.loads(json.loads(capsys.readouterr().out)["scenario"]["detector_model"])["name"] == "detector"


@pytest.mark.command
def test_printed_json(room, tmp_path, monkeypatch, capsys):
    command(monkeypatch, "fit-detector", room, room, "--out", tmp_path / "two.json", "--name", "both", "--json")
    content = json.loads(capsys.readouterr().out)
    assert set(content) == {"name", "figures", "counts", "distances"}
    assert content["name"] == read_model(tmp_path / "two.json").name == "both"
    assert content["counts"]["people"] == 10
