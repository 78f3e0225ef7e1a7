"""Studies: cells are stored, resumed, drawn and summarized."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim import studies
from sim.cli.study import Study
from sim.studies import FORMS, STARTS, STUDIES, TRACKLETS, Cell, Cells, StudyForm, synthetic

FIG4, GRAPHS, IMAGES = STUDIES.values()
K_H, I_BLS_MAX = (values for _, values in FIG4.settings.values())


def counted(spread: float) -> Cells:
    """Two repetitions of every setting; time is linear in the moves, the spread falls with K_H."""
    return [Cell("made up", (k, m), r, (k * m / 1000, 0.9 + (spread / k) * (r - 0.5))) for k in K_H for m in I_BLS_MAX for r in range(2)]


def searched(warm: float) -> Cells:
    """Small graphs take half the time, and a warm start has `warm` more MOTA."""
    return [
        Cell("made up", (form, start), r, (1.0 if FORMS[form] > 1 else 2.0, 0.001 * (not STARTS[start]), 0.9 + warm * STARTS[start] + 0.01 * r))
        for form, start, r in itertools.product(FORMS, STARTS, range(2))
    ]


def seen(gain: float) -> Cells:
    """Runs with images have `gain` more MOTA and less IDF1."""
    own = {setting: gain * (TRACKLETS[setting] is not None) for setting in TRACKLETS}
    return [Cell("made up", (name,), r, (0.9 + gained + 0.01 * r, 0.8 - gained, r, 1.0)) for name, gained in own.items() for r in (0, 1)]


def test_panels_are_means_and_extremes_over_repetitions() -> None:
    found = FIG4.panel(counted(0.02), "mota")
    np.testing.assert_allclose(found[..., 0], 0.9)
    np.testing.assert_allclose(found[..., 2] - found[..., 1], np.repeat(0.02 / np.array(K_H)[:, None], len(I_BLS_MAX), axis=1))
    np.testing.assert_allclose(GRAPHS.panel(searched(0.02), "mota")[0, 0], [0.925, 0.92, 0.93])


def test_notes_say_what_the_cells_show() -> None:
    text = FIG4.summary(counted(0.02))
    assert "cost 4.00 times the time" in text
    # The mean of K_H is 106/7: twice 7.57 s is a straight line.
    assert "moves 1001 to 2000 cost 15.14 s, moves 501 to 1000 7.57 s" in text
    assert "falls with K_H" in text
    assert "does not fall" in FIG4.summary(counted(0.0))
    text = GRAPHS.summary(searched(0.02))
    assert "small graphs against one graph: 0.50 times the time, +0.0000 points of weight, +0.0000 of MOTA (within the spread)" in text
    assert "a warm start against a cold one (one graph): 1.00 times the time, +0.1000 points of weight, +0.0200 of MOTA\n" in text + "\n"
    assert text.count("within the spread") == 1
    assert GRAPHS.summary(searched(0.005)).count("within the spread") == 3
    without = [replace(r, measured=(r.measured[0], float("nan"), r.measured[2])) for r in searched(0.02)]
    assert "0.50 times the time, weights without proof, +0.0000 of MOTA" in GRAPHS.summary(without)
    assert IMAGES.summary(seen(0.02)).count("MOTA 2 better and 0 worse; IDF1 0 better and 2 worse") == len(TRACKLETS) - 1


@pytest.mark.parametrize(("study", "cells"), [(FIG4, counted), (GRAPHS, searched), (IMAGES, seen)])
def test_cells_are_read_back_drawn_and_named_where_they_are_damaged(study: StudyForm, cells: Callable[[float], Cells], tmp_path: Path) -> None:
    made, path = cells(0.02), tmp_path / "cells.csv"
    study.write(path, made)
    assert study.read(path) == made
    study.draw(made, tmp_path / "plot.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cells.csv", "plot.png"]
    path.write_text(path.read_text().replace(",0,", ",none,", 1))
    with pytest.raises(ValueError, match="line 2: is no cell"):
        study.read(path)


def test_cells_of_earlier_versions_are_read(tmp_path: Path) -> None:
    path = tmp_path / "cells.csv"
    path.write_text("data,setting,repetition,mota,idf1,switches,seconds\nrendered crowd,no images,1,0.9,0.8,3,2.5\n")
    assert IMAGES.read(path) == [Cell("rendered crowd", ("no images",), 1, (0.9, 0.8, 3.0, 2.5))]


def repeated(study: Callable[[], Cells], file: Path) -> Cells:
    """The cells of a study, which a second call reads from the file."""
    first = study()
    stamp = file.stat().st_mtime_ns
    assert study() == first
    assert file.stat().st_mtime_ns == stamp
    return first


def test_a_cell_is_reproducible_and_not_repeated(tmp_path: Path) -> None:
    small = replace(FIG4, settings={"k_h": ("K_H", (1, 3)), "i_bls_max": ("i_bls^max", (200,))})
    material = synthetic(6)
    first = repeated(lambda: list(small.cells(tmp_path, [material], 1)), tmp_path / "cells.csv")
    again = StudyForm.cells(small, tmp_path, [replace(material, sequence=lambda _: pytest.fail("a stored cell is run again"))], 1)
    assert list(again) == first
    (tmp_path / "cells.csv").unlink()
    assert [cell.measured[1] for cell in small.cells(tmp_path, [material], 1)] == [cell.measured[1] for cell in first]


@pytest.mark.soak
def test_a_run_of_graphs_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(studies, "PEOPLE", 6)
    monkeypatch.setattr(studies, "PROVED", 4)
    material = synthetic(6)
    first = repeated(lambda: list(GRAPHS.cells(tmp_path, [material], 1)), tmp_path / "runs.csv")
    assert [(r.data, *r.settings, r.repetition) for r in first] == [("synthetic crowd", form, start, 0) for form in FORMS for start in STARTS]
    assert all(0 <= r.measured[1] < 0.05 and r.measured[0] > 0 for r in first)
    assert GRAPHS.run(material, 0, *first[1].settings)[1:] == first[1].measured[1:]


@pytest.mark.render
def test_a_run_on_images_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(studies, "CROWD", replace(studies.CROWD, people=4, robots=1, width=256))
    small = replace(IMAGES, settings={"setting": ("setting", ("no images", "the paper's"))})
    chosen = small.materials(tmp_path, None, 6)
    assert small.count(chosen, 1) == 2
    assert len(repeated(lambda: list(small.cells(tmp_path, chosen, 1)), tmp_path / "cells.csv")) == 2


def test_a_bad_folder_and_another_study_are_refused_before_the_first_run(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds nothing that pilsim opens"):
        Study("images", tmp_path / "out", pets=tmp_path).run()
    assert not (tmp_path / "out").exists()
    (tmp_path / "frames.txt").write_text("frames 7\n")
    with pytest.raises(ValueError, match="holds another study"):
        Study("fig4", tmp_path, frames=8).run()
