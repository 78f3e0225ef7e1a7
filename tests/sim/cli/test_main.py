"""The command line as a process: bad input gives one line and exit code 2, and leaves no files."""

import contextlib
import io
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from sim.cli.main import COMMANDS, _parse, main
from tests.commands import pilsim
from tests.tracker import sequences
from tests.tracker.planar_slam.mrclam import write_set
from tests.tracker.recordings.walked_room import walked_room
from tracker.formats.recording_export import write_recording
from tracker.metrics.trajectory import MEASURES

TARGET_KEYS = """mota motp_m motp_percent false_positives misses switches fragments mostly_tracked mostly_lost truths idf1 hota moda modp"""


def refused(*arguments: object, cwd: Path) -> str:
    """Run a command that must be refused, and return its one line of error."""
    before = sorted(p.as_posix() for p in cwd.rglob("*"))
    with contextlib.chdir(cwd), contextlib.redirect_stderr(io.StringIO()) as said:
        assert exit_code(*map(str, arguments)) == 2
    (line,) = said.getvalue().strip().splitlines()
    assert line.startswith("error: ")
    assert sorted(p.as_posix() for p in cwd.rglob("*")) == before
    return line


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("main") / "room"
    folder.mkdir()
    write_recording(folder, walked_room(people=4, frames=40, seed=2))
    return folder


