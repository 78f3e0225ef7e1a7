"""The whole way: a demo with all that it leaves. The bars are those that a release must hold; those of PETS 2009 are in tracker/mht."""

import json
from pathlib import Path

import cv2
import pytest

from tests.commands import pilsim
from tests.tracker.person_detector.blob_network import write_blob_network

pytestmark = pytest.mark.command


def printed(*words: object, cwd: Path) -> str:
    """What a command prints that succeeds."""
    done = pilsim(*words, cwd=cwd)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.render
def test_a_small_demo_leaves_everything_and_is_reused(tmp_path: Path) -> None:
    arguments = ("demo", "--frames", 4, "--people", 3, "--robots", 2, "--width", 512, "--out", "d")
    printed(*arguments, cwd=tmp_path)
    names = {"scores.json", "contact_sheet.png", "plan.png", "video.mp4", "sequence", "track"}
    assert {p.name for p in (tmp_path / "d").iterdir()} == names
    for name in ("contact_sheet.png", "plan.png"):
        assert cv2.imread(str(tmp_path / "d" / name)) is not None
    video = cv2.VideoCapture(str(tmp_path / "d" / "video.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 4
    stamps = {p: p.stat().st_mtime_ns for p in (tmp_path / "d" / "sequence").rglob("*")}
    (tmp_path / "d" / "plan.png").unlink()
    printed(*arguments, cwd=tmp_path)
    assert (tmp_path / "d" / "plan.png").exists()
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "d" / "sequence").rglob("*")} == stamps
    run = json.loads((tmp_path / "d" / "track" / "run.json").read_text())
    assert run["parameters"]["slam"]["mode"] == "fej"
    # pilsim 0.3.0 wrote the parameters as a text.
    old = {name: value for name, value in run.items() if name != "pilsim"} | {"parameters": "Parameters(slam=SlamParameters(mode='fej'), delay=0)"}
    (tmp_path / "d" / "track" / "run.json").write_text(json.dumps(old, indent=1, sort_keys=True) + "\n")
    assert "d/track: made with other parameters of the tracker or other boxes; tracking anew" in printed(*arguments, cwd=tmp_path)
    assert json.loads((tmp_path / "d" / "track" / "run.json").read_text()) == run
    model = write_blob_network(tmp_path / "m.onnx")
    assert "tracking anew" in printed(*arguments, "--detector", "pixels", "--model", model, cwd=tmp_path)
    assert len(json.loads((tmp_path / "d" / "track" / "run.json").read_text())["model"]) == 64
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "d" / "sequence").rglob("*")} == stamps
    other = pilsim(*arguments, "--seed", 1, cwd=tmp_path)
    assert other.returncode == 2
    assert "d: holds another run (seed 0 there, 1 asked for)" in other.stderr


@pytest.mark.soak
def test_demo(tmp_path: Path) -> None:
    printed("demo", "--frames", 120, "--seed", 21, "--out", "d", cwd=tmp_path)
    scores = json.loads((tmp_path / "d" / "scores.json").read_text())
    assert scores["targets"]["mota"] >= 0.80
    assert scores["robots"]["ate_m"] < 0.5 * scores["dead_reckoning"]["ate_m"]
