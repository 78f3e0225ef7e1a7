"""Studies: cells are stored, resumed, drawn and summarized."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.cli.study import Study
from sim.studies import clique_graphs, hypothesis_count, image_tracklets
from sim.studies.clique_graphs import FORMS, STARTS, Run
from sim.studies.hypothesis_count import I_BLS_MAX, K_H, Cell
from sim.studies.image_tracklets import SETTINGS, ImageCell, ImageMaterial
from sim.studies.study_cells import read_cells, write_cells


def counted(spread: float) -> list[Cell]:
    """Two repetitions of every setting; time is linear in the moves, the spread falls with K_H."""
    return [Cell("made up", k, m, r, k * m / 1000, 0.9 + (spread / k) * (r - 0.5)) for k in K_H for m in I_BLS_MAX for r in range(2)]


def searched(warm: float) -> list[Run]:
    """Small graphs take half the time, and a warm start has `warm` more MOTA."""
    return [
        Run("made up", form, start, r, 1.0 if FORMS[form] > 1 else 2.0, 0.001 * (not STARTS[start]), 0.9 + warm * STARTS[start] + 0.01 * r)
        for form, start, r in itertools.product(FORMS, STARTS, range(2))
    ]


def seen(gain: float) -> list[ImageCell]:
    """Runs with images have `gain` more MOTA and less IDF1."""
    own = {setting: gain * (SETTINGS[setting] is not None) for setting in SETTINGS}
    return [ImageCell("made up", name, r, 0.9 + gained + 0.01 * r, 0.8 - gained, r, 1.0) for name, gained in own.items() for r in (0, 1)]


def test_panels_are_means_and_extremes_over_repetitions() -> None:
    found = hypothesis_count.FORM.panel(counted(0.02), "mota")
    np.testing.assert_allclose(found[..., 0], 0.9)
    np.testing.assert_allclose(found[..., 2] - found[..., 1], np.repeat(0.02 / np.array(K_H)[:, None], len(I_BLS_MAX), axis=1))
    np.testing.assert_allclose(clique_graphs.FORM.panel(searched(0.02), "mota")[0, 0], [0.925, 0.92, 0.93])


def test_notes_say_what_the_cells_show() -> None:
    text = hypothesis_count.FORM.summary(counted(0.02))
    assert "cost 4.00 times the time" in text
    # The mean of K_H is 106/7: twice 7.57 s is a straight line.
    assert "moves 1001 to 2000 cost 15.14 s, moves 501 to 1000 7.57 s" in text
    assert "falls with K_H" in text
    assert "does not fall" in hypothesis_count.FORM.summary(counted(0.0))
    text = clique_graphs.FORM.summary(searched(0.02))
    assert "small graphs against one graph: 0.50 times the time, +0.0000 points of weight, +0.0000 of MOTA (within the spread)" in text
    assert "a warm start against a cold one (one graph): 1.00 times the time, +0.1000 points of weight, +0.0200 of MOTA\n" in text + "\n"
    assert text.count("within the spread") == 1
    assert clique_graphs.FORM.summary(searched(0.005)).count("within the spread") == 3
    without = [replace(r, gap=float("nan")) for r in searched(0.02)]
    assert "0.50 times the time, weights without proof, +0.0000 of MOTA" in clique_graphs.FORM.summary(without)
    assert image_tracklets.FORM.summary(seen(0.02)).count("MOTA 2 better and 0 worse; IDF1 0 better and 2 worse") == len(SETTINGS) - 1


@pytest.mark.parametrize(("study", "cells"), [(hypothesis_count, counted), (clique_graphs, searched), (image_tracklets, seen)])
def test_cells_are_read_back_drawn_and_named_where_they_are_damaged(study: Any, cells: Callable[[float], list[Any]], tmp_path: Path) -> None:
    made, path = cells(0.02), tmp_path / "cells.csv"
    write_cells(path, made)
    assert read_cells(path, study.FORM.kind) == made
    study.FORM.draw(made, tmp_path / "plot.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cells.csv", "plot.png"]
    path.write_text(path.read_text().replace(",0,", ",none,", 1))
    with pytest.raises(ValueError, match="line 2: is no cell"):
        read_cells(path, study.FORM.kind)


def repeated(study: Callable[[], list[Any]], file: Path) -> list[Any]:
    """The cells of a study, which a second call reads from the file."""
    first = study()
    stamp = file.stat().st_mtime_ns
    assert study() == first
    assert file.stat().st_mtime_ns == stamp
    return first


def test_a_cell_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hypothesis_count, "K_H", (1, 3))
    monkeypatch.setattr(hypothesis_count, "I_BLS_MAX", (200,))
    material = hypothesis_count.synthetic(6)
    first = repeated(lambda: list(hypothesis_count.study(tmp_path, [material], 1)), tmp_path / "cells.csv")
    (tmp_path / "cells.csv").unlink()
    assert [cell.mota for cell in hypothesis_count.study(tmp_path, [material], 1)] == [cell.mota for cell in first]


@pytest.mark.soak
def test_a_run_of_graphs_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hypothesis_count, "PEOPLE", 6)
    monkeypatch.setattr(clique_graphs, "PROVED", 4)
    material = hypothesis_count.synthetic(6)
    first = repeated(lambda: list(clique_graphs.study(tmp_path, [material], 1)), tmp_path / "runs.csv")
    assert [clique_graphs.FORM.key(r) for r in first] == [("synthetic crowd", form, start, 0) for form in FORMS for start in STARTS]
    assert all(0 <= r.gap < 0.05 and r.seconds > 0 for r in first)
    again = clique_graphs.run_cell(material, first[1].form, first[1].start, 0)
    assert (again.gap, again.mota) == (first[1].gap, first[1].mota)


@pytest.mark.render
def test_a_run_on_images_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_tracklets, "CROWD", replace(image_tracklets.CROWD, people=4, robots=1, width=256))
    monkeypatch.setattr(image_tracklets, "SETTINGS", {name: SETTINGS[name] for name in ("no images", "the paper's")})
    chosen = [ImageMaterial("rendered crowd", tmp_path)]
    assert image_tracklets.count_runs(chosen, 1) == 2
    assert len(repeated(lambda: list(image_tracklets.study(tmp_path, chosen, 6, 1)), tmp_path / "cells.csv")) == 2


def test_a_bad_folder_and_another_study_are_refused_before_the_first_run(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds nothing that pilsim opens"):
        Study("images", tmp_path / "out", pets=tmp_path).run()
    assert not (tmp_path / "out").exists()
    (tmp_path / "frames.txt").write_text("frames 7\n")
    with pytest.raises(ValueError, match="holds another study"):
        Study("fig4", tmp_path, frames=8).run()
