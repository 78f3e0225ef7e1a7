"""Paired comparison of trackers: differences computed by hand, and runs that are refused."""

import copy
import json
from pathlib import Path
from typing import Any

import cv2
import pytest

from sim.cli.compare import Compare
from sim.report.comparison import EVERY, compare_paired, comparison_text, draw_comparison, to_json
from tests.sim import stress_rows


def better(rows: list[dict[str, Any]], tracker: str = "default") -> list[dict[str, Any]]:
    """The same runs by a tracker that has 0.02 more MOTA, 0.03 at odd seeds, and 1 cm more ATE; IDF1 is the same."""
    out = copy.deepcopy(rows)
    for row in out:
        row["tracker"]["name"] = tracker
        if row["scores"]:
            row["scores"]["mota"] += 0.02 + 0.01 * (row["seed"] % 2)
            row["scores"]["ate_m"] += 0.01
    return out


def test_two_folders(tmp_path: Path) -> None:
    before = stress_rows.density(4)
    found = compare_paired([stress_rows.write(tmp_path / "a", before), stress_rows.write(tmp_path / "b", better(before))])
    (pair,) = found.pairs
    assert (found.reference, pair.tracker, pair.unpaired, pair.failed) == ("a", "b", (0, 0), 0)
    by = {(one.id, one.measure.name): one for one in pair.differences}
    assert len(by) == 15
    whole = by[EVERY, "mota"]
    # Differences a seed are 0.02, 0.03, 0.02, 0.03: mean 0.025, s = 0.0057735, t(3) = 3.182446.
    assert whole.interval.mean == pytest.approx(0.025)
    assert whole.interval.low == pytest.approx(0.025 - 3.182446 * 0.0057735 / 2, abs=1e-6)
    assert (whole.verdict, whole.pairs, whole.interval.count) == ("better", 16, 4)
    assert by[EVERY, "idf1"].verdict == "identical"
    assert by["density/2", "ate_m"].verdict == "worse"
    text = comparison_text(found)
    assert "better (4 seeds)" in text
    assert "+0.025 (+0.016 to +0.034)" in text


def test_three_trackers_of_one_folder(tmp_path: Path) -> None:
    rows = stress_rows.density(3)
    found = compare_paired([stress_rows.write(tmp_path, rows + better(rows, "mine") + [row | {"tracker": {"name": "same"}} for row in rows])])
    assert [pair.tracker for pair in found.pairs] == ["mine", "same"]
    assert {one.verdict for one in found.pairs[1].differences} == {"identical"}
    draw_comparison(found, tmp_path / "new" / "out.png")
    image = cv2.imread(str(tmp_path / "new" / "out.png"))
    assert image is not None
    assert image.std() > 10
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["out.png"]


def test_rows_without_a_partner_and_failed_ones_are_counted(tmp_path: Path) -> None:
    rows = stress_rows.density(3)
    other = better(rows)[:-2]
    other[0] = stress_rows.failed(other[0], "ValueError: no")
    found = compare_paired(
        [stress_rows.write(tmp_path / "a", rows), stress_rows.write(tmp_path / "b", [*other, stress_rows.row("density", 0, 5, 77)])]
    )
    (pair,) = found.pairs
    assert (pair.unpaired, pair.failed) == ((2, 1), 1)
    assert next(one.pairs for one in pair.differences if one.id == EVERY) == 9
    assert "(2 runs of a without a partner; 1 run of b without a partner; 1 pair with a failed run left out)" in comparison_text(found)


def test_seeds_and_not_settings_are_independent(tmp_path: Path) -> None:
    """Four settings of one seed count as one value, which has no interval."""
    rows = stress_rows.density(1)
    found = compare_paired([stress_rows.write(tmp_path / "a", rows), stress_rows.write(tmp_path / "b", better(rows))])
    assert {one.verdict for one in found.pairs[0].differences} == {"one seed"}
    assert json.loads(json.dumps(to_json(found)))["entrants"][0]["differences"][0]["low"] is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scenario": {"world": "hills"}}, "density/0, seed 0 is another scenario: frames is 60 and None"),
        ({"value": 6}, "density/0, seed 0 is another scenario: value is 5 and 6"),
        ({"rendered": True}, "density/0, seed 0 is another scenario: rendered is False and True"),
        ({"seed": 9}, r"a and b share no setting and seed: density/0 of seed 0 …, but density/0 of seed 9"),
    ],
)
def test_other_runs_are_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    row = stress_rows.row("density", 0, 5, 0)
    with pytest.raises(ValueError, match=message):
        compare_paired([stress_rows.write(tmp_path / "a", [row]), stress_rows.write(tmp_path / "b", [row | changes])])


def test_a_comparison_needs_two_trackers(tmp_path: Path) -> None:
    folder = stress_rows.write(tmp_path / "a", stress_rows.density(1))
    with pytest.raises(ValueError, match=r"holds one tracker \(default\), needs another"):
        compare_paired([folder])
    with pytest.raises(ValueError, match="the same folder is given twice"):
        compare_paired([folder, folder])
    found = compare_paired([folder, stress_rows.write(tmp_path / "x" / "a", better(stress_rows.density(1)))])
    assert found.reference == str(folder)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = stress_rows.density(2)
    folders = stress_rows.write(tmp_path / "a", rows), stress_rows.write(tmp_path / "b", better(rows))
    Compare(folders, json=True).run()
    assert json.loads(capsys.readouterr().out)["entrants"][0]["differences"][0]["verdict"] in ("better", "no difference seen")
