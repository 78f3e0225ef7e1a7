"""Where somebody may be whom nobody has seen for a while."""

from __future__ import annotations

import numpy as np

from sim.placement.config import PlacementConfig
from sim.placement.map import MapKey, map_of
from sim.policies.policy import Briefing
from sim.policies.waypoints import UnseenMap


def test_what_is_looked_at_is_empty_and_comes_back():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    config, none = PlacementConfig(world="pilsun", robots=1, people=6), np.zeros((0, 2))

    def at(number: int) -> Briefing:
        robot = np.array([[*place.roads.places[number], 0.0]])
        return Briefing(place, config, robot, none, none, np.zeros((0, 2, 2)), {})

    hope, sees = UnseenMap(place), place.sees(config.reach)
    far = int(np.argmax(place.roads.distance[0]))
    assert hope.look(at(0), 0.25).tolist() == [0]
    np.testing.assert_array_equal(hope.left, np.where(sees[0], 0.0, place.traffic))
    hope.look(at(far), 0.25)
    np.testing.assert_allclose(hope.left, np.where(sees[far], 0.0, np.where(sees[0], 0.25, 1.0) * place.traffic))
    assert (sees[0] & ~sees[far]).any()
    # The map itself forgets nothing.
    np.testing.assert_array_equal(UnseenMap(place).left, place.traffic)
