"""The command as a user meets it: bad input is one line and exit code 2, and nothing is left half-written."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.tracker import sequences
from tests.tracker.formats.mrclam import write_set
from tracker.trajectory import MEASURES

TARGET_KEYS = """mota motp_m motp_percent false_positives misses switches fragments mostly_tracked mostly_lost truths idf1 hota moda modp"""
PILSIM = Path(sys.executable).parent / "pilsim"


def pilsim(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PILSIM, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, check=False, timeout=200)


def refused(*arguments: object, cwd: Path) -> str:
    """Run what must be refused; returns the one line that says why."""
    before = sorted(p.as_posix() for p in cwd.rglob("*"))
    done = pilsim(*arguments, cwd=cwd)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    assert sorted(p.as_posix() for p in cwd.rglob("*")) == before
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--frames", "0"], "frames is 0, needs a whole number in [1, "),
        (["--robots", "0"], "robots is 0, needs a whole number in [1, "),
        (["--people", "-1"], "people is -1"),
        (["--difficulty", "1.5"], "difficulty is 1.5, needs a number in [0, 1]"),
        (["--difficulty", "nan"], "difficulty is nan"),
        (["--world", "atlantis"], "pilsun"),
        (["--width", "1023"], "width is 1023"),
        (["--people", "900"], "people"),
        (["--robots", "60"], "robots"),
    ],
)
def test_bad_scenarios(arguments: list[str], message: str, tmp_path: Path) -> None:
    assert message in refused("demo", *arguments, "--out", "out", cwd=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Expected one of {demo, track, "),
        (["frobnicate"], "Unrecognized options: frobnicate; see pilsim --help"),
        (["demo", "--frames", "abc"], "Error parsing --frames: invalid literal for int() with base 10: 'abc'; see pilsim demo --help"),
        (["generate", "pilsun", "--out", "x", "--frmes", "3"], "Unrecognized options: --frmes, 3 (perhaps --frames); see pilsim generate --help"),
        (["export", "x", "--format", "jpeg", "--out", "y"], "invalid choice 'jpeg' for argument '--format'"),
        (["generate", "pilsun"], "Missing from pilsim generate: --out DIR"),
        (["track", "x", "--out", "y", "--l-c", "4"], "no such folder"),
        (["compare"], "compare needs folders of results, the first as the reference"),
        (["stress", "--world", "mars", "--sweep", "robots/0", "--out", "y"], "--world is 'mars', needs one of campus, forest, "),
        (["stress", "--pets", "nowhere", "--out", "y"], "nowhere: no such folder"),
        (["clique", "x.clq", "--seed", "-1"], "--seed is -1, needs at least 0"),
        (["worlds", "pilsun", "--slip", "inf"], "seconds is inf, needs 0 to 3600"),
    ],
)
def test_what_no_command_knows(arguments: list[str], message: str, tmp_path: Path) -> None:
    assert message in refused(*arguments, cwd=tmp_path)


def test_help_and_version(tmp_path: Path) -> None:
    assert "pilsim" in pilsim("--help", cwd=tmp_path).stdout
    version = pilsim("--version", cwd=tmp_path)
    assert version.returncode == 0
    assert version.stdout.startswith("pilsim 0.")


def test_an_out_that_holds_something_else(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "diary.txt").write_text("dear diary")
    assert "holds something else" in refused("demo", "--out", "out", cwd=tmp_path)
    (tmp_path / "file").write_text("")
    assert "is a file, needs a folder" in refused("demo", "--out", "file", cwd=tmp_path)


def test_missing_and_damaged_sources(tmp_path: Path) -> None:
    assert "nowhere: no such folder" in refused("track", "nowhere", "--out", "out", cwd=tmp_path)
    sequences.write(tmp_path / "s")
    image = tmp_path / "s" / "images" / "robot_0_camera" / "000001.jpg"
    image.write_bytes(image.read_bytes()[:200])
    assert "000001.jpg: 200 bytes, the manifest says" in refused("track", "s", "--out", "out", cwd=tmp_path)
    assert "--views is 'a', needs numbers" in refused("track", "s", "--views", "a", "--out", "out", cwd=tmp_path)


def test_track_then_score_and_reuse(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    assert pilsim("track", "s", "--out", "r", cwd=tmp_path).returncode == 0
    done = pilsim("score", "s", "r", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    scores = json.loads(done.stdout)
    assert set(scores["targets"]) == set(TARGET_KEYS.split())
    assert set(scores["robots"]) == {*MEASURES, "nees_low", "nees_high", "each", "bound_m", "efficiency"}
    assert set(scores["robots"]["each"]["robot_0"]) == {*MEASURES, "nees_low", "nees_high"}
    stamp = (tmp_path / "r" / "tracks.txt").stat().st_mtime_ns
    assert pilsim("track", "s", "--out", "r", cwd=tmp_path).returncode == 0
    assert (tmp_path / "r" / "tracks.txt").stat().st_mtime_ns == stamp
    sequences.write(tmp_path / "t", seed=1)
    assert "r: holds another run" in refused("track", "t", "--out", "r", cwd=tmp_path)


@pytest.mark.slow
def test_a_utias_set_by_command(tmp_path: Path) -> None:
    write_set(tmp_path / "s")
    done = pilsim("track", "s", "--map", "known", "--slam", "ekf", "--correction", "off", "--out", "r", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "r: 2 robots at" in done.stdout
    scores = json.loads(pilsim("score", "s", "r", "--json", cwd=tmp_path).stdout)
    assert scores["robots"]["ate_m"] < scores["dead_reckoning"]["ate_m"]
    assert "ATE by dead reckoning" in pilsim("score", "s", "r", cwd=tmp_path).stdout
    assert "r: holds another run" in refused("track", "s", "--map", "unknown", "--out", "r", cwd=tmp_path)
    assert "iterations is 0, needs at least 1" in refused("track", "s", "--iterations", "0", "--out", "q", cwd=tmp_path)
    assert "a UTIAS set has none" in refused("track", "s", "--views", "1", "--out", "q", cwd=tmp_path)


@pytest.mark.slow
def test_filters_by_name(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    assert pilsim("track", "s", "--slam", "iekf", "--iterations", "3", "--out", "r", cwd=tmp_path).returncode == 0
    assert "mode='iekf', iterations=3" in (tmp_path / "r" / "run.json").read_text()
    needs = "--l-c, --delta-min and --omega are for --images with --hypotheses single"
    assert needs in refused("track", "s", "--l-c", "4", "--out", "q", cwd=tmp_path)
    assert needs in refused("track", "s", "--images", "--hypotheses", "multiple", "--l-c", "4", "--out", "q", cwd=tmp_path)
    assert "--map is for UTIAS sets" in refused("track", "s", "--map", "known", "--out", "q", cwd=tmp_path)
    assert "'robot_9' is not told its start, needs one of" in refused("track", "s", "--unknown-start", "robot_9", "--out", "q", cwd=tmp_path)
    assert "no robot is left that knows its start" in refused("track", "s", "--unknown-start", "robot_0,robot_1", "--out", "q", cwd=tmp_path)


def test_score_wants_one_of_two_forms(tmp_path: Path) -> None:
    assert "score takes either" in refused("score", cwd=tmp_path)
    assert "score takes either" in refused("score", "--truth", "a.txt", cwd=tmp_path)
    (tmp_path / "a.txt").write_text("1,1,0,0,5,5,1,0,0\n")
    assert "a.txt:line 1: 9 values, needs 10" in refused("score", "--truth", "a.txt", "--result", "a.txt", cwd=tmp_path)
    assert "b.txt" in refused("score", "--truth", "b.txt", "--result", "a.txt", cwd=tmp_path)
    (tmp_path / "d").mkdir()
    assert refused("score", "--truth", "d", "--result", "a.txt", cwd=tmp_path) == "error: d: Is a directory"


def test_published_score_by_command(data: Callable[..., Path]) -> None:
    folder = data("pets2009", "S2.L1", "mot15")
    done = pilsim("score", "--truth", "gt.txt", "--result", "cem_result.txt", "--iou", "0.5", "--json", cwd=folder)
    targets = json.loads(done.stdout)["targets"]
    assert [round(targets["mota"], 3), targets["false_positives"], targets["misses"], targets["switches"]] == [0.850, 247, 420, 31]


def test_help_teaches(tmp_path: Path) -> None:
    for command in ("demo", "track", "score", "worlds", "generate", "place", "stress", "report", "compare", "view"):
        said = pilsim(command, "--help", cwd=tmp_path).stdout
        assert "Example" in said
        # Who is told `None` knows nothing.
        assert "None" not in said, command


def test_no_gl_is_one_line(tmp_path: Path) -> None:
    environment = {"MUJOCO_GL": "osmesa", "PATH": "/usr/bin:/bin", "PYOPENGL_PLATFORM": "nonsense"}
    command = [PILSIM, "demo", "--frames", "1", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "libegl1" in done.stderr
    assert list(tmp_path.iterdir()) == []
