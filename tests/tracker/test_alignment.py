"""One map in another: what is found, how sharp it says it is, and why not."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.alignment import Alignment, Meeting, align, levers
from tracker.gaussian import nees
from tracker.geometry import Array, Pose, wrap

SIGMA = 0.05


def maps(rng: np.random.Generator, count: int, shared: float = 0.0) -> tuple[tuple[Array, Array], tuple[Array, Array], Pose]:
    """Places (n, 3) and covariances of two maps of a hall, with errors that are partly `shared` m within a map, and how one lies in the other."""
    T = Pose.planar(3.0, -2.0, float(rng.uniform(-np.pi, np.pi)), 0.4)
    team = rng.uniform([0, 0, 0], [12, 9, 3], size=(count, 3))
    own = T.inverse().apply(team)
    P = SIGMA**2 * np.eye(3 * count) + shared**2 * np.kron(np.ones((count, count)), np.eye(3))
    draw = np.linalg.cholesky(P)
    noisy = [places + (draw @ rng.normal(size=3 * count)).reshape(-1, 3) for places in (own, team)]
    return (noisy[0], P), (noisy[1], P), T


def off(found: Alignment, T: Pose) -> Array:
    """The alignment's error (4,) as its covariance has it."""
    return np.append(T.apply(found.T_team_own.inverse().apply(found.centre)) - found.centre, wrap(T.yaw - found.T_team_own.yaw))


def test_levers_are_the_derivative_of_a_motion_about_the_centre() -> None:
    rng = np.random.default_rng(0)
    points, centre, change = rng.normal(size=(5, 3)), rng.normal(size=3), 1e-6 * rng.normal(size=4)
    turn = Pose.planar(0, 0, change[3])
    moved = centre + turn.apply(points - centre) + change[:3]
    np.testing.assert_allclose(levers(points, centre) @ change, moved - points, atol=1e-11)


@pytest.mark.parametrize("shared", [0.0, 0.1])
def test_the_alignment_knows_how_wrong_it_is(shared: float) -> None:
    rng, consistency = np.random.default_rng(1), []
    for _ in range(60):
        own, team, T = maps(rng, 20, shared)
        found = align(own, team, Meeting())
        assert isinstance(found, Alignment)
        consistency.append(nees(off(found, T), found.covariance))
    assert 0.7 < np.mean(consistency) < 1.4


def test_wrong_pairs_are_left_out() -> None:
    rng = np.random.default_rng(2)
    own, team, T = maps(rng, 40)
    wrong = np.arange(0, 40, 2)
    team[0][wrong] = team[0][rng.permutation(wrong)] + rng.normal(size=(20, 3))
    found = align(own, team, Meeting())
    assert isinstance(found, Alignment)
    assert not set(found.pairs.tolist()) & set(wrong.tolist())
    assert len(found.pairs) >= 18
    assert np.abs(off(found, T)).max() < 0.1


def test_one_bad_pair_near_its_place_is_found_by_the_others() -> None:
    own, team, _ = maps(np.random.default_rng(3), 20)
    team[0][7, 2] += 8 * SIGMA
    found = align(own, team, Meeting())
    assert isinstance(found, Alignment)
    assert 7 not in found.pairs


def test_maps_that_do_not_fit_are_refused() -> None:
    rng, rule = np.random.default_rng(4), Meeting()
    own, team, _ = maps(rng, 40)
    assert align((own[0][:8], own[1][:24, :24]), (team[0][:8], team[1][:24, :24]), rule) == "too little in common"
    assert align(own, (team[0][rng.permutation(40)], team[1]), rule) == "places disagree"
    assert align(own, (2 * team[0], team[1]), rule) == "places disagree"
    mast = own[0] * [0.05, 0.05, 1.0] + np.linspace(0, 0.6, 40)[:, None] * [1.0, 0.0, 0.0]
    assert align((mast, 4 * own[1]), (mast, 4 * own[1]), rule) == "alignment not sharp"


@pytest.mark.parametrize(("name", "value"), [("pairs", 2), ("share", 0.0), ("share", 1.5)])
def test_rules_have_bounds(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} is {value}, needs"):
        Meeting(**{name: value})
