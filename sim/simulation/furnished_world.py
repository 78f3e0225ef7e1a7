"""The world of a scenario, with the distractors, seats and building fronts that it asks for."""

from __future__ import annotations

from dataclasses import replace

from sim.scenario import Scenario
from worlds import catalogue
from worlds.props.facades import add_facades
from worlds.scenes.distractor_placement import with_distractors, with_seats
from worlds.world import World


def world_of(scenario: Scenario) -> World:
    """The world of a scenario. Raises ValueError for an unknown world, and where distractors or seats do not fit in."""
    return furnished(catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty), scenario)


def furnished(world: World, scenario: Scenario) -> World:
    """A world with the distractors, seats and façades of a scenario. Raises ValueError where they do not fit in."""
    world = with_distractors(world, scenario.stream("world/distractors"), scenario.distractors)
    world = with_seats(world, scenario.stream("world/seats"), scenario.sitters)
    if not scenario.facades:
        return world
    spec = world.spec.copy()
    add_facades(spec, scenario.stream("world/facades"), world.ground, scenario.facades, scenario.glare)
    return replace(world, spec=spec)
