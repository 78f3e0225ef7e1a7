"""The last test of `check`: errors without a name are told of by the table itself, and right recordings are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.recordings.planted_errors import unnamed, with_boxes
from tests.tracker.recordings.walked_room import walked_room, with_extrinsics
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.recordings import Recording
from tracker.recordings.calibration_check import UNEXPLAINED, check_calibration, suspicion

Data = Callable[..., Path]
ERRORS = tuple(unnamed(walked_room(people=1, frames=2)))
OF_TRUTH = tuple(error for error in ERRORS if error.startswith(("truth", "frames")))
"""Errors that no boxes can show."""
LITTLE = ("one camera rolled by 20°",)
"""Errors of one camera that leave most of its feet near those of others: the truth shows them."""
OPENGL = np.diag([1.0, -1.0, -1.0])


@cache
def room() -> Recording:
    return walked_room(frames=80)


@cache
def wrong() -> dict[str, Recording]:
    return unnamed(room())


@pytest.mark.parametrize("error", ERRORS)
def test_no_error_without_a_name_is_praised(error: str) -> None:
    """What speaks against the recording as given is a finding of `check`: under a name, or as it is."""
    assert suspicion(wrong()[error])
    if error not in OF_TRUTH + LITTLE:
        assert suspicion(replace(wrong()[error], truth=None))


def test_there_are_thirty_errors_and_figures_are_told() -> None:
    assert len(ERRORS) >= 30
    report = check_calibration(wrong()["one camera pitched by 8°"])
    assert {finding.kind for finding in report.findings} == {UNEXPLAINED}
    assert all(finding.cameras == ("C1",) for finding in report.unexplained)
    assert any(line.startswith("something is wrong: C1: ") and "agree with true people, needs 30%" in line for line in report.lines())


@pytest.mark.soak
@pytest.mark.parametrize("error", ERRORS)
def test_check_as_a_whole_tells_of_each(error: str) -> None:
    assert check_calibration(wrong()[error]).findings


NAMED = {
    "opengl-axes": lambda r: with_extrinsics(r, lambda e: (OPENGL @ e[0], OPENGL @ e[1])),
    "opengl-camera-to-world": lambda r: with_extrinsics(r, lambda e: ((OPENGL @ e[0]).T, -e[0].T @ e[1])),
    "units-dm": lambda r: with_extrinsics(r, lambda e: (e[0], 10 * e[1])),
    "boxes-in-shares": lambda r: with_boxes(r, lambda b, c: b / ([c.camera.width, c.camera.height] * 2)),
    "boxes-mirrored": lambda r: with_boxes(r, lambda b, c: np.column_stack([c.camera.width - b[:, 0] - b[:, 2], b[:, 1:]])),
    "boxes-of-half-size": lambda r: with_boxes(r, lambda b, _: b / 2),
    "boxes-of-other-size": lambda r: with_boxes(r, lambda b, c: b * 800 / c.camera.width),
}


@pytest.mark.parametrize("kind", NAMED)
def test_errors_with_a_name_are_named_alone(kind: str) -> None:
    assert [finding.kind for finding in check_calibration(NAMED[kind](room())).findings] == [kind]


def test_one_camera_with_opengl_axes_is_named_without_truth() -> None:
    one = with_extrinsics(room(), lambda e: (OPENGL @ e[0], OPENGL @ e[1]), ("C2",))
    (finding,) = check_calibration(replace(one, truth=None)).findings
    assert (finding.kind, finding.cameras) == ("opengl-axes", ("C2",))


@pytest.mark.parametrize("people", [1, 8, 40])
def test_nothing_speaks_against_a_right_recording(people: int) -> None:
    recording = walked_room(people=people, frames=40, seed=people)
    assert suspicion(recording) == suspicion(replace(recording, truth=None)) == ""
    assert suspicion(walked_room(people=people, frames=40, speed=0.0)) == ""


PETS, MORE = ("1", "3", "4", "1,5,7", "3,4"), ("4,7", "5,6,7,8")
"""Few cameras. `check` itself is tried with all cameras of real recordings (test_calibration_check.py)."""


@pytest.mark.parametrize("views", [*PETS, *(pytest.param(views, marks=pytest.mark.soak) for views in MORE)])
def test_nothing_speaks_against_few_cameras_of_real_recordings(data: Data, views: str) -> None:
    recording = open_recording(data("pets2009/S2.L1"), SourceOptions(tuple(views.split(","))), strict=False)
    assert suspicion(recording) == suspicion(replace(recording, truth=None)) == ""


def test_nothing_speaks_against_seven_cameras_with_boxes_in_one(data: Data) -> None:
    recording = open_recording(data("wildtrack"), SourceOptions(), strict=False)
    assert suspicion(recording) == suspicion(replace(recording, truth=None)) == ""
