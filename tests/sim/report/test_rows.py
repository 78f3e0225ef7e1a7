"""Rows of stress tests: reading, and damaged rows, which are refused by file and line."""

import json
from pathlib import Path
from typing import Any

import pytest

from sim.report.page import write_report
from sim.report.rows import read_beside, read_rows
from tests.sim import stress_rows


def test_rows_by_sweep_setting_and_seed(tmp_path: Path) -> None:
    rows = stress_rows.density(3) + stress_rows.terrain(2)
    rows[1] = stress_rows.failed(rows[1], "ValueError: no")
    read = read_rows(stress_rows.write(tmp_path, list(reversed(rows))))
    assert (len(read.rows), len(read.failed), read.trackers, read.torn) == (18, 1, ["default"], False)
    terrain, density = read.sweeps()
    assert [s.value for s in density.settings] == list(stress_rows.PEOPLE)
    assert [s.id for s in density.settings] == [f"density/{k}" for k in range(4)]
    assert (density.numeric, terrain.numeric) == (True, False)
    assert [row.seed for row in density.settings[0].of("default")] == [0, 2]
    assert density.settings[3].scores("default", "truths") == dict.fromkeys(range(3), 6000)
    assert density.settings[3].scores("default", "visible_recall") == dict.fromkeys(range(3), 0.8)
    assert density.settings[3].scores("default", "nonsense") == {}
    rows = [stress_rows.row("robots", k, 11 - k, 0) for k in range(11)]
    read = read_rows(stress_rows.write(tmp_path, list(reversed(rows)), tail='{"schema": 1, "id": "dens'))
    (sweep,) = read.sweeps()
    assert [s.id for s in sweep.settings] == [f"robots/{k}" for k in range(11)]
    assert [s.value for s in sweep.ordered()] == list(range(1, 12))
    # A last line that is cut off is left out.
    assert (len(read.rows), read.torn) == (11, True)


@pytest.mark.render
def test_folders_beside_each_other_are_on_one_page(tmp_path: Path) -> None:
    folders = [stress_rows.write(tmp_path / name, stress_rows.density(2)) for name in ("independent", "fairmot")]
    read = read_beside(folders)
    assert (read.trackers, len(read.rows), read.folder) == (["independent", "fairmot"], 16, folders[0])
    text = write_report(folders[0], tmp_path / "page.html", folders[1:]).read_text(encoding="utf-8")
    assert [name in text for name in ("MOTA of independent", "MOTA of fairmot", "pilsim compare")] == [True, True, False]
    with pytest.raises(ValueError, match="given twice"):
        read_beside([folders[0], folders[0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 2}, "results.jsonl:2: schema is 2, this version reads 1"),
        ({"schema": None}, "results.jsonl:2: schema is None"),
        ({"id": None}, "results.jsonl:2: id is missing, needs str"),
        ({"seed": "4"}, "results.jsonl:2: seed is str, needs int"),
        ({"seed": True}, "results.jsonl:2: seed is bool, needs int"),
        ({"tracker": {}}, "results.jsonl:2: tracker has no name"),
        ({"scores": {"mota": "high"}}, "results.jsonl:2: scores: mota is 'high', needs a finite number"),
        ({"causes": {"misses": 3}}, "results.jsonl:2: causes: misses: a JSON int, needs an object"),
        ({"ladder": {"mota": {"poses": []}}}, "results.jsonl:2: ladder: mota: poses is"),
        ({"moments": [1]}, "results.jsonl:2: moments needs objects"),
        ({"seed": 0, "value": 5, "id": "density/0"}, "results.jsonl:2: density/0, seed 0, tracker default is there already"),
    ],
)
def test_bad_rows(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    rows = [stress_rows.row("density", 0, 5, 0), stress_rows.row("density", 1, 20, 0) | changes]
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace("[", r"\[")):
        read_rows(stress_rows.write(tmp_path, rows))


def test_bad_files(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nowhere: no such folder"):
        read_rows(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"results\.jsonl: no such file; `pilsim stress"):
        read_rows(tmp_path)
    with pytest.raises(ValueError, match="holds no row"):
        read_rows(stress_rows.write(tmp_path, []))
    with pytest.raises(ValueError, match="holds no whole row"):
        read_rows(stress_rows.write(tmp_path, [], tail="{"))
    whole = json.dumps(stress_rows.row("density", 0, 5, 0))
    for middle, message in (("{torn", "jsonl:2: not JSON"), ("[1]", "jsonl:2: a JSON list, needs")):
        (tmp_path / "results.jsonl").write_text(f"{whole}\n{middle}\n{whole}\n")
        with pytest.raises(ValueError, match=message):
            read_rows(tmp_path)


def test_an_id_has_one_value(tmp_path: Path) -> None:
    rows = [stress_rows.row("density", 0, 5, 0), stress_rows.row("density", 0, 6, 1)]
    with pytest.raises(ValueError, match=r"jsonl:2: density/0 is people = 6, but people = 5 in .*jsonl:1"):
        read_rows(stress_rows.write(tmp_path, rows)).sweeps()