def exit_code(*words: str) -> int:
    """The exit code of the command line in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["pilsim", *words])
        try:
            main()
        except SystemExit as ended:
            return int(ended.code or 0)
    return 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "a command is missing, needs one of demo, doctor, "),
        ("frobnicate", 'pilsim has no command "frobnicate"; see pilsim --help'),
        ("trak x", 'pilsim has no command "trak"; did you mean track? see pilsim --help'),
        ("Track x", 'pilsim has no command "Track"; did you mean track? see pilsim --help'),
        ("--seed 3 demo", "--seed stands before the command; see pilsim --help"),
        ("track x --hypotheses multiple", 'track has no option "--hypotheses"; see pilsim track --help'),
        ("track x --n_skan=2", 'track has no option "--n_skan" (did you mean --n-scan?); see pilsim track --help'),
        ("stress --no-rendr", 'stress has no option "--no-rendr" (did you mean --no-render?); see pilsim stress --help'),
        ("track x --sweep density", 'track has no option "--sweep" (which is an option of stress); see pilsim track --help'),
        (
            "track x --slm ekf --detection x --xyzzy",
            'track has no option "--slm" (did you mean --slam?), "--detection" (did you mean --detections?), "--xyzzy"; see pilsim track --help',
        ),
        ("demo --hlep", 'demo has no option "--hlep" (did you mean --help?); see pilsim demo --help'),
        ("demo 3", "Unrecognized options: 3; see pilsim demo --help"),
        ("demo --frames abc", "Error parsing --frames: invalid literal for int() with base 10: 'abc'; see pilsim demo --help"),
        ("generate pilsun --frames x --out D", "--frames is 'x', needs INT; see pilsim generate --help"),
        ("generate pilsun --difficulty high --out D", "--difficulty is 'high', needs FLOAT; see pilsim generate --help"),
        ("generate pilsun", "Missing from pilsim generate: --out DIR"),
        ("export x --format jpeg --out y", "invalid choice 'jpeg' for argument '--format'"),
        ("report runs --out page.pdf", "--out is page.pdf, needs a name that ends in .html"),
        ("check room --picture room.jpg", "--picture is room.jpg, needs a name that ends in .png"),
        ("place --episodes 0", "--episodes is 0, needs at least 1"),
        ("place --train 0", "--train is 0, needs at least 1"),
        ("stress --frames 1 --out D", "--frames is 1, needs at least 2"),
        ("clique x.clq --seed -1", "--seed is -1, needs at least 0"),
        ("track x --v-max 0 --out D", "--v-max is 0.0, needs more than 0"),
        ("track x --out y --l-c 4", "no such folder"),
        ("compare", "compare needs folders of results, the first as the reference"),
        ("stress --world mars --sweep robots/0 --out y", "--world is 'mars', needs one of campus, forest, "),
        ("stress --pets nowhere --out y", "nowhere: no such folder"),
        ("worlds pilsun --slip inf", "seconds is inf, needs 0 to 3600"),
        ("demo --frames 0", "frames is 0, needs a whole number in [1, "),
        ("demo --robots 0", "robots is 0, needs a whole number in [1, "),
        ("demo --people -1", "people is -1"),
        ("demo --difficulty 1.5", "difficulty is 1.5, needs a number in [0, 1]"),
        ("demo --difficulty nan", "difficulty is nan"),
        pytest.param("demo --world atlantis", "pilsun", marks=pytest.mark.command),
        ("demo --width 1023", "width is 1023"),
        ("fit-detector ROOM --out a.txt", "--out is a.txt, needs a name that ends in .json"),
        ("fit-detector ROOM --frames 0:4 --out a.json", "too little truth"),
        ("fit-detector nowhere --out a.json", "nowhere: no such folder"),
        ("demo --detector-model yolo --out d", "detector model is 'yolo', needs independent, a file, or one of"),
        ("generate pilsun --detector-model fairmot --misses 0.2 --out d", "--misses is of the independent detector"),
        ("stress --sweep misses --detector-model fairmot --out d", "--sweep misses varies the independent detector"),
        ("stress --recording ROOM --detector-model fairmot --out d", "--recording has boxes of its own"),
        ("predict ROOM --fit 5", "--fit is '5'"),
        ("predict ROOM --fit 0:40 --detector-model fairmot", "exclude each other"),
        ("predict ROOM --fit 0:4", "too little truth"),
        ("predict ROOM --detector-model nobody", "detector model is 'nobody'"),
        ("predict ROOM --seeds 0", "--seeds is 0"),
        ("predict ROOM --out table.txt", "ends in .json"),
        ("predict ROOM --world hall", "needs either SOURCE, a recording, or --world"),
        ("predict ROOM --people 3", "needs either SOURCE, a recording, or --world"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    words: str, message: str, room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(*(str(room) if word == "ROOM" else word for word in words.split())) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("columns", [80, 200])
def test_overview_fits_a_screen(columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert exit_code("--help") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    names = [line.split()[0] for line in lines if line.startswith("  ")]
    assert sorted(names) == sorted(COMMANDS)


def test_the_command_of_a_stress_test_gives_its_case(tmp_path: Path) -> None:
    words = ["stress", "--sweep", "density/0", "--pets", str(tmp_path), "--seeds", "2", "--out", str(tmp_path / "out")]
    trials = _parse(words)._trials()
    assert [trial.case.id for trial in trials] == ["density/0", "pets/real", "pets/twin", "density/0", "pets/twin"]
    for trial in trials:
        (again,) = _parse(shlex.split(trial.command)[1:])._trials()
        assert again.case == trial.case
    # The cases are made once for all seeds.
    assert trials[0].case.faults is trials[3].case.faults


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("--version") == 0
    assert capsys.readouterr().out.startswith("pilsim 0.")


@pytest.mark.command
def test_help_needs_no_heavy_module() -> None:
    code = "import sys, sim.cli.main; sim.cli.main.overview(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"scipy", "mujoco", "numba", "cv2", "matplotlib", "tracker.pipeline", "worlds"} & set(done.stdout.split())


@pytest.mark.parametrize("columns", [80, 200])
@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command(name: str, columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert exit_code(name, "--help") == 0
    text = capsys.readouterr().out
    lines = text.splitlines()
    assert "Example" in text
    # `None` tells a reader nothing.
    assert "None" not in text
    assert "(default: )" not in text
    # Examples stay on one line, so that they can be copied. All other lines fit.
    assert all(len(line) <= min(columns, 120) for line in lines if "pilsim " not in line)
    groups = [line.strip("╭╮─ ") for line in lines if line.startswith("╭")]
    common = groups.index("options")
    assert groups[:common] in ([], ["positional arguments"])
    for group in groups[common + 1 :]:
        # One sentence stands below the title, and a rule below that.
        below = lines[next(k for k, line in enumerate(lines) if line.startswith(f"╭─ {group} ")) + 1 :]
        sentence = " ".join(line.strip("│ ") for line in below[: next(k for k, line in enumerate(below) if "───" in line)])
        assert sentence.endswith("."), group
    options = re.split(r"\n│ (?=--)", text)[1:]
    assert {option.split()[0].strip(",") for option in options} | {"--help"} >= set(re.findall(r"(?m)^│ (--[a-z0-9-]+)", text))
    for option in options:
        assert re.search(r"\((default|required)", option), option


@pytest.mark.command
def test_an_out_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "diary.txt").write_text("dear diary")
    assert "and no sequence/scenario.json; choose another --out" in refused("demo", "--out", "out", cwd=tmp_path)
    (tmp_path / "file").write_text("")
    assert "is a file, needs a folder" in refused("demo", "--out", "file", cwd=tmp_path)


@pytest.mark.command
def test_missing_and_damaged_sources(tmp_path: Path) -> None:
    assert "nowhere: no such folder" in refused("track", "nowhere", "--out", "out", cwd=tmp_path)
    sequences.write(tmp_path / "s")
    assert "camera is 'a', needs one of robot_0_camera" in refused("track", "s", "--views", "a", "--out", "out", cwd=tmp_path)
    image = tmp_path / "s" / "images" / "robot_0_camera" / "000001.jpg"
    image.write_bytes(image.read_bytes()[:200])
    assert "000001.jpg: 200 bytes, the manifest says" in refused("track", "s", "--out", "out", cwd=tmp_path)


@pytest.mark.command
def test_track_then_score_and_reuse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
    capsys.readouterr()
    assert exit_code("score", str(tmp_path / "t"), str(tmp_path / "r")) == 2
    said = f"{tmp_path / 'r'}, scored against {tmp_path / 't'}: these results were made from another source"
    assert said in capsys.readouterr().err


@pytest.mark.command
def test_results_of_an_old_version_are_scored_and_not_tracked_over(tmp_path: Path) -> None:
    """run.json of pilsim 0.3.0 holds parameters as text, here shortened."""
    sequences.write(tmp_path / "s")
    assert pilsim("track", "s", "--out", "r", cwd=tmp_path).returncode == 0
    scores = pilsim("score", "s", "r", "--json", cwd=tmp_path).stdout
    provenance = json.loads((tmp_path / "r" / "run.json").read_text())["provenance"]
    old = {
        "frames": 3,
        "parameters": "Parameters(slam=SlamParameters(mode='fej', iterations=2, correction=True), multiple=None, delay=0)",
        "provenance": provenance,
        "schema": 1,
        "source": "s",
        "views": [],
    }
    text = json.dumps(old, indent=1, sort_keys=True) + "\n"
    (tmp_path / "r" / "run.json").write_text(text)
    assert pilsim("score", "s", "r", "--json", cwd=tmp_path).stdout == scores
    assert "r: was written by pilsim 0.3.0 or older" in refused("track", "s", "--out", "r", cwd=tmp_path)
    assert (tmp_path / "r" / "run.json").read_text() == text


@pytest.mark.command
def test_a_utias_set_by_command(tmp_path: Path) -> None:
    write_set(tmp_path / "s", 10.0)
    done = pilsim("track", "s", "--map", "known", "--slam", "ekf", "--correction", "off", "--out", "r", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "r: 2 robots at" in done.stdout
    scores = json.loads(pilsim("score", "s", "r", "--json", cwd=tmp_path).stdout)
    assert scores["robots"]["ate_m"] < scores["dead_reckoning"]["ate_m"]
    assert "ATE by dead reckoning" in pilsim("score", "s", "r", cwd=tmp_path).stdout
    assert "r: holds another run" in refused("track", "s", "--map", "unknown", "--out", "r", cwd=tmp_path)
    assert "iterations is 0, needs at least 1" in refused("track", "s", "--iterations", "0", "--out", "q", cwd=tmp_path)
    assert "a UTIAS set has none" in refused("track", "s", "--views", "1", "--out", "q", cwd=tmp_path)


@pytest.mark.command
def test_filters_by_name(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    assert pilsim("track", "s", "--slam", "iekf", "--iterations", "3", "--out", "r", cwd=tmp_path).returncode == 0
    slam = json.loads((tmp_path / "r" / "run.json").read_text())["parameters"]["slam"]
    assert (slam["mode"], slam["iterations"], slam["odometry_biases"]) == ("iekf", 3, None)
    assert "--l-c, --delta-min and --omega need --images" in refused("track", "s", "--l-c", "4", "--out", "q", cwd=tmp_path)
    assert "--map is for UTIAS sets" in refused("track", "s", "--map", "known", "--out", "q", cwd=tmp_path)
    assert "robot without a start pose is 'robot_9', needs one of" in refused("track", "s", "--unknown-start", "robot_9", "--out", "q", cwd=tmp_path)
    assert "no moving robot with a known start pose is left" in refused(
        "track", "s", "--unknown-start", "robot_0,robot_1", "--out", "q", cwd=tmp_path
    )


def test_score_takes_one_of_two_forms(tmp_path: Path) -> None:
    assert "score takes either" in refused("score", cwd=tmp_path)
    assert "score takes either" in refused("score", "--truth", "a.txt", cwd=tmp_path)
    (tmp_path / "a.txt").write_text("1,1,0,0,5,5,1,0,0\n")
    assert "a.txt:1: 9 values, needs 10" in refused("score", "--truth", "a.txt", "--result", "a.txt", cwd=tmp_path)
    assert "b.txt" in refused("score", "--truth", "b.txt", "--result", "a.txt", cwd=tmp_path)
    (tmp_path / "d").mkdir()
    assert refused("score", "--truth", "d", "--result", "a.txt", cwd=tmp_path) == "error: d: Is a directory"


def test_people_on_a_part_of_the_ground_are_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Person 2 and track 9 are outside; track 9 matches nobody."""
    (tmp_path / "gt.txt").write_text("1,1,0,0,1,1,1,1,1,0\n1,2,0,0,1,1,1,8,1,0\n")
    (tmp_path / "out.txt").write_text("1,5,0,0,1,1,1,1.1,1,0\n1,9,0,0,1,1,1,6,1,0\n")
    monkeypatch.chdir(tmp_path)
    command = ("score", "--truth", "gt.txt", "--result", "out.txt")
    assert exit_code(*command, "--area", "0,0,5,5", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["targets"]["mota"], found["targets"]["truths"], found["area"]) == (1, 1, [[0, 0], [5, 5]])
    assert exit_code(*command, "--area", "0,0,5,5") == 0
    assert "for x from 0 to 5 m" in capsys.readouterr().out
    for area in ("0,0,5", "5,0,0,5", "0,0,nan,5", "a"):
        assert f"--area is '{area}', needs lowest x, lowest y, highest x, highest y in m" in refused(*command, "--area", area, cwd=tmp_path)
    assert "--iou compares boxes" in refused(*command, "--area", "0,0,5,5", "--iou", "0.5", cwd=tmp_path)
