"""The page of a comparison of policies: episodes are played again as they were."""

from sim.placement.config import PlacementConfig
from sim.policies.rollouts import EpisodeResult
from sim.report.placement_page import PlacementRun, _headline


def played(policy: str, values: list[float]) -> list[EpisodeResult]:
    return [EpisodeResult(policy, seed, {"information": value}) for seed, value in enumerate(values)]


def test_the_headline_tells_a_difference_that_is_seen_from_one_that_is_not() -> None:
    greedy = played("greedy", [4.0, 4.2, 4.1])
    better = _headline("campus", greedy + played("predictive", [5.0, 5.2, 5.11]))
    assert better.startswith("In campus, predictive has the highest mean: information 5.10")
    assert "predictive less greedy is +1.00" in better
    assert "seen" not in better
    # The first policy is the best one: the next is compared with it.
    alike = _headline("campus", greedy + played("learned", [3.0, 3.1, 3.2]) + played("lloyd", [4.1, 4.0, 4.1]))
    assert alike.startswith("In campus, greedy has the highest mean")
    assert "lloyd less greedy is −0.03" in alike
    assert alike.endswith("no difference seen.")
    assert "less" not in _headline("campus", greedy)


def test_a_preset_is_played_in_the_world_of_the_results() -> None:
    run = PlacementRun({}, {"density": "s2l2"}, 1, "")
    for results, world in (("ruins", "ruins"), ("s2l2", "campus")):
        options = run.options_in(results)
        found = PlacementConfig.of(options, options.pop("density"))
        assert (found.world, found.people) == (world, 35)
