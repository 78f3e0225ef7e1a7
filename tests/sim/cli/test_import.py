"""The command `pilsim import`, and `info` and `track` of a bag, as processes."""

import json
from pathlib import Path

import pytest

from tests.commands import pilsim
from tests.tracker import sequences
from tests.tracker.formats.ros.robot_bag import RobotBag
from tracker.formats.exporting import export


@pytest.mark.command
def test_a_bag_is_listed_imported_and_tracked(tmp_path: Path) -> None:
    RobotBag().write(tmp_path / "walk", "ros1")
    done = pilsim("info", "walk.bag", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "  /pano/image_raw: sensor_msgs/Image, 11, 5/s" in done.stdout.splitlines()
    topics = ("--camera", "/pano/image_raw=panorama", "--odometry", "/odom", "--imu", "/imu")
    done = pilsim("import", "walk.bag", *topics, "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "out: 11 frames at 5/s of pano; `pilsim track out` reads it\n"
    assert done.stderr == "/odom: states no variance of x, y, z, roll, pitch, yaw; 5 cm and 2 degrees after a metre are taken\n"
    done = pilsim("track", "out", "--out", "tracked", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("no people: there are no boxes\n")
    assert len((tmp_path / "tracked" / "robots.csv").read_text().splitlines()) == 12


@pytest.mark.command
def test_an_export_of_ours_is_imported_whole(tmp_path: Path) -> None:
    sequences.write(tmp_path / "pair")
    export(tmp_path / "pair", "mcap", tmp_path / "bags")
    done = pilsim("import", "bags/pair/pair.mcap", "--exported", "--out", "out", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"out": "out", "frames": 3, "rate": 6.0, "robots": ["robot_0", "robot_1"], "notes": []}


@pytest.mark.command
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("import", "walk", "--out", "out"), "error: walk: needs --camera TOPIC, one or more of /pano/image_raw\n"),
        (("import", "none.bag", "--out", "out"), "error: none.bag: no such file or folder\n"),
        (("import", "walk", "--camera", "/a=round", "--out", "out"), "error: --camera /a=round: model is 'round', needs one of panorama, "),
        (("import", "walk", "--exported", "--imu", "/imu", "--out", "out"), "error: --exported takes all topics of a bag, and excludes --camera"),
        (("track", "walk", "--out", "out"), "error: walk: is a bag, of which `pilsim import` makes a recording; `pilsim info` lists its topics\n"),
    ],
)
def test_errors_are_one_line(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    RobotBag().write(tmp_path / "walk")
    done = pilsim(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["walk"]
