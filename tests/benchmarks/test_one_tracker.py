"""The benchmark of the tracker of people: its scores are those of `pilsim score`, and its options reach the tracker."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.benchmarks.one_tracker import (
    FIGURES,
    GROUPS,
    LEAST,
    ONE_NUMBER,
    TRANSFORMS,
    Source,
    all_rows,
    chosen_rows,
    main,
    outcome,
    parser,
    transformed,
    with_fields,
)
from tests.benchmarks.room import room
from tracker.metrics.evaluation import evaluate
from tracker.options import parameters_from
from tracker.pipeline import track
from tracker.sequence.results import Results

FRAMES = 12
ROWS = all_rows(False, range(100, 102), Source())


@pytest.mark.soak
def test_scores_are_those_of_evaluate() -> None:
    sequence, parameters = room(0).cut(0, FRAMES).sequence(), parameters_from({"delay": 2})
    expected = evaluate(sequence, Results.of(track(sequence.setup, sequence.ticks, parameters), {}))["targets"]
    found = outcome(Source(seed=0, frames=FRAMES), FRAMES // 2, parameters, None)
    assert found.whole == {name: math.nan if expected[name] is None else expected[name] for name in FIGURES}
    for count in ("truths", "misses", "false_positives"):
        # A match goes on from frame to frame (Bernardin & Stiefelhagen 2008), and not across the cut.
        slack = 0 if count == "truths" else 0.1 * found.whole["truths"]
        assert abs(found.parts["tuned"][count] + found.parts["untuned"][count] - found.whole[count]) <= slack


@pytest.mark.parametrize("name", TRANSFORMS)
def test_transforms_keep_the_order_of_confidences(name: str) -> None:
    ticks = list(room(0, frames=FRAMES).sequence().ticks)
    for before, after in zip(ticks, transformed(ticks, name), strict=True):
        for old, new in zip(before.views, after.views, strict=True):
            kept = old.detections.confidence >= LEAST if name in ONE_NUMBER else np.ones(len(old.detections), dtype=bool)
            assert (old.detections.bearing[kept] == new.detections.bearing).all()
            confidence = new.detections.confidence[np.argsort(old.detections.confidence[kept])]
            assert (np.diff(confidence) >= 0).all()
            assert np.isfinite(confidence).all()
            if name in ONE_NUMBER:
                assert (confidence == ONE_NUMBER[name]).all()
            else:
                assert len(np.unique(confidence)) == len(confidence)


def test_fields_of_parts_are_set() -> None:
    parameters = with_fields(parameters_from({}), ["residence=5", "motion.foot_spread=0.3", "n_conf=4"])
    assert (parameters.targets.residence, parameters.targets.motion.foot_spread, parameters.targets.n_conf) == (5.0, 0.3, 4)


@pytest.mark.parametrize("setting", ["foo=1", "motion.foo=1", "residence.x=1", "residence=many", "n_conf=1.5", "motion=1", "residence"])
def test_other_fields_are_one_line(setting: str) -> None:
    with pytest.raises(ValueError, match="--set is"):
        with_fields(parameters_from({}), [setting])


def test_rows_are_chosen_by_name_expression_and_group() -> None:
    assert [row.name for row in chosen_rows(["room-10[34]", "pets-157"], ROWS)] == ["pets-157", "room-103", "room-104"]
    assert {row.group for row in chosen_rows(GROUPS, ROWS)} == set(GROUPS)
    assert len(chosen_rows(GROUPS, ROWS)) == len(ROWS) > len(chosen_rows([], ROWS))
    for pattern in ("nothing", "pets-["):
        with pytest.raises(ValueError, match="row is"):
            chosen_rows([pattern], ROWS)


@pytest.mark.soak
def test_bad_options_are_one_line_and_code_2(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for words in (["nothing"], ["room", "--seeds", "3", "1"], ["room", "--set", "foo=1"], ["room", "--delay", "-1"]):
        monkeypatch.setattr("sys.argv", ["one_tracker", *words])
        assert main() == 2
        out, err = capsys.readouterr()
        assert not out
        assert err.startswith("error: ")
        assert err.count("\n") == 1


def test_options_of_track_are_options_here() -> None:
    given = vars(parser().parse_args(["room", "--theta-s", "0.5", "--iterations", "3", "--slam", "iekf"]))
    assert (given["theta_s"], given["iterations"], given["slam"]) == (0.5, 3, "iekf")
