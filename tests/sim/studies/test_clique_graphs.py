"""The study of the graphs and starts of the clique search: runs are stored, resumed, drawn and summarized."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.studies import clique_graphs, hypothesis_count
from sim.studies.clique_graphs import FORMS, STARTS, Run


def runs(warm: float) -> list[Run]:
    """Two repetitions of each choice: small graphs take half the time, and a warm start has `warm` more MOTA."""
    return [
        Run("made up", form, start, r, 1.0 if FORMS[form] > 1 else 2.0, 0.001 * (not STARTS[start]), 0.9 + warm * STARTS[start] + 0.01 * r)
        for form, start, r in itertools.product(FORMS, STARTS, range(2))
    ]


def test_panels_and_summary() -> None:
    seconds, gap, mota = clique_graphs.panels(runs(0.02))
    np.testing.assert_allclose(seconds[..., 0], [[1, 1], [2, 2]])
    np.testing.assert_allclose(gap[..., 0], [[0, 0.001], [0, 0.001]])
    np.testing.assert_allclose(mota[0, 0], [0.925, 0.92, 0.93])
    text = clique_graphs.summary(runs(0.02))
    assert "small graphs against one graph: 0.50 times the time, +0.0000 points of weight, +0.0000 of MOTA (within the spread)" in text
    assert "a warm start against a cold one (one graph): 1.00 times the time, +0.1000 points of weight, +0.0200 of MOTA\n" in text + "\n"
    assert text.count("within the spread") == 1
    assert clique_graphs.summary(runs(0.005)).count("within the spread") == 3
    without = [replace(r, gap=float("nan")) for r in runs(0.02)]
    assert "0.50 times the time, weights without proof, +0.0000 of MOTA" in clique_graphs.summary(without)


def test_the_plot_is_written(tmp_path: Path) -> None:
    clique_graphs.draw(runs(0.02), tmp_path / "graphs.png")
    assert [p.name for p in tmp_path.iterdir()] == ["graphs.png"]


@pytest.mark.soak
def test_a_run_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hypothesis_count, "PEOPLE", 6)
    monkeypatch.setattr(clique_graphs, "PROVED", 4)
    material = hypothesis_count.synthetic(6)
    first = [list(r) for r in clique_graphs.study(tmp_path, [material], 1)][-1]
    assert [r.key for r in first] == [("synthetic crowd", form, start, 0) for form in FORMS for start in STARTS]
    assert all(0 <= r.gap < 0.05 and r.seconds > 0 for r in first)
    stamp = (tmp_path / "runs.csv").stat().st_mtime_ns
    assert [list(r) for r in clique_graphs.study(tmp_path, [material], 1)][-1] == first
    assert (tmp_path / "runs.csv").stat().st_mtime_ns == stamp
    again = clique_graphs.run_cell(material, *first[1].key[1:])
    assert (again.gap, again.mota) == (first[1].gap, first[1].mota)


def test_a_damaged_row_is_named(tmp_path: Path) -> None:
    hypothesis_count.write_cells(tmp_path / "runs.csv", runs(0.0)[:1])
    (tmp_path / "runs.csv").write_text((tmp_path / "runs.csv").read_text().replace(",1.0,", ",soon,"))
    with pytest.raises(ValueError, match="line 2: is no cell"):
        hypothesis_count.read_cells(tmp_path / "runs.csv", Run)
