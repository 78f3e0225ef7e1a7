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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit-detector", "ROOM", "--out", "a.txt"], "--out is a.txt, needs a name that ends in .json"),
        (["fit-detector", "ROOM", "--frames", "0:4", "--out", "a.json"], "too little truth"),
        (["fit-detector", "nowhere", "--out", "a.json"], "nowhere: no such folder"),
        (["demo", "--detector-model", "yolo", "--out", "d"], "detector model is 'yolo', needs independent, a file, or one of"),
        (["generate", "pilsun", "--detector-model", "fairmot", "--misses", "0.2", "--out", "d"], "--misses is of the independent detector"),
        (["stress", "--sweep", "misses", "--detector-model", "fairmot", "--out", "d"], "--sweep misses varies the independent detector"),
        (["stress", "--recording", "ROOM", "--detector-model", "fairmot", "--out", "d"], "--recording has boxes of its own"),
    ],
)
def test_bad_input_is_one_line(words, message, room, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        command(monkeypatch, *[room if word == "ROOM" else word for word in words])
    assert ended.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not list(tmp_path.iterdir())
