"""The command `pilsim check` on recordings."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import pytest

from sim.cli.check import Check
from sim.cli.track import SourceChoice
from tests.commands import pilsim
from tests.tracker import sequences
from tests.tracker.recordings.walked_room import planted, walked_room, with_extrinsics
from tracker.recordings import Recording
from tracker.recordings.folder import write_recording


def written(folder: Path, recording: Recording) -> None:
    folder.mkdir()
    write_recording(folder, recording)


@pytest.mark.command
def test_a_right_calibration_is_a_table_and_a_picture(tmp_path: Path) -> None:
    written(tmp_path / "room", walked_room(frames=60))
    done = pilsim("check", "room", "--picture", "room.png", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0].startswith("camera")
    assert [line.split()[0] for line in lines[1:5]] == ["C1", "C2", "C3", "C4"]
    assert lines[-1] == "room: nothing looks wrong"
    assert min(cv2.imread(str(tmp_path / "room.png")).shape[:2]) > 500


def test_cameras_and_frames_are_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path / "room", walked_room(frames=60))
    Check(tmp_path / "room", choice=SourceChoice(cameras="C1,C3", frames="0:40"), json=True).run()
    said = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in said["cameras"]] == ["C1", "C3"]
    assert said["findings"] == []


@pytest.mark.parametrize("error", ["mm", "truth in mm"])
def test_what_other_commands_refuse_is_opened_and_named(tmp_path: Path, error: str, capsys: pytest.CaptureFixture[str]) -> None:
    kind, wrong, _ = planted(walked_room(frames=60))[error]
    written(tmp_path / "room", wrong)
    with pytest.raises(ValueError, match="room: 1 thing looks wrong"):
        Check(tmp_path / "room", json=True).run()
    assert [finding["kind"] for finding in json.loads(capsys.readouterr().out)["findings"]] == [kind]


def test_the_words_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path / "room", with_extrinsics(walked_room(frames=60), lambda e: (e[0], e[1] * 1000)))
    with pytest.raises(ValueError, match="1 thing looks wrong"):
        Check(tmp_path / "room", picture=tmp_path / "room.png").run()
    assert "looks wrong: all cameras: t is in millimetres, and needs to be in metres." in capsys.readouterr().out
    assert (tmp_path / "room.png").stat().st_size > 10_000


def test_no_boxes_are_no_evidence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path / "room", Recording(4.0, walked_room(people=1, frames=2).cameras, frames=3))
    Check(tmp_path / "room", picture=tmp_path / "room.png").run()
    assert capsys.readouterr().out.splitlines()[-1].endswith("room: no boxes, so the calibration cannot be tested")


def test_bad_input(tmp_path: Path) -> None:
    written(tmp_path / "room", walked_room(people=1, frames=2))
    (tmp_path / "empty").mkdir()
    sequences.write(tmp_path / "s")
    room = tmp_path / "room"
    for command, message in (
        (Check(room, choice=SourceChoice(cameras="C9")), "camera is 'C9', needs one of C1, C2, C3, C4"),
        (Check(tmp_path / "empty"), "empty: holds nothing that pilsim opens"),
        (Check(tmp_path / "nowhere"), "nowhere: no such folder"),
        (Check(tmp_path / "s", picture=Path("s.png")), "s: is of pilsim, whose checksums are checked as a whole"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            command.run()
