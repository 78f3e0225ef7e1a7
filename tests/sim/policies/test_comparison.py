"""Policies side by side: the same figures with any number of workers, and differences that are paired."""

from __future__ import annotations

import pytest

import sim  # noqa: F401
from sim.policies.comparison import contest, differences, draw, text
from sim.policies.rollouts import Outcome, table

OPTIONS = {"world": "pilsun", "people": 4, "robots": 2}


def outcomes(workers: int) -> list[Outcome]:
    return [outcome for some in contest(("random", "static"), range(9, 12), OPTIONS, 6, workers) for outcome in some]


def test_two_workers_find_what_one_finds():
    alone = outcomes(1)
    assert [(o.policy, o.seed) for o in alone] == [(name, seed) for name in ("random", "static") for seed in (9, 10, 11)]
    assert outcomes(2) == alone
    with pytest.raises(ValueError, match="workers is 0, needs 1 to 1024"):
        list(contest(("random",), range(1), OPTIONS, 1, 0))


def test_differences_are_of_the_same_seeds():
    # The second is better by 0.1 in every episode, though episodes differ by much more.
    found = [Outcome("a", 0, {"seen": 0.1}), Outcome("a", 1, {"seen": 0.7}), Outcome("b", 0, {"seen": 0.2}), Outcome("b", 1, {"seen": 0.8})]
    less = differences(found)
    assert list(less) == ["b"]
    assert less["b"]["seen"].mean == pytest.approx(0.1)
    assert less["b"]["seen"].low == pytest.approx(0.1)
    assert "less a, seed by seed" in text(table(found), less)
    assert differences(found[:2]) == {}


def test_the_picture_is_whole_or_not_there(tmp_path):
    found = table([Outcome("a", seed, {"seen": 0.1 * seed, "seen_twice": 0.0, "gospa": 0.5}) for seed in range(3)])
    draw(found, "three episodes", tmp_path / "means.png")
    assert [path.name for path in tmp_path.iterdir()] == ["means.png"]
