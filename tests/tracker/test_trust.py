"""What is learned of a view: shares come out as they were put in, and what was assumed at first fades."""

import numpy as np

from tracker.trust import Trust, TrustParameters

SQUARE = 300.0


def taught(share: float, false: float, ticks: int = 600) -> Trust:
    """People are found at `share`, with `false` boxes of the highest confidence a tick."""
    rng, trust = np.random.default_rng(0), Trust(TrustParameters(), SQUARE)
    for _ in range(ticks):
        found = np.full(rng.binomial(10, share), 0.99)
        other = np.full(rng.poisson(false), 0.99)
        trust.learn("c", found, 10.0, (other, np.ones(len(other))))
    return trust


def test_shares_are_found() -> None:
    trust = taught(0.6, 2.0)
    assert abs(trust.detection("c") - 0.6) < 0.05
    expected = np.log(0.6 / (2.0 / SQUARE))
    assert abs(trust.worth("c", np.array([0.99]))[0] - expected) < 0.3


def test_a_view_with_many_false_boxes_is_trusted_less() -> None:
    sure = np.array([0.99])
    assert taught(0.9, 3.0).worth("c", sure)[0] < taught(0.9, 0.1).worth("c", sure)[0] - 2


def test_another_view_knows_nothing_of_it() -> None:
    trust = taught(0.3, 5.0)
    fresh = Trust(TrustParameters(), SQUARE)
    assert trust.detection("other") == fresh.detection("other")


def test_nothing_becomes_impossible() -> None:
    trust = taught(1.0, 0.0, 5000)
    assert trust.detection("c") <= TrustParameters().most
    assert np.isfinite(trust.worth("c", np.array([0.0, 0.6, 0.85, 0.93, 1.0]))).all()


def test_weighted_boxes_count_by_their_weight() -> None:
    trust = Trust(TrustParameters(), SQUARE)
    for _ in range(2000):
        trust.learn("c", np.full(9, 0.99), 10.0, (np.full(2, 0.99), np.full(2, 0.5)))
    expected = np.log(0.9 / (1.0 / SQUARE))
    assert abs(trust.worth("c", np.array([0.99]))[0] - expected) < 0.1
