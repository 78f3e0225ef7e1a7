"""Cameras of a room are calibrated by the people in it; what the data do not say is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from sim.cli.calibrate import Calibrate
from tests.benchmarks.calibration import synthetic
from tests.commands import pilsim
from tests.tracker.calibration.blind_room import blind, late, place_errors, tilt_errors, walked_room
from tests.tracker.recordings.walked_room import LENS
from tracker.calibration import Known, calibrate
from tracker.calibration.adjustment import GLOBAL_PRIOR
from tracker.calibration.body import CX, CY, FOCAL, GLOBALS, HEIGHT, PITCH, ROLL
from tracker.calibration.calibrate import _Calibrator
from tracker.calibration.registration import in_view
from tracker.geometry.cameras import Pinhole
from tracker.geometry.ground import Flat
from tracker.recordings import Recording
from tracker.recordings.clock_offsets import with_offsets
from tracker.recordings.folder import read_recording, write_recording
from tracker.recordings.recording import GUESSED_FOCAL


def written(folder: Path, recording: Recording) -> None:
    folder.mkdir()
    write_recording(folder, recording)


@pytest.mark.command
def test_two_cameras_of_known_lenses_from_the_command(tmp_path: Path) -> None:
    room = late(walked_room(frames=160), "C2", 2).choose(["C1", "C2"])
    written(tmp_path / "room", blind(room, intrinsics=True))
    refused = pilsim("track", "room", "--out", "tracks", cwd=tmp_path)
    assert refused.returncode == 2
    assert "have no R and t; `pilsim calibrate` finds them" in refused.stderr
    done = pilsim("calibrate", "room", "--out", "new", "--json", "--page", "page.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "page.html").read_text()
    assert ElementTree.fromstring(page.partition("\n")[2]).tag == "html"
    assert page.count('<img src="data:image/png') == 1
    assert "pilsim calibrate room --out new" in page
    said = json.loads(done.stdout)
    assert abs(said["cameras"]["C2"]["offset_s"] - 0.5) < 0.05
    assert read_recording(tmp_path / "new").frames == room.frames
    again = pilsim("calibrate", "room", "--out", "new", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (2, "error: new: is there already, choose another folder\n")


@pytest.mark.command
def test_what_is_not_known_is_told_and_the_guess_stands_beside(tmp_path: Path) -> None:
    written(tmp_path / "still", blind(walked_room(frames=60, speed=0.0).choose(["C1", "C2"]), intrinsics=True))
    done = pilsim("calibrate", "still", "--out", "new", "--page", "page.html", cwd=tmp_path)
    assert done.returncode == 3
    assert "not known: C" in done.stderr
    assert done.stderr.endswith("if they may be further apart, repeat with --clock 30\n")
    assert "The data do not say enough" in (tmp_path / "page.html").read_text()
    assert not (tmp_path / "new").exists()
    assert (tmp_path / "new.guess" / "recording.json").is_file()
    written(tmp_path / "short", blind(walked_room(frames=2).choose(["C1"])))
    done = pilsim("calibrate", "short", "--out", "none", "--picture", "none.png", "--page", "none.html", cwd=tmp_path)
    assert done.returncode == 3
    assert done.stderr.startswith("not known: C1: ")
    assert done.stderr.count("\n") == 1


def test_late_times_are_counted_from_the_first_box() -> None:
    room = walked_room(frames=40).choose(["C1", "C2"])
    late_room = _Calibrator(with_offsets(room, dict.fromkeys(room.cameras, 3600.0)), Known())
    start = _Calibrator(room, Known())
    assert (late_room.times, late_room.begin, start.begin) == (start.times, 3600.0, 0.0)
    np.testing.assert_allclose(late_room.views["C1"].table.time, start.views["C1"].table.time, atol=1e-9)


def test_a_new_world_is_level_and_holds_only_what_is_known_in_it() -> None:
    room = walked_room(frames=40)
    boxes = {name: room.detections[name] for name in ("C1", "C2", "C3")}
    calibrator = _Calibrator(replace(blind(room, intrinsics=True), detections=boxes, ground=Flat(1.2)), Known())
    calibrator.rows = {name: calibrator.views[name].single.row for name in ("C1", "C2")}
    found = calibrator._result(None, ["C1", "C2"])
    for name, camera in found.cameras.items():
        assert camera.pose.translation[2] == pytest.approx(np.exp(calibrator.rows[name][HEIGHT]))
    # The poses in the recording are of another world.
    new = found.applied(replace(room, detections=boxes))
    assert {name: sorted(camera.unknown) for name, camera in new.cameras.items()} == {"C1": [], "C2": [], "C3": ["pose"]}


def test_a_camera_without_whole_bodies_sees_nobody() -> None:
    room = walked_room(frames=40).choose(["C1", "C2"])
    calibrator = _Calibrator(room, Known())
    view = calibrator.views["C1"]
    cut = replace(view, table=replace(view.table, whole=np.zeros(len(view.table), dtype=bool)))
    assert in_view(view, calibrator.rows["C1"], calibrator._walked("C2", calibrator.rows["C2"])) > 0
    assert in_view(cut, calibrator.rows["C1"], calibrator._walked("C2", calibrator.rows["C2"])) == 0


def test_bodies_that_do_not_exist_are_told() -> None:
    """Parameters of bodies far off their prior compensate ground that is not level, for example. A refinement keeps cameras as they are given."""
    room = walked_room(frames=160)
    for refine in (False, True):
        calibrator = _Calibrator(room, Known(refine=refine))
        adjusted = calibrator._adjust()
        assert adjusted is not None
        body = GLOBAL_PRIOR[:, 0].copy()
        body[GLOBALS.index("head")] -= 6 * GLOBAL_PRIOR[GLOBALS.index("head"), 1]
        told = [line for line in calibrator._contradictions(replace(adjusted, body=body)) if "6 standard deviations off" in line]
        assert len(told) == (0 if refine else 1)
        assert not any("standard deviations off" in line for line in calibrator._contradictions(replace(adjusted, body=GLOBAL_PRIOR[:, 0])))


def test_lens_parameters_that_are_not_estimated_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    room = walked_room(frames=40).choose(["C1", "C2"])
    guessed = replace(room.cameras["C2"], unknown=frozenset({"K", "pose"}))
    believed = Calibrate(Path("room"), Path("new"), "intrinsics")._believed(replace(room, cameras=room.cameras | {"C2": guessed}))
    assert [sorted(camera.unknown) for camera in believed.cameras.values()] == [["pose"], ["K", "pose"]]
    for source, said in (("current", True), ("nothing", False)):
        Calibrate(Path("room"), Path("new"), source, k1=True)._believed(room)
        line = "--principal and --k1 change nothing of C1, C2, whose K is known; --from nothing forgets it\n"
        assert capsys.readouterr().err == line * said


PAL = Pinhole(720, 576, 450.0, 480.0, 359.5, 287.5)
"""A lens whose images are shown as 4:3, so that pixels are 16/15 as wide as high."""


@pytest.mark.command
def test_the_pixels_of_standard_video_are_no_squares(tmp_path: Path) -> None:
    room = walked_room(frames=60, speed=0.0, lens=PAL).choose(["C1", "C2"])
    written(tmp_path / "pal", blind(room))
    line = "C1: 720 x 576 px is a size of PAL or NTSC video, so its pixels are taken as 1.067 times as wide as high"
    said = pilsim("calibrate", "pal", "--out", "new", cwd=tmp_path).stderr
    assert f"{line}; `--pixel-aspect C1=1` makes them squares\n" in said
    guess = read_recording(tmp_path / "new.guess").cameras["C1"].camera
    assert isinstance(guess, Pinhole)
    assert np.isclose(guess.fy / guess.fx, 16 / 15)
    said = pilsim("calibrate", "pal", "--pixel-aspect", "C1=1", "--out", "square", cwd=tmp_path).stderr
    assert line not in said
    assert "C2: 720 x 576 px is a size" in said
    written(tmp_path / "known", blind(room, intrinsics=True))
    refused = pilsim("calibrate", "known", "--pixel-aspect", "C1=1", "--out", "other", cwd=tmp_path)
    assert (refused.returncode, refused.stderr) == (2, "error: known: --pixel-aspect names C1, whose K is known; --from nothing forgets it\n")


@pytest.mark.soak
@pytest.mark.parametrize("lens", [LENS, PAL], ids=["square", "PAL"])
def test_four_cameras_from_nothing(lens: Pinhole) -> None:
    room = late(walked_room(frames=240, lens=lens), "C2", 2)
    found = calibrate(blind(room))
    assert not found.problems
    assert sorted(found.cameras) == list(room.cameras)
    focal = [camera.camera.fx / lens.fx for camera in found.cameras.values()]  # type: ignore[attr-defined]
    assert np.abs(np.log(focal)).max() < 0.03
    assert np.abs(tilt_errors(found, room)).max() < 0.5
    assert place_errors(found, room).max() < 0.02 * 6.0
    assert abs(found.offsets["C2"] - 0.5) < 0.05


@pytest.mark.soak
def test_clocks_that_are_far_apart_are_searched_on_request() -> None:
    room = late(walked_room(frames=240), "C2", 60).choose(["C1", "C2", "C3"])
    assert calibrate(blind(room)).problems
    found = calibrate(blind(room), Known(clock=20.0))
    assert not found.problems
    assert abs(found.offsets["C2"] - 15.0) < 0.05
    assert place_errors(found, room).max() < 0.03 * 6.0


@pytest.mark.soak
def test_stated_deviations_hold_principal_points_off_the_middle() -> None:
    room = walked_room(frames=240, lens=replace(LENS, cx=LENS.cx + 30.0, cy=LENS.cy - 25.0, distortion=(-0.03, 0.0, 0.0, 0.0, 0.0)))
    found = calibrate(blind(room))
    rows = found.rows.copy()
    rows[:, FOCAL] -= np.log(800.0 / (GUESSED_FOCAL * 1280))
    for name, row in zip(found.cameras, rows, strict=True):
        sigma = found.sigma[name]
        assert abs(row[FOCAL]) < 3 * sigma[FOCAL]
        assert np.allclose(sigma[[CX, CY]], 0.02)
    tilt = np.radians(tilt_errors(found, room))
    assert (np.abs(tilt) < 3 * np.array([found.sigma[name][[PITCH, ROLL]] for name in found.cameras])).all()


@pytest.mark.soak
def test_uneven_ground_ends_in_no_error() -> None:
    """Steps with paths integrated out led to focal lengths beyond all bounds here."""
    found = calibrate(synthetic("uneven", 4, 40).recording)
    assert np.isfinite(found.rows).all()
    assert np.isfinite(found.covariance).all()
