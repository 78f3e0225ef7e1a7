"""The benchmark of predictions: its nearest-neighbour tracker follows people, its rank correlations have known values, and a row is made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sim.prediction import FIGURES, Forecast, Outcome, Prediction, outcome
from sim.stress.tracker_under_test import TrackerUnderTest
from tests.benchmarks import prediction
from tests.benchmarks.room import room


def test_the_nearest_neighbour_follows_most_people_of_a_room() -> None:
    recording = room(0, frames=30)
    found = outcome(recording, TrackerUnderTest(prediction.NEAREST), "room/0").figures
    # Each person is found after 3 frames at the earliest; the bound is far below what the default tracker has.
    assert found["mota"] > 0.4
    assert found["truths"] == 30 * 15


def made(*mota: float) -> dict[str, Prediction]:
    """Predictions of trackers: real figures as given, predicted ones half as much lower than 1."""
    out = {}
    for k, value in enumerate(mota):
        real, twin = dict.fromkeys(FIGURES, value), dict.fromkeys(FIGURES, 1 - (1 - value) / 2)
        twins = {name: Forecast.of([Outcome(twin, {})]) for name in prediction.DETECTORS}
        out[str(k)] = Prediction(twins, Outcome(real, {}), (0, 2), (2, 4), 3, ("C1",))
    return out


def test_ranks_of_a_monotone_prediction_are_perfect() -> None:
    table = {"a": made(0.9, 0.5, 0.2), "b": made(0.8, 0.4, 0.3), "c": made(0.7, 0.1, 0.6)}
    assert prediction.ranks(table, "fitted", "mota") == "| fitted | mota | 1.00 / 1.00 | 1.00 / 1.00 | 9 of 9 |"


def test_a_star_needs_both_figures() -> None:
    near, far = made(0.95)["0"], made(0.9)["0"]
    assert prediction.within(near, "fitted")
    assert not prediction.within(far, "fitted")
    assert prediction.line("row", near) == "| row | 0.950 / 0.950 | 0.975 / 0.975 * | 0.975 / 0.975 * |"


@pytest.mark.soak
def test_a_row_and_its_distances(data: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    data("cmc", "CMC1")
    prediction.run(["cmc1-fairmot"], range(1), True, True, False)
    text = capsys.readouterr().out
    assert "of 1 rows" in text
    assert (text.count("| cmc1-fairmot"), text.count("| fitted |")) == (3, 3)
    table = prediction.distance_table(["cmc1-fairmot"], True, range(1))
    assert len(table) == 15
    assert table[0] == "| statistic | cmc1-fairmot |"
