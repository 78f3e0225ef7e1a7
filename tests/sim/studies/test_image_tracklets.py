"""The study of image tracklets: runs are stored, resumed, drawn and summarized."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.cli.study import Study
from sim.studies import image_tracklets
from sim.studies.image_tracklets import SETTINGS, ImageCell, ImageMaterial


def cells(gain: float) -> list[ImageCell]:
    """Two repetitions of each setting; runs with images have `gain` more MOTA and less IDF1."""
    return [
        ImageCell(
            "made up", setting, r, 0.9 + gain * (SETTINGS[setting] is not None) + 0.01 * r, 0.8 - gain * (SETTINGS[setting] is not None), r, 1.0
        )
        for setting, r in itertools.product(SETTINGS, range(2))
    ]


def test_summary_and_differences() -> None:
    np.testing.assert_allclose(image_tracklets.differences(cells(0.02), "L_c = 8"), [[0.02, -0.02], [0.02, -0.02]])
    lines = image_tracklets.summary(cells(0.02)).splitlines()
    assert lines[2].split() == ["no", "images", "0.9050", "0.8000", "0.5", "1.0"]
    assert lines[3].endswith("2, 0; 0, 2")
    assert image_tracklets.summary(cells(0.0)).count("0, 0; 0, 0") == len(SETTINGS) - 1
    # A repetition that was interrupted does not count.
    assert image_tracklets.summary(cells(0.02)[:-1]).splitlines()[2].split() == ["no", "images", "0.9000", "0.8000", "0.0", "1.0"]
    # A repetition without its run without images has no difference.
    assert image_tracklets.differences(cells(0.02)[2:], "the paper's").shape == (0, 2)


def test_the_plot_is_written(tmp_path: Path) -> None:
    image_tracklets.draw(cells(0.02), tmp_path / "images.png")
    assert [p.name for p in tmp_path.iterdir()] == ["images.png"]


def test_a_bad_folder_is_refused_before_the_first_run(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds nothing that pilsim opens"):
        Study("images", tmp_path / "out", pets=tmp_path).run()
    assert not (tmp_path / "out").exists()


@pytest.mark.render
def test_a_run_is_reproducible_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_tracklets, "CROWD", replace(image_tracklets.CROWD, people=4, robots=1, width=256))
    monkeypatch.setattr(image_tracklets, "SETTINGS", {name: SETTINGS[name] for name in ("no images", "the paper's")})
    chosen = [ImageMaterial("rendered crowd", tmp_path)]
    assert image_tracklets.count_runs(chosen, 1) == 2
    first = list(image_tracklets.study(tmp_path, chosen, 6, 1))[-1]
    stamp = (tmp_path / "cells.csv").stat().st_mtime_ns
    assert list(image_tracklets.study(tmp_path, chosen, 6, 1))[-1] == first
    assert (tmp_path / "cells.csv").stat().st_mtime_ns == stamp
    again = image_tracklets.run_cell(chosen[0], 6, "the paper's", 0)
    assert replace(again, seconds=first[1].seconds) == first[1]
