"""Detection and clutter rates: true rates are estimated, and prior counts fade."""

import numpy as np

from tracker.tracks.detection_rates import DetectionRateParameters, DetectionRates

GROUND_AREA = 300.0


def taught(share: float, false: float, ticks: int = 600) -> DetectionRates:
    """People are found at `share`, with `false` boxes of the highest confidence a tick."""
    rng, rates = np.random.default_rng(0), DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(ticks):
        found = np.full(rng.binomial(10, share), 0.99)
        other = np.full(rng.poisson(false), 0.99)
        rates.learn("c", found, 10.0, other, np.ones(len(other)))
    return rates


def test_rates_are_estimated() -> None:
    rates = taught(0.6, 2.0)
    assert abs(rates.detection("c") - 0.6) < 0.05
    expected = np.log(0.6 / (2.0 / GROUND_AREA))
    assert abs(rates.log_ratio("c", np.array([0.99]))[0] - expected) < 0.3


def test_a_view_with_many_false_boxes_has_lower_log_ratios() -> None:
    sure = np.array([0.99])
    assert taught(0.9, 3.0).log_ratio("c", sure)[0] < taught(0.9, 0.1).log_ratio("c", sure)[0] - 2


def test_views_are_independent() -> None:
    rates = taught(0.3, 5.0)
    fresh = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    assert rates.detection("other") == fresh.detection("other")


def test_rates_stay_within_bounds() -> None:
    rates = taught(1.0, 0.0, 5000)
    assert rates.detection("c") <= DetectionRateParameters().max_detection
    assert np.isfinite(rates.log_ratio("c", np.array([0.0, 0.6, 0.85, 0.93, 1.0]))).all()


def test_weighted_boxes_count_by_their_weight() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(2000):
        rates.learn("c", np.full(9, 0.99), 10.0, np.full(2, 0.99), np.full(2, 0.5))
    expected = np.log(0.9 / (1.0 / GROUND_AREA))
    assert abs(rates.log_ratio("c", np.array([0.99]))[0] - expected) < 0.1


def covered_by(things: float, people: float = 0.0) -> np.ndarray:
    return np.array([[things, people]])


def test_relative_detection_rates_of_covered_people_are_estimated() -> None:
    rng, rates = np.random.default_rng(1), taught(0.9, 0.1)
    for _ in range(4000):
        cover = np.array([[0.3, 0.0], [0.9, 0.0], [0.0, 0.5]])
        rates.learn_partly_visible("c", cover, rng.random(3) < 0.9 * np.array([0.8, 0.1, 0.25]))
    assert abs(rates.relative_detection("c", covered_by(0.3))[0] - 0.8) < 0.05
    assert abs(rates.relative_detection("c", covered_by(0.9))[0] - 0.1) < 0.05
    assert abs(rates.relative_detection("c", covered_by(0.0, 0.5))[0] - 0.25) < 0.05
    assert rates.relative_detection("c", covered_by(0.0))[0] == 1
    assert (
        rates.relative_detection("other", covered_by(0.9))[0]
        == DetectionRates(DetectionRateParameters(), GROUND_AREA).relative_detection("c", covered_by(0.9))[0]
    )


def test_relative_detection_rates_do_not_increase_with_cover() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    for _ in range(500):
        rates.learn_partly_visible("c", covered_by(0.7), np.ones(1, dtype=bool))
    share = rates.relative_detection("c", np.column_stack([np.linspace(0, 1, 30), np.zeros(30)]))
    assert (np.diff(share) <= 1e-12).all()


def test_people_covered_by_objects_and_people_are_left_out() -> None:
    rates = DetectionRates(DetectionRateParameters(), GROUND_AREA)
    before = rates.relative_detection("c", covered_by(0.5, 0.5))
    for _ in range(500):
        rates.learn_partly_visible("c", covered_by(0.5, 0.5), np.zeros(1, dtype=bool))
    assert rates.relative_detection("c", covered_by(0.5, 0.5)) == before
