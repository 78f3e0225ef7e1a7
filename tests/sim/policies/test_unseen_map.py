"""The expected density of unseen people after observations."""

from __future__ import annotations

import numpy as np

from sim.placement.config import PlacementConfig
from sim.placement.map import MapKey, map_of
from sim.policies.policy import TeamKnowledge
from sim.policies.waypoints import UnseenMap


def test_observed_points_are_empty_and_recover():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    config, none = PlacementConfig(world="pilsun", robots=1, people=6), np.zeros((0, 2))

    def at(number: int) -> TeamKnowledge:
        robot = np.array([[*place.roadmap.nodes[number], 0.0]])
        return TeamKnowledge(place, config, robot, none, none, np.zeros((0, 2, 2)), {})

    unseen, visible = UnseenMap(place), place.visible_from_nodes(config.reach)
    far = int(np.argmax(place.roadmap.distance[0]))
    assert unseen.update(at(0), 0.25).tolist() == [0]
    np.testing.assert_array_equal(unseen.density, np.where(visible[0], 0.0, place.traffic))
    unseen.update(at(far), 0.25)
    np.testing.assert_allclose(unseen.density, np.where(visible[far], 0.0, np.where(visible[0], 0.25, 1.0) * place.traffic))
    assert (visible[0] & ~visible[far]).any()
    # The map itself is unchanged.
    np.testing.assert_array_equal(UnseenMap(place).density, place.traffic)
