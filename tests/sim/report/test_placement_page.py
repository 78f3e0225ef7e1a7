"""The page of a comparison of policies: episodes are played again as they were."""

from sim.placement.config import PlacementConfig
from sim.report.placement_page import PlacementRun


def test_a_preset_is_played_in_the_world_of_the_results() -> None:
    run = PlacementRun({}, {"density": "s2l2"}, 1, "")
    for results, world in (("ruins", "ruins"), ("s2l2", "campus")):
        options = run.options_in(results)
        found = PlacementConfig.of(options, options.pop("density"))
        assert (found.world, found.people) == (world, 35)
