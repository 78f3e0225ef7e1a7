from __future__ import annotations

import numpy as np
import pytest

from tracker.ekf.gaussian import gate, mahalanobis2, nees, robust_weights, subtract, whitened


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


def test_gate_is_the_quantile_of_chi_square() -> None:
    # With two degrees of freedom the distribution is 1 − exp(−x/2).
    assert gate(2, 0.99) == pytest.approx(-2 * np.log(0.01))


def test_the_updated_covariance_equals_josephs_form(rng: np.random.Generator) -> None:
    n, m = 9, 4
    P, R, H = positive(rng, n), positive(rng, m), rng.normal(size=(m, n))
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    rest = np.eye(n) - K @ H
    got = P.copy()
    subtract(got, whitened(H @ P, S))
    np.testing.assert_allclose(got, rest @ P @ rest.T + K @ R @ K.T, atol=1e-10)
    np.testing.assert_array_equal(got, got.T)


@pytest.mark.parametrize("S", [-np.eye(2), np.diag([1.0, np.nan])])
def test_an_innovation_covariance_that_is_not_positive_is_an_error(rng: np.random.Generator, S: np.ndarray) -> None:
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        whitened(np.ones((2, 3)), S)


def test_the_covariance_stays_positive_after_ten_thousand_precise_updates(rng: np.random.Generator) -> None:
    P = positive(rng, 30) * 1e4
    for _ in range(10_000):
        H = rng.normal(size=(2, 30))
        subtract(P, whitened(H @ P, H @ P @ H.T + 1e-6 * np.eye(2)))
        P += 1e-6 * np.eye(30)
    assert np.linalg.eigvalsh(P).min() > 0


def test_nees_is_one_on_average(rng: np.random.Generator) -> None:
    P = positive(rng, 6)
    errors = rng.multivariate_normal(np.zeros(6), P, 4000)
    assert np.mean([nees(e, P) for e in errors]) == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(mahalanobis2(errors[:5], P) / 6, [nees(e, P) for e in errors[:5]])


def test_weights_are_one_without_outliers_and_without_a_threshold(rng: np.random.Generator) -> None:
    noise = np.tile(np.eye(2), (5, 1, 1))
    H = rng.normal(size=(10, 3))
    spread = H @ H.T
    assert robust_weights(spread, noise, np.full(10, 1e3), np.inf) == pytest.approx(1.0)
    assert robust_weights(spread, noise, 0.1 * rng.normal(size=10), 3.0) == pytest.approx(1.0)


def test_weights_find_the_outlier_that_the_state_could_explain(rng: np.random.Generator) -> None:
    """The prior is so wide that every innovation passes a gate; only together they show which one is wrong."""
    H, noise = rng.normal(size=(20, 3)), np.tile(np.eye(2) * 0.01, (10, 1, 1))
    innovation = H @ np.array([5.0, -3.0, 2.0]) + 0.1 * rng.normal(size=20)
    innovation[6:8] += 4.0
    weights = robust_weights(H @ H.T * 100, noise, innovation, 3.0)
    assert weights[3] < 0.01
    assert (np.delete(weights, 3) > 0.5).all()
