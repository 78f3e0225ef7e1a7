"""The world of a scenario, with the distractors and seats that it asks for."""

from __future__ import annotations

from sim.scenario import Scenario
from worlds import catalogue
from worlds.scenes.distractor_placement import with_distractors, with_seats
from worlds.world import World


def world_of(scenario: Scenario) -> World:
    """The world of a scenario. Raises ValueError for an unknown world, and where distractors or seats do not fit in."""
    return furnished(catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty), scenario)


def furnished(world: World, scenario: Scenario) -> World:
    """A world with the distractors and seats of a scenario. Raises ValueError where they do not fit in."""
    world = with_distractors(world, scenario.stream("world/distractors"), scenario.distractors)
    return with_seats(world, scenario.stream("world/seats"), scenario.sitters)
