"""The command `pilsim worlds`: table, previews and export."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from sim.cli.worlds import Worlds
from sim.visualization.world_survey import HEADINGS, describe, survey
from tests.commands import pilsim
from worlds import catalogue


@pytest.mark.soak
def test_every_world_has_a_row() -> None:
    rows = survey(None, 0.5, 0)
    assert [row["world"] for row in rows] == sorted(catalogue.WORLDS)
    assert all(set(HEADINGS) - {"slip"} < set(row) for row in rows)
    text = describe(rows)
    assert all(name in text for name in catalogue.WORLDS)
    assert [row["world"] for row in rows if row["world"] not in ("campus", "hall") and row["irregular_share"] < 0.15] == []


@pytest.mark.render
def test_a_preview_is_drawn(tmp_path: Path) -> None:
    (row,) = survey("pilsun", 0.5, 3, seconds=10, pictures=tmp_path / "pictures")
    page = cv2.imread(str(tmp_path / "pictures" / "pilsun.png"))
    assert min(page.shape[:2]) > 900
    # The panorama fills the upper part: many colours, not paper.
    assert page[110:385, 110:1650].std() > 25
    assert row["seed"] == 3
    assert 0 < row["slip"] < 0.2
    assert "slip" in describe([row])


@pytest.mark.command
def test_the_command_prints_json_and_exports(tmp_path: Path) -> None:
    done = pilsim("worlds", "pilsun", "--json", "--difficulty", "0.2", "--export", tmp_path / "lab.glb")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    assert (row["world"], row["difficulty"]) == ("pilsun", 0.2)
    assert (tmp_path / "lab.glb").read_bytes()[:4] == b"glTF"
    done = pilsim("worlds", "pilsun", "--export", "lab.stl", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "needs an ending of" in done.stderr


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (Worlds("nowhere"), "world is 'nowhere', needs one of"),
        (Worlds("pilsun", difficulty=1.5), "difficulty is 1.5"),
        (Worlds(export=Path("lab.glb")), "needs the name of one world"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Worlds, said: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=said):
        command.run()
    with pytest.raises(ValueError, match="is a file, needs a folder"):
        survey("pilsun", 0.5, 0, pictures=Path(__file__))
