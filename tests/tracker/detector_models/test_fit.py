"""A fit finds the parameters of a model back in the boxes that the model itself simulates."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import walked_room
from tracker.detector_models.comparison import distances, table
from tracker.detector_models.fit import fit
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import (
    Confidences,
    DetectorModel,
    EdgeErrors,
    FalseBoxes,
    Merges,
    Misses,
    SecondBoxes,
    StandingBoxes,
    model_text,
    parse_model,
)
from tracker.detector_models.observations import TruePeople, observed
from tracker.detector_models.samples import joined, samples_of
from tracker.detector_models.simulation import simulated_detections
from tracker.recordings.degradation import BoxNoise, projected_boxes

SPREAD = np.array([0.02, 0.03, 0.03, 0.03])
"""Of the terms of the edges, in body heights."""
SEEN = ("confidence", "moved", "whole_error")
"""Columns of samples that are unknown for people without a box."""


def known_model() -> DetectorModel:
    grid = np.clip(np.linspace(0, 1, 21), 0.005, 0.995)
    normal = np.sqrt(2) * np.array([_inverse_error_function(2 * p - 1) for p in grid])
    table_ = tuple(tuple((0.01 + s * normal).tolist()) for s in SPREAD)
    one = tuple(tuple(row) for row in np.eye(4).tolist())
    sure = tuple(np.linspace(0.5, 0.98, 21).tolist())
    return DetectorModel(
        "known",
        "places",
        Misses((-2.5, 3.0, 0.0, 0.0, 0.0), (-2.5, -0.7), 1.2, 0.03),
        EdgeErrors((table_, table_), (0.4, 0.4, 0.4, 0.4), (0.8, 0.8, 0.8, 0.8), one, 1.0, 0.0),
        Confidences(sure, (0.0, 0.0, 0.0, 0.0, 0.0), 1.0, 0.2, 0.6),
        Merges((0.0, 0.0, 0.0), 0.0),
        SecondBoxes((0.08,), 0.5, ((0.05, 0.02, -0.05, -0.72, 0.4, 1.0, 1.0, 0.0),)),
        FalseBoxes(0.3, ((7.0, 1.0, 0.4, 0.35), (5.0, 1.4, 0.5, 0.45))),
        StandingBoxes(1.5, 2.0, 0.01, ((6.0, 0.8, 0.9, 0.6, 0.5, 0.7),)),
    )


def _inverse_error_function(x: float) -> float:
    from scipy.special import erfinv

    return float(erfinv(x))


@pytest.fixture(scope="module")
def room():
    return walked_room(people=7, frames=240, seed=4)


@pytest.fixture(scope="module")
def fitted(room):
    truth, model = TruePeople(room.truth, {}), known_model()
    boxes = simulated_detections(room, truth, model, 2)
    samples = samples_of(room, observed(room, truth, boxes))
    return samples, fit(samples, "again", "places", {}, replicates=40)


def test_parameters_are_found_back(fitted):
    _, model = fitted
    known, figures = known_model(), model.figures

    def within(name, value, slack=0.0):
        _, low, high = figures[name]
        assert low - slack <= value <= high + slack, (name, value, figures[name])

    within("misses.time_s", known.misses.time_s, 0.3)
    within("misses.flicker", known.misses.flicker, 0.02)
    within("misses.coefficients.constant", -2.5, 0.4)
    within("misses.coefficients.hidden", 3.0, 0.6)
    for edge in ("top", "bottom"):
        within(f"edges.{edge}.mean", 0.01, 0.006)
        within(f"edges.{edge}.deviation", 0.03, 0.006)
        within(f"edges.{edge}.lasting", 0.4, 0.1)
        within(f"edges.{edge}.time_s", 0.8, 0.25)
    within("confidences.median", np.median(known.confidences.quantiles), 0.03)
    within("confidences.time_s", 0.6, 0.25)
    within("second.rate", 0.08, 0.02)
    within("false.rate", 0.3, 0.1)
    within("standing.sites", 1.5)
    assert model.merges.probability == pytest.approx((0, 0, 0), abs=0.02)


def test_intervals_hold_the_value(fitted):
    _, model = fitted
    for name, (value, low, high) in model.figures.items():
        assert low <= high, name
        if name.startswith("misses.visible"):
            assert low <= value <= high, name


def test_the_same_samples_give_the_same_bytes(fitted):
    samples, _ = fitted
    first, again = (model_text(fit(samples, "again", "places", {}, replicates=3)) for _ in range(2))
    assert first == again


@pytest.mark.soak
def test_simulated_boxes_are_nearer_than_independent_ones(room, fitted):
    samples, model = fitted
    truth = TruePeople(room.truth, {})
    own = samples_of(room, observed(room, truth, simulated_detections(room, truth, model, 11)))
    plain = samples_of(room, observed(room, truth, simulated_detections(room, truth, IndependentErrors(), 11)))
    filled = (model.edges.hidden, model.edges.border)
    near, far = distances(samples, own, filled), distances(samples, plain, filled)
    for name in ("miss runs", "top edge", "bottom edge", "top edge, autocorrelation", "confidence of people", "boxes of a view"):
        assert near[name] < far[name], (name, near[name], far[name])
    lines = table({"this model": near, "independent": far})
    assert len(lines) == 1 + len(near)
    assert lines[2].split()[:2] == ["miss", "runs"]


def test_too_little_truth_is_refused(room):
    truth = TruePeople(room.truth, {})
    few = room.cut(0, 5)
    with pytest.raises(ValueError, match=r"too little truth: .* of 7 people, .* needs at least 200 bodies, 2 people and 100 boxes"):
        fit(samples_of(few, observed(few, TruePeople(few.truth, {}))), "few", "places", {})
    empty = replace(room, detections={"C1": {}})
    with pytest.raises(ValueError, match="0 of these bodies with a box"):
        fit(samples_of(empty, observed(empty, truth)), "none", "places", {})
    with pytest.raises(ValueError, match="no frame has both truth and detections"):
        samples_of(room, observed(room, TruePeople({}, {})))


def test_joined_samples_count_people_apart(fitted):
    samples, _ = fitted
    both = joined([samples, samples])
    assert len(both.people) == 2 * len(samples.people)
    assert len(np.unique(both.people.person)) == 2 * len(np.unique(samples.people.person))
    assert both.cameras == samples.cameras * 2
    with pytest.raises(ValueError, match=r"rates are 4, 2 frames/s"):
        joined([samples, replace(samples, period=0.5)])


def test_people_without_boxes_may_be_all_that_a_replicate_draws(fitted):
    people = fitted[0].people
    lost = people.person != people.person[0]
    none = {name: np.where(lost if (own := getattr(people, name)).ndim == 1 else lost[:, None], np.nan, own) for name in SEEN}
    bare = replace(people, detected=people.detected & ~lost, merged=people.merged & ~lost, seconds=people.seconds * ~lost, **none)
    model = fit(replace(fitted[0], people=bare), "one is found", "places", {}, replicates=20)
    assert model.figures["confidences.median"][1] >= min(known_model().confidences.quantiles)


def test_an_edge_that_no_box_shows_has_no_errors_and_no_figures(fitted):
    border = fitted[0].people.border_in.copy()
    border[:, 3] = 0.2
    model = fit(replace(fitted[0], people=replace(fitted[0].people, border_in=border)), "close", "places", {}, replicates=3)
    assert set(model.edges.quantiles[0][3]) == {0.0}
    assert [name for name in model.figures if name.startswith("edges.bottom")] == []
    assert parse_model(model_text(model)).edges == model.edges


def test_boxes_that_equal_the_true_ones_are_fitted(room):
    exact = projected_boxes(room, BoxNoise(0.0, 0.0), 1)
    model = fit(samples_of(exact, observed(exact, TruePeople(room.truth, {}))), "exact", "places", {}, replicates=0)
    assert np.array(model.edges.correlation).tolist() == np.eye(4).tolist()
    # Without a bootstrap, only the exact intervals are known.
    assert "misses.share" not in model.figures


def test_frames_count_from_the_first_with_truth(room):
    truth = {frame: people for frame, people in room.truth.items() if frame >= 140}
    late = samples_of(room, observed(room, TruePeople(truth, {})))
    assert late.people.frame.max() + 1 == late.false.frames[0] == 100
    assert 0 <= late.false.frame.min() < late.false.frame.max() < 100
