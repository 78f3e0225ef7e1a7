"""The command `pilsim doctor`, with and without OpenGL."""

import json

import pytest

from sim.cli import doctor
from sim.rendering.gl_context import GLUnavailable


@pytest.mark.command
def test_the_report_is_json_and_text() -> None:
    report = doctor.examine(seconds=0.01)
    assert json.loads(json.dumps(report)) == report
    assert report["fault"] is None
    assert report["speed"]["panoramas"] > 0
    assert report["versions"]["mujoco"].startswith("4.")
    text = doctor.describe(report)
    assert report["gl"]["renderer"] in text
    assert ("the CPU" in text) != ("a GPU" in text)
    assert "panoramas a second, 1024 x 512" in text
    # Colour, geom codes and depth are read, 4 bytes a texel each.
    assert report["traffic"]["read_backs"] == 3
    assert report["traffic"]["read_bytes"] >= 12 * 1024 * 512 / 2
    assert "3 read-backs of" in text
    assert all(line == line.rstrip() for line in text.splitlines())


@pytest.mark.command  # `platform` asks `uname` the first time
def test_without_opengl_the_report_names_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise GLUnavailable("no OpenGL: install libegl1")

    monkeypatch.setattr(doctor, "choose_gl", none)
    report = doctor.examine()
    assert report["gl"] is report["speed"] is None
    assert doctor.describe(report).splitlines()[-1] == "OpenGL     no OpenGL: install libegl1"
