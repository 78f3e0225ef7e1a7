"""Comparison of policies: equal results for any number of workers, and paired differences."""

from __future__ import annotations

import pytest

import sim  # noqa: F401
from sim.policies.rollouts import EpisodeResult, compare, differences, draw, table, text

OPTIONS = {"world": "pilsun", "people": 4, "robots": 2}


def results(workers: int) -> list[EpisodeResult]:
    return [result for some in compare(("random", "static"), range(9, 12), OPTIONS, 6, workers) for result in some]


@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_workers():
    alone = results(1)
    assert [(o.policy, o.seed) for o in alone] == [(name, seed) for name in ("random", "static") for seed in (9, 10, 11)]
    assert results(2) == alone
    with pytest.raises(ValueError, match="workers is 0, needs 1 to 1024"):
        list(compare(("random",), range(1), OPTIONS, 1, 0))


def test_differences_are_paired_by_seed():
    # The second is better by 0.1 in every episode, though episodes differ by much more.
    found = [
        EpisodeResult("a", 0, {"seen": 0.1}),
        EpisodeResult("a", 1, {"seen": 0.7}),
        EpisodeResult("b", 0, {"seen": 0.2}),
        EpisodeResult("b", 1, {"seen": 0.8}),
    ]
    paired = differences(found)
    assert list(paired) == ["b"]
    assert paired["b"]["seen"].mean == pytest.approx(0.1)
    assert paired["b"]["seen"].low == pytest.approx(0.1)
    assert "difference from a, paired by seed" in text(table(found), paired)
    assert differences(found[:2]) == {}


def test_the_plot_leaves_one_file(tmp_path):
    found = table([EpisodeResult("a", seed, {"seen": 0.1 * seed, "seen_twice": 0.0, "gospa": 0.5}) for seed in range(3)])
    draw(found, "three episodes", tmp_path / "means.png")
    assert [path.name for path in tmp_path.iterdir()] == ["means.png"]
