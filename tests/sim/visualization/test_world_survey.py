"""The command `pilsim worlds`: table, previews and export."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from sim.visualization.world_survey import HEADINGS, SurveyOptions, describe, survey
from worlds import catalogue


def pilsim(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "sim.cli.main", *words], capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_every_world_has_a_row() -> None:
    rows = survey(None, 0.5, 0)
    assert [row["world"] for row in rows] == sorted(catalogue.WORLDS)
    assert all(set(HEADINGS) - {"slip"} < set(row) for row in rows)
    text = describe(rows)
    assert all(name in text for name in catalogue.WORLDS)
    assert [row["world"] for row in rows if row["world"] not in ("campus", "hall") and row["irregular_share"] < 0.15] == []


@pytest.mark.slow
def test_a_preview_is_drawn(tmp_path: Path) -> None:
    (row,) = survey("pilsun", 0.5, 3, SurveyOptions(pictures=tmp_path / "pictures", seconds=10))
    page = cv2.imread(str(tmp_path / "pictures" / "pilsun.png"))
    assert min(page.shape[:2]) > 900
    # The panorama fills the upper part: many colours, not paper.
    assert page[100:350, 100:1500].std() > 25
    assert row["seed"] == 3
    assert 0 < row["slip"] < 0.2
    assert "slip" in describe([row])


def test_command_prints_json_and_exports(tmp_path: Path) -> None:
    done = pilsim("worlds", "pilsun", "--json", "--difficulty", "0.2", "--export", str(tmp_path / "lab.glb"))
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    assert (row["world"], row["difficulty"]) == ("pilsun", 0.2)
    assert (tmp_path / "lab.glb").read_bytes()[:4] == b"glTF"


@pytest.mark.slow
def test_command_names_what_it_writes(tmp_path: Path) -> None:
    done = pilsim("worlds", "hall", "--export", str(tmp_path / "hall.obj"))
    assert done.stdout.splitlines()[-1] == f"wrote {tmp_path / 'hall.obj'}"
    assert (tmp_path / "hall.obj").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "world is 'nowhere', needs one of"),
        (["pilsun", "--difficulty", "1.5"], "difficulty is 1.5"),
        (["pilsun", "--export", "lab.stl"], "needs an ending of"),
        (["--export", "lab.glb"], "needs the name of one world"),
        (["pilsun", "--preview", __file__], "is a file, needs a folder"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, words: list[str], said: str) -> None:
    done = pilsim("worlds", *words)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr
