"""The page of a prediction: well-formed, the figures of its file, and damaged files, which are refused by field."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest

from sim.confidence_intervals import one_more_interval
from sim.prediction import FIGURES, FITTED, Forecast, Outcome, Prediction, PredictionRecord, read_prediction
from sim.report.prediction_page import plots, write_prediction_page
from tracker.detector_models.model import INDEPENDENT
from tracker.io.json_files import json_text


def run(misses: int, false: int, switches: int, occluded: int) -> Outcome:
    """A run of 100 true positions, whose MOTA follows from its errors."""
    figures = dict.fromkeys(FIGURES, 0.5) | {"misses": misses, "false_positives": false, "switches": switches, "truths": 100.0}
    figures["mota"] = 1 - (misses + false + switches) / 100
    causes = {
        "misses": {"occluded": occluded, "detector missed": misses - occluded},
        "false positives": {"clutter": false},
        "switches": {"new track": switches},
    }
    return Outcome({name: float(value) for name, value in figures.items()}, causes)


def made(real: bool = True, seeds: int = 2) -> PredictionRecord:
    """A prediction by two detectors, which is known in advance."""
    twins = {FITTED: [run(6 + 2 * k, 2, 1, 4) for k in range(seeds)], INDEPENDENT: [run(1, 0, 0, 1)] * seeds}
    forecasts = {name: Forecast.of(runs) for name, runs in twins.items()}
    found = Prediction(forecasts, run(20, 4, 1, 17) if real else None, (0, 40), (40, 80), 7, ("C1", "C2"), {"stature": 0.04})
    command = "pilsim predict 'hall & <yard>'"
    return PredictionRecord("hall & <yard>", "default", {"delay": 5}, tuple(range(3, 3 + seeds)), command, {"pilsim": "0.4.0"}, found)


def written(folder: Path, record: PredictionRecord) -> Path:
    path = folder / "hall.json"
    path.write_text(json_text(record.to_dict(), indent=1))
    return path


pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = written(tmp_path_factory.mktemp("prediction"), made())
    write_prediction_page(path)
    return path


def test_a_file_that_is_read_has_what_was_written(file: Path) -> None:
    assert read_prediction(file) == made()


def test_the_page_is_well_formed_and_has_the_figures(file: Path) -> None:
    text = file.with_suffix(".html").read_text(encoding="utf-8")
    page = ElementTree.fromstring(text.removeprefix("<!DOCTYPE html>"))
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in page.iter("tr")}
    # 7 misses, 2 false and 1 switch on average; Student's t of one degree of freedom makes the interval reach 1.
    bound = one_more_interval([0.91, 0.89], (None, 1.0))
    assert rows["MOTA"] == [f"0.900 ({bound.low:.3f} to 1.000)", "0.990 (0.990 to 0.990)", "0.750"]
    assert rows["misses: occluded"] == ["4.0 (4.0 to 4.0)", "1.0 (1.0 to 1.0)", "17"]
    assert [rows[seed][0] for seed in ("3", "4")] == ["0.990", "0.990"]
    assert "Misses, occluded: 4.0 predicted by fitted, 17 real." in text
    assert "MOTA +0.150" in text
    assert "hall &amp; &lt;yard&gt;" in text


def test_plots_lie_beside_it(file: Path) -> None:
    folder = file.with_name("hall-report")
    names = {plot.name for plot in plots(read_prediction(file).found)}
    assert names == {"mota", "idf1", "hota", "misses", "false-positives", "switches"}
    assert {path.name for path in folder.iterdir()} == {f"{name}.{ending}" for name in names for ending in ("png", "csv")}
    with (folder / "misses.csv").open() as table:
        counts = {(row["detector"], row["part"]): float(row["misses"]) for row in csv.DictReader(table)}
    assert counts["real", "occluded"] == 17
    assert counts["fitted", "detector missed"] == 3


def test_a_page_without_real_boxes_and_of_one_twin(tmp_path: Path) -> None:
    path = written(tmp_path, made(real=False, seeds=1))
    text = write_prediction_page(path, tmp_path / "other.html").read_text(encoding="utf-8")
    ElementTree.fromstring(text.removeprefix("<!DOCTYPE html>"))
    assert "no real boxes to compare with" in text
    assert "One twin a detector has no interval." in text
    with pytest.raises(ValueError, match="is the file of the prediction"):
        write_prediction_page(path, path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": None}, "schema is None, this version reads 1"),
        ({"predicted": {}}, "predicted is empty"),
        ({"predicted": {"fitted": []}}, "predicted: fitted: a JSON list, needs an object"),
        ({"real": {"figures": {"mota": "high"}, "causes": {}}}, "real: figures: mota is 'high', needs a finite number or null"),
        ({"real": {"figures": {}, "causes": {"misses": {}}}}, "real: causes: false positives is missing"),
        ({"frames": [1]}, "frames has 1 values, needs 2"),
        ({"seeds": [0.5]}, "seeds holds other values than integers"),
        ({"people": True}, "people is bool, needs int"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    path = written(tmp_path, made())
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ValueError, match=said) as caught:
        write_prediction_page(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert [one.name for one in tmp_path.iterdir()] == ["hall.json"]
