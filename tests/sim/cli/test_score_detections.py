"""The command `pilsim score-detections`: recordings, MOT15 files, frames that were searched, and bad input."""

import json

import cv2
import numpy as np
import pytest

from sim.cli.main import main
from tests.tracker.disc_sequence import write as write_sequence
from tests.tracker.recordings.walked_room import walked_room
from tracker.formats.recording_export import write_recording
from tracker.io.mot15 import rows_from_boxes, write_mot15
from tracker.recordings.degradation import projected_boxes
from tracker.sequence.truth_tables import read_boxes


def command(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["pilsim", "score-detections", *map(str, words)])
    main()


def write_boxes(folder, boxes, first=0):
    folder.mkdir(parents=True, exist_ok=True)
    for name, of in boxes.items():
        write_mot15(folder / f"{name}.txt", rows_from_boxes({frame - first + 1: value for frame, value in of.items() if frame >= first}))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A recording, and the boxes of its bodies as they are: those of 2 cameras, with a score of 0.9."""
    folder = tmp_path_factory.mktemp("score")
    recording = walked_room(people=5, frames=40, seed=2)
    (folder / "room").mkdir()
    write_recording(folder / "room", recording)
    exact = projected_boxes(recording)
    boxes = {name: {frame: (box, np.full(len(box), 0.9)) for frame, (box, _) in exact.detections[name].items()} for name in ("C1", "C2")}
    write_boxes(folder / "exact", boxes)
    write_boxes(folder / "later", boxes, 10)
    (folder / "later" / "run.json").write_text(json.dumps({"frames": "10:30"}))
    return folder


def test_exact_boxes(room, tmp_path, monkeypatch, capsys):
    out, plot = tmp_path / "scores.json", tmp_path / "reliability.png"
    command(monkeypatch, "--truth", room / "room", "--result", room / "exact", "--out", out, "--plot", plot, "--min-visible", 0)
    said = capsys.readouterr().out
    assert "AP at IoU 0.5:0.95" in said
    assert "by visible share" in said
    content = json.loads(out.read_text())
    assert content["all"]["images"] == 80
    assert content["all"]["ap50"] == content["all"]["ap50_95"] == content["all"]["moda"] == content["all"]["modp"] == 1
    # All boxes are bodies, and have a score of 0.9.
    assert content["all"]["calibration_error"] == pytest.approx(0.1)
    assert content["all"]["intervals"]["moda"][0] <= content["all"]["moda"] <= content["all"]["intervals"]["moda"][1]
    # The lower edge of a projected body is its near side, half of 0.5 m before its middle.
    assert content["all"]["feet_median_m"] == pytest.approx(0.25, abs=0.02)
    assert set(content["by_camera"]) == {"C1", "C2"}
    assert plot.read_bytes()[:4] == b"\x89PNG"


def test_a_sheet_of_a_sequence(tmp_path, monkeypatch, capsys):
    """One of two people has no box, and one box is nobody's; the sheet has a row of 12 tiles for each kind."""
    write_sequence(tmp_path / "s")
    boxes = {}
    for (frame, name), true in read_boxes(tmp_path / "s").items():
        left, top, right, bottom = true.full[0]
        found = np.array([[left, top, right - left, bottom - top], [40, 2, 8, 16]])
        boxes.setdefault(name, {})[frame] = found, np.array([0.9, 0.8])
    write_boxes(tmp_path / "found", boxes)
    sheet = tmp_path / "sheet.png"
    command(monkeypatch, "--truth", tmp_path / "s", "--result", tmp_path / "found", "--sheet", sheet, "--min-visible", 0)
    assert cv2.imread(str(sheet)).shape == (3 * (144 + 26), 12 * 96 + 8, 3)
    capsys.readouterr()
    mot = tmp_path / "gt.txt"
    mot.write_text("1,1,10,10,20,40,1,-1,-1,-1\n")
    with pytest.raises(SystemExit):
        command(monkeypatch, "--truth", mot, "--result", mot, "--sheet", sheet)
    assert "has no images, which --sheet needs" in capsys.readouterr().err


def test_frames_that_were_searched(room, monkeypatch, capsys):
    """The files of `detect --frames A:B` count from A, and A to B are scored."""
    both = []
    for words in (["--result", room / "later"], ["--result", room / "exact", "--frames", "10:30"]):
        command(monkeypatch, "--truth", room / "room", *words, "--json", "--cameras", "2")
        both.append(json.loads(capsys.readouterr().out))
    assert both[0] == both[1]
    assert both[0]["all"]["images"] == 20


def test_files(tmp_path, monkeypatch, capsys):
    truth, found = tmp_path / "gt.txt", tmp_path / "det.txt"
    truth.write_text("1,1,10,10,20,40,1,-1,-1,-1\n1,2,90,10,20,40,1,-1,-1,-1\n2,1,12,10,20,40,1,-1,-1,-1\n2,3,200,10,20,40,0,-1,-1,-1\n")
    found.write_text("1,-1,10,10,20,40,7,-1,-1,-1\n1,-1,300,10,20,40,3,-1,-1,-1\n2,-1,12,10,20,40,9,-1,-1,-1\n2,-1,200,10,20,40,8,-1,-1,-1\n")
    command(monkeypatch, "--truth", truth, "--result", found, "--json")
    scores = json.loads(capsys.readouterr().out)["all"]
    # Three bodies count; two are found, one box is false, and one is of the body that does not count.
    assert (scores["bodies"], scores["boxes"]) == (3, 3)
    assert scores["moda"] == pytest.approx(1 / 3, abs=1e-4)
    assert scores["best_moda"] == pytest.approx(2 / 3, abs=1e-4)
    assert scores["ap50"] == pytest.approx(67 / 101, abs=1e-4)
    assert scores["calibration_error"] is None
    assert scores["intervals"]["moda"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--truth", "ROOM/room", "--result", "ROOM/room"], "no CAMERA.txt of C1, C2, C3, C4"),
        (["--truth", "ROOM/room", "--result", "nowhere"], "nowhere: no such file or folder"),
        (["--truth", "nowhere", "--result", "ROOM/exact"], "nowhere: no such folder"),
        (["--truth", "ROOM/room", "ROOM/room", "--result", "ROOM/exact"], "--truth names 2 and --result 1"),
        (["--truth", "ROOM/room", "--result", "ROOM/exact", "--frames", "90:"], "needs a first frame below 40"),
        (["--truth", "ROOM/room", "--result", "ROOM/exact", "--cameras", "C3"], "no CAMERA.txt of C3"),
        (["--truth", "ROOM/room", "--result", "ROOM/exact", "--heights", "50:20"], "--heights is '50:20', needs LOW:HIGH px"),
        (["--truth", "ROOM/room", "--result", "ROOM/exact", "--min-visible", "2"], "--min-visible is 2.0, needs 0 to 1"),
        (["--truth", "ROOM/room", "--result", "ROOM/exact", "--plot", "a.jpg"], "--plot is a.jpg, needs a name that ends in .png"),
        (["--truth", "ROOM/exact/C1.txt", "--result", "ROOM/exact/C1.txt", "--cameras", "C1"], "--cameras is for folders"),
    ],
)
def test_bad_input_is_one_line(words, message, room, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        command(monkeypatch, *[word.replace("ROOM", str(room)) for word in words])
    assert ended.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not list(tmp_path.iterdir())
