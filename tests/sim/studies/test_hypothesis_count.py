"""The study of K_H and i_bls^max: cells are stored, resumed, drawn and summarized."""

from pathlib import Path

import numpy as np
import pytest

from sim.cli.study import Study
from sim.studies import hypothesis_count
from sim.studies.hypothesis_count import I_BLS_MAX, K_H, Cell


def cells(spread: float) -> list[Cell]:
    """Two repetitions of every setting; time is linear in the moves, the spread falls with K_H."""
    return [Cell("made up", k, m, r, k * m / 1000, 0.9 + (spread / k) * (r - 0.5)) for k in K_H for m in I_BLS_MAX for r in range(2)]


def test_written_cells_are_read(tmp_path: Path) -> None:
    made = cells(0.02)
    hypothesis_count.write_cells(tmp_path / "cells.csv", made)
    assert hypothesis_count.read_cells(tmp_path / "cells.csv", Cell) == made
    assert [p.name for p in tmp_path.iterdir()] == ["cells.csv"]


def test_a_damaged_row_is_named(tmp_path: Path) -> None:
    path = tmp_path / "cells.csv"
    hypothesis_count.write_cells(path, cells(0.02)[:2])
    path.write_text(path.read_text().replace(",500,", ",many,", 1))
    with pytest.raises(ValueError, match="line 2: is no cell"):
        hypothesis_count.read_cells(path, Cell)


def test_panels_and_summary() -> None:
    seconds, mota, spread = hypothesis_count.panels(cells(0.02))
    np.testing.assert_allclose(seconds, np.outer(K_H, I_BLS_MAX) / 1000)
    np.testing.assert_allclose(mota, 0.9)
    np.testing.assert_allclose(spread, np.repeat(0.02 / np.array(K_H)[:, None], len(I_BLS_MAX), axis=1))
    text = hypothesis_count.summary(cells(0.02))
    assert "cost 4.00 times the time" in text
    # The mean of K_H is 106/7: twice 7.57 s is a straight line.
    assert "moves 1001 to 2000 cost 15.14 s, moves 501 to 1000 7.57 s" in text
    assert "falls with K_H" in text
    assert "does not fall" in hypothesis_count.summary(cells(0.0))


def test_a_cell_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hypothesis_count, "K_H", (1, 3))
    monkeypatch.setattr(hypothesis_count, "I_BLS_MAX", (200,))
    material = hypothesis_count.synthetic(6)
    first = [list(c) for c in hypothesis_count.study(tmp_path, [material], 1)][-1]
    stamp = (tmp_path / "cells.csv").stat().st_mtime_ns
    again = [list(c) for c in hypothesis_count.study(tmp_path, [material], 1)][-1]
    assert again == first
    assert (tmp_path / "cells.csv").stat().st_mtime_ns == stamp
    assert hypothesis_count.run_cell(material, 3, 200, 0).mota == first[1].mota


def test_the_plot_is_written(tmp_path: Path) -> None:
    hypothesis_count.draw(cells(0.02), tmp_path / "fig4.png")
    assert [p.name for p in tmp_path.iterdir()] == ["fig4.png"]


def test_another_study_is_refused(tmp_path: Path) -> None:
    (tmp_path / "frames.txt").write_text("frames 7\n")
    with pytest.raises(ValueError, match="holds another study"):
        Study("fig4", tmp_path, frames=8).run()
